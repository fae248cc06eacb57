"""Truth by brute force: central differences, every pixel against every capsule, lamps and light moved."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.misplacement import parting_mm
from knotfab.effects.shifts import LAYERS, SAG
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Felt, State
from knotfab.render.capsules import BEHIND, capsule_distance, cut_before_light
from knotfab.render.silhouette import Frame
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.piece import Printer
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import Placing


def state_at(points: Array, reach: float = 12.0) -> State:
    """The state of one closed polyline with vertices (N, 3), whose neighbours lie within `reach` mm."""
    rings = polylines_of_sizes((len(points),))
    return State.at(points, rings, find_neighbours(points, rings, reach, 6))


def assert_slope(
    call: Callable[[Array], Felt], points: Array, rel: float = 1e-5, step: float = 1e-6
) -> None:
    """That the gradient (n, 3) of `call` is what its number changes by, along five random ways."""
    draw = np.random.default_rng(4)
    _, slope = call(points)
    assert slope.shape == points.shape
    for _ in range(5):
        way = draw.normal(size=points.shape)
        change = (call(points + step * way)[0] - call(points - step * way)[0]) / (2 * step)
        size = float(np.linalg.norm(slope) * np.linalg.norm(way))
        assert float((slope * way).sum()) == pytest.approx(change, rel=rel, abs=1e-7 * size)


def render_dense(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    tau: float,
    chunk_pixels: int = 4096,
) -> Tensor:
    """Image [height, width] of sigmoid(tau * max over capsules of the signed distance in px).

    Paper, sec. 3.3 (occupancy, max over primitives), with the ray-distance silhouette.
    """
    a, b, seen = cut_before_light(frame.local(starts), frame.local(ends), radius)
    count = frame.width * frame.height
    index = torch.arange(count, device=a.device)
    image = []
    for first in range(0, count, chunk_pixels):
        pixels = index[first : first + chunk_pixels]
        qx = ((pixels % frame.width).to(a.dtype) + frame.u0) * frame.step
        qy = ((pixels // frame.width).to(a.dtype) + frame.v0) * frame.step
        s = capsule_distance(a[None], b[None], qx[:, None], qy[:, None], radius, frame.focal_px)
        s = torch.where(seen, s, BEHIND)
        image.append(torch.sigmoid(tau * s.max(dim=1).values.clamp_min(BEHIND)))
    return torch.cat(image).reshape(frame.height, frame.width)


def bounds_and_truths(
    rng: np.random.Generator, ways: int = 150, *, turns: bool = True
) -> tuple[Array, Array]:
    """(3,) bounds and (3,) truths, mm: of lamp, piece and wall, the wall tilted by up to 30 degrees.

    `turns`: whether the piece stands free; one that does not hangs on the wall, and leans with it.

    Moved by the whole amount in `ways` directions; all round the tube about random points.
    """
    view, points, radius, camera = random_scene(rng)
    placing = Placing(
        lamp_mm=rng.uniform(1, 10), turn_deg=rng.uniform(0.2, 3), tilt_deg=rng.uniform(0.2, 3)
    )
    all_round = directions(ways)
    surface = (points[:, None] + radius * directions(15)).reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    was = cast(surface, camera.eye, camera)
    lamp = max(
        parted(was, cast(surface, camera.eye + placing.lamp_mm * way, camera)) for way in all_round
    )
    angle = np.radians(placing.turn_deg)
    turn = max(
        parted(
            was, cast(middle + (surface - middle) @ turn_about(way, angle).T, camera.eye, camera)
        )
        for way in all_round
    )
    lean = np.radians(placing.tilt_deg)
    normal = camera.receiver[:3]
    about = [way - (way @ normal) * normal for way in all_round]
    turned = [turn_about(way / np.linalg.norm(way), lean) for way in about]
    tilt = max(parted(was, _leaning(surface, camera, by, turns)) for by in turned)
    bounds = parting_mm(
        Shadows.from_points(view, points), radius, World(placing=placing, turns=turns)
    )
    return np.array(bounds), np.array([lamp, turn if turns else 0.0, tilt])


def _leaning(surface: Array, camera: Camera, by: Array, turns: bool) -> Array:
    """(n, 2) shadows on the wall turned about its middle, the piece with it unless it `turns` freely."""
    steady = camera.corner

    def turn(points: Array) -> Array:
        return np.asarray(steady + (points - steady) @ by.T)

    leaning = Camera(camera.eye, turn(camera.corner), by @ camera.du, by @ camera.dv, 1, 1)
    return cast(surface if turns else turn(surface), camera.eye, leaning)


def random_scene(rng: np.random.Generator) -> tuple[ResolvedView, Array, float, Camera]:
    """A view of a wall that is tilted by up to 30 degrees, 60 points before it, and a tube's radius."""
    while True:
        view = ResolvedView(
            frame_width_mm=180.0,
            frame_height_mm=180.0,
            light_distance_mm=rng.uniform(200, 2000),
            wall_distance_mm=rng.uniform(50, 400),
            wall_tilt_deg=rng.uniform(-30, 30),
        )
        radius = rng.uniform(0.5, 4)
        room = min(0.4 * view.light_distance_mm, 0.8 * view.wall_distance_mm)
        points = rng.uniform(-1, 1, (60, 3)) * [70, 70, room / 2]
        camera = camera_of(view, 1, 1)
        height = points @ camera.receiver[:3] + camera.receiver[3]
        if height.min() > radius:
            return view, points, radius, camera


def shift_bound_and_truth(rng: np.random.Generator, effect: str) -> tuple[float, float]:
    """The magnitude of "sag" or "layers" in a random scene, and what moving the surface for real shifts, px.

    The mount lets every point sag by about 0.3 mm its own way; the layers are 0.05 to 0.4 mm high and lie
    in any direction.
    """
    view, points, radius, camera = random_scene(rng)
    surface, px = points[:, None] + radius * directions(60), view.pixel_mm
    was = cast(surface.reshape(-1, 3), camera.eye, camera)

    def shift(moves: Array) -> float:
        now = cast((surface + moves).reshape(-1, 3), camera.eye, camera)
        return float(np.linalg.norm(now - was, axis=1).max()) / px

    if effect == "sag":
        moves = rng.normal(scale=0.3, size=points.shape)
        context = EffectContext((view,), points, radius, 0.25, moves=moves)
        return SAG.magnitude(context), shift(moves[:, None])
    height, upwards = rng.uniform(0.05, 0.4), directions(50)[rng.integers(50)]
    world = World(printer=Printer(layer_height_mm=height))
    context = EffectContext((view,), points, radius, 0.25, world, upwards=upwards)
    return LAYERS.magnitude(context), max(shift(s * height * upwards) for s in (-0.5, 0.5))


def directions(count: int) -> Array:
    """(count, 3) unit vectors all round, on a spiral."""
    k = np.arange(count) + 0.5
    high, around = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - high**2)
    return np.column_stack([across * np.cos(around), across * np.sin(around), high])


def turn_about(axis: Array, angle: float) -> Array:
    """(3, 3), by Rodrigues."""
    k = np.cross(np.eye(3), -axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k))


def cast(points: Array, lamp: Array, camera: Camera) -> Array:
    """(n, 2) shadows of points (n, 3) on the wall, mm in its own axes."""
    normal, offset = camera.receiver[:3], camera.receiver[3]
    axes = np.stack([camera.du, -camera.dv])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    height, reach = points @ normal + offset, lamp @ normal + offset
    spots = lamp + (points - lamp) * (reach / (reach - height))[:, None]
    return np.asarray(spots @ axes.T)


def parted(was: Array, now: Array) -> float:
    """The largest distance left between shadows (n, 2) by their best shift, scale and turn (Umeyama 1991)."""
    x, y = was - was.mean(axis=0), now - now.mean(axis=0)
    one, other = x @ [1, 1j], y @ [1, 1j]
    return float(np.abs(other - np.vdot(one, other) / np.vdot(one, one) * one).max())
