"""Light found by brute force, against what the effects `contrast` and `wall` say of it."""

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, OnWall, Shadows, World
from knotfab.effects.contrast import contrast_of
from knotfab.effects.shifts import WALL
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.piece import Material
from knotfab_formats.views import Room
from tests.oracles.parting import directions, random_scene

_RAYS = 6000  # from a place on the wall
_FEW = 400
_POINTS = 400  # points of a curve
_FEET = 60  # places behind strands that are looked at with few rays
_WORST = 4  # the worst of these, with all
_GRID = 301  # places across and up a frame


def uneven_and_truth(rng: np.random.Generator) -> tuple[float, float]:
    """What is missing of even light in a random scene, as it is claimed, and on a dense grid of places."""
    view, points, radius, camera = random_scene(rng)
    shape = ("disc", "ball")[rng.integers(2)]
    view = view.model_copy(update={"light_shape": shape})
    found = contrast_of(Shadows.of(view, points), radius, World())
    assert found is not None
    camera = camera.resized(_GRID, _GRID)
    u, v = np.meshgrid(np.arange(_GRID), np.arange(_GRID))
    at = camera.corner + u[..., None] * camera.du + v[..., None] * camera.dv
    ray = camera.eye - at
    far = np.linalg.norm(ray, axis=-1)
    light = (ray @ camera.receiver[:3]) / far**3
    if shape == "disc":
        light = light * (ray @ view_axes(view)[2]) / far
    return 1 - found.falloff, float(1 - light.min() / light.max())


def bounce_and_truth(rng: np.random.Generator) -> tuple[float, float]:
    """What white strands throw back onto their own shadow, as it is claimed, and by rays from the wall."""
    view, _, radius, _ = random_scene(rng)
    harmonics = np.arange(1, 5)[:, None] * 2 * np.pi * np.arange(_POINTS) / _POINTS
    phases, sizes = rng.uniform(0, 2 * np.pi, (3, 4)), rng.normal(size=(3, 4))
    waves = np.cos(harmonics + phases[:, :, None])  # a closed curve as even as a search has it
    points = (sizes[:, :, None] * waves).sum(axis=1).T
    room = min(0.3 * view.light_distance_mm, 0.5 * view.wall_distance_mm)
    points *= np.array([60, 60, 0.5 * room]) / np.abs(points).max(axis=0)
    wall = OnWall.of(view)
    while wall.place(points)[:, 2].min() < 2 * radius:
        points *= 0.9
    world = World(room=Room(reflectance=0.5), material=Material(color="#ffffff"))
    found = contrast_of(Shadows.of(view, points), radius, world)
    assert found is not None
    start = wall.place(points)
    along = np.roll(start, -1, axis=0) - start
    # places lie all across the shadow of a strand
    behind = start[:: _POINTS // _FEET] + radius * directions(_POINTS)[:: _POINTS // _FEET]
    feet = np.column_stack([wall.cast(behind), np.zeros(len(behind))])
    filled = [_filled(foot, _FEW, start, along, radius) for foot in feet]
    worst = feet[np.argsort(filled)[-_WORST:]]
    return found.bounced, 0.5 * max(_filled(foot, _RAYS, start, along, radius) for foot in worst)


def _filled(foot: Array, count: int, start: Array, along: Array, radius: float) -> float:
    """What strands fill of the light from the sky at a place, by rays to where they are in it.

    Over the unit disc under the sky rays stand evenly, as many towards each part as its cosine (Malley).
    """
    to = start - foot
    far = np.linalg.norm(to, axis=1)[:, None]
    seen, reach = to[:, :2] / far, np.minimum(2 * radius / far, 2.0)
    low, high = (seen - reach).min(axis=0), (seen + reach).max(axis=0)
    k = np.arange(count)[:, None] + 0.5
    at = low + (high - low) * (k / [count, (1 + np.sqrt(5)) / 2] % 1)
    up = 1 - (at**2).sum(axis=1)
    way = np.column_stack([at, np.sqrt(np.maximum(up, 0))])[up > 0]
    hit = _meets(foot, way, start, along, radius).sum()
    return float(hit / count * np.prod(high - low) / np.pi)


def _meets(foot: Array, way: Array, start: Array, along: Array, radius: float) -> NDArray[np.bool_]:
    """(m,) whether rays from a place along unit vectors (m, 3) come within `radius` of segments (n, 3)."""
    off = start - foot  # nearest points of two lines, the second one kept to its ends
    wa, wo = way @ along.T, way @ off.T
    aa, ao = (along**2).sum(axis=1), (along * off).sum(axis=1)
    share = np.clip((wa * wo - ao) / np.maximum(aa - wa**2, 1e-12), 0, 1)
    square = (off**2).sum(axis=1) + 2 * share * ao + share**2 * aa - (wo + share * wa) ** 2
    hit: NDArray[np.bool_] = ((square < radius**2) & (wo + share * wa > 0)).any(axis=1)
    return hit


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
