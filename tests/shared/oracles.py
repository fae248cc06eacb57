"""Truth by brute force: central differences, every pixel against every capsule, lamps and light moved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.misplacement import parting_mm
from knotfab.effects.shifts import LAYERS, SAG, WALL
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


def wall_and_truth(rng: np.random.Generator) -> tuple[float, float]:
    """Measure how far a flat wall has the picture off a random round one, px: as claimed, and by halving
    rays."""
    view, _, _, _ = random_scene(rng)
    high = view.light_distance_mm + view.wall_distance_mm
    radius = rng.uniform(0.6, 5) * high if rng.random() < 0.5 else -rng.uniform(150, 3000)
    view = view.model_copy(update={"wall_radius_mm": float(radius)})
    camera = camera_of(view, 61, 61)
    u, v = np.meshgrid(np.linspace(-0.5, 60.5, 61), np.linspace(-0.5, 60.5, 61))
    flat = (camera.corner + u[..., None] * camera.du + v[..., None] * camera.dv).reshape(-1, 3)
    right, up = (axis / np.linalg.norm(axis) for axis in (camera.du, -camera.dv))
    normal = camera.receiver[:3]
    middle = camera.corner + 30 * (camera.du + camera.dv)
    arc, high_up = (flat - middle) @ right, (flat - middle) @ up
    turn = arc / radius
    at = middle + np.outer(radius * np.sin(turn), right) + np.outer(high_up, up)
    at += np.outer(radius * (1 - np.cos(turn)), normal)
    # halving finds the flat wall's place on the same ray
    low, top = np.zeros(len(at)), np.full(len(at), 10.0)
    for _ in range(60):
        share = 0.5 * (low + top)
        before = (camera.eye + share[:, None] * (at - camera.eye) - middle) @ normal > 0
        low, top = np.where(before, share, low), np.where(before, top, share)
    there = camera.eye + low[:, None] * (at - camera.eye)
    off = float(np.linalg.norm(there - flat, axis=1).max())
    magnitude = WALL.magnitude(EffectContext((view,), np.zeros((0, 3)), 1.0, 0.25))
    return magnitude, off / view.pixel_mm


def bounds_and_truths(
    rng: np.random.Generator, ways: int = 150, *, turns: bool = True, bent: bool = False
) -> tuple[Array, Array]:
    """(3,) bounds and (3,) truths, mm: of lamp, piece and wall, the wall tilted by up to 30 degrees.

    `turns`: whether the piece stands free; one that does not hangs on the wall, and leans with it.
    `bent`: before a wall that is round.

    Moved by the whole amount in `ways` directions; all round the tube about random points.
    """
    view, points, radius, camera = random_scene(rng, bent=bent)
    placing = Placing(
        lamp_mm=rng.uniform(1, 10), turn_deg=rng.uniform(0.2, 3), tilt_deg=rng.uniform(0.2, 3)
    )
    all_round = directions(ways)
    surface = (points[:, None] + radius * directions(15)).reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    was = cast(surface, camera.eye, camera, view)
    lamp = max(
        parted(was, cast(surface, camera.eye + placing.lamp_mm * way, camera, view))
        for way in all_round
    )
    angle = np.radians(placing.turn_deg)
    turn = max(
        parted(
            was,
            cast(middle + (surface - middle) @ turn_about(way, angle).T, camera.eye, camera, view),
        )
        for way in all_round
    )
    lean = np.radians(placing.tilt_deg)
    normal = camera.receiver[:3]
    about = [way - (way @ normal) * normal for way in all_round]
    turned = [turn_about(way / np.linalg.norm(way), lean) for way in about]
    tilt = max(parted(was, _leaning(surface, camera, view, by, turns)) for by in turned)
    bounds = parting_mm(
        Shadows.from_points(view, points), radius, World(placing=placing, turns=turns)
    )
    return np.array(bounds), np.array([lamp, turn if turns else 0.0, tilt])


def _leaning(surface: Array, camera: Camera, view: ResolvedView, by: Array, turns: bool) -> Array:
    """(n, 2) shadows on the wall turned about its middle, the piece with it unless it `turns` freely."""
    steady = camera.corner

    def turn(points: Array) -> Array:
        return np.asarray(steady + (points - steady) @ by.T)

    leaning = Camera(camera.eye, turn(camera.corner), by @ camera.du, by @ camera.dv, 1, 1)
    return cast(surface if turns else turn(surface), camera.eye, leaning, view)


def random_scene(
    rng: np.random.Generator, *, bent: bool = False
) -> tuple[ResolvedView, Array, float, Camera]:
    """A view of a wall that is tilted by up to 30 degrees, 60 points before it, and a tube's radius.

    `bent`: of a wall that is round, hollow or bulging, on which light falls at 70 degrees at most.
    """
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
        if bent:
            high = view.light_distance_mm + view.wall_distance_mm
            size = rng.uniform(0.6, 3) * high if rng.random() < 0.5 else -rng.uniform(150, 1500)
            view = view.model_copy(update={"wall_radius_mm": float(size)})
            across = cast(points, camera.eye, camera)[:, 0]
            if np.abs(across).max() > 0.9 * abs(size):
                continue
            height -= size - np.sign(size) * np.sqrt(size**2 - across**2)
            ray = np.arctan2(across, high)
            if np.degrees(np.abs(ray - np.arcsin(across / size)).max()) > 70:
                continue
        if height.min() > radius:
            return view, points, radius, camera


def shift_bound_and_truth(
    rng: np.random.Generator, effect: str, *, bent: bool = False
) -> tuple[float, float]:
    """The magnitude of "sag" or "layers" in a random scene, and what moving the surface for real shifts, px.

    The mount lets every point sag by about 0.3 mm its own way; the layers are 0.05 to 0.4 mm high and lie
    in any direction.
    """
    view, points, radius, camera = random_scene(rng, bent=bent)
    surface, px = points[:, None] + radius * directions(60), view.pixel_mm
    was = cast(surface.reshape(-1, 3), camera.eye, camera, view)

    def shift(moves: Array) -> float:
        now = cast((surface + moves).reshape(-1, 3), camera.eye, camera, view)
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


def cast(points: Array, lamp: Array, camera: Camera, view: ResolvedView | None = None) -> Array:
    """(n, 2) shadows of points (n, 3) on the wall, mm in its own axes; on a round one of `view` unrolled.

    A round wall touches the flat one along its up through the frame's middle.
    """
    normal, offset = camera.receiver[:3], camera.receiver[3]
    axes = np.stack([camera.du, -camera.dv])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    if view is None or view.wall_radius_mm is None:
        height, reach = points @ normal + offset, lamp @ normal + offset
        spots = lamp + (points - lamp) * (reach / (reach - height))[:, None]
        return np.asarray(spots @ axes.T)
    radius, frame = view.wall_radius_mm, np.stack([*axes, normal])
    start, way = frame @ (lamp - camera.corner), (points - lamp) @ frame.T
    # a circle about (0, radius), across and before the wall: the last crossing of a hollow wall, the first
    # a column
    from_middle = start[[0, 2]] - [0.0, radius]
    a, b = (way[:, [0, 2]] ** 2).sum(axis=1), way[:, [0, 2]] @ from_middle
    root = np.sqrt(b * b - a * (from_middle @ from_middle - radius**2))
    spots = start + way * ((np.sign(radius) * root - b) / a)[:, None]
    arc = radius * np.arctan2(spots[:, 0] / radius, 1 - spots[:, 2] / radius)
    return np.column_stack([arc, spots[:, 1]])


def parted(was: Array, now: Array) -> float:
    """The largest distance left between shadows (n, 2) by their best shift, scale and turn (Umeyama 1991)."""
    x, y = was - was.mean(axis=0), now - now.mean(axis=0)
    one, other = x @ [1, 1j], y @ [1, 1j]
    return float(np.abs(other - np.vdot(one, other) / np.vdot(one, one) * one).max())
