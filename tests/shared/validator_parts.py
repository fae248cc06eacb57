"""Curves, tubes, regions and scenes made on the spot for the tests of the validators."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from knotfab_formats.verdict import MESH, Check
from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.render import why_no_rendering
from knotfab_validators.shadows.view import ViewGeometry, view_geometry


@dataclass(frozen=True)
class PlainView:
    """The keys of a scene's view that its geometry needs, with conventions.md's defaults."""

    frame_width_mm: float = 180.0
    frame_height_mm: float = 180.0
    light_distance_mm: float = 500.0
    wall_distance_mm: float = 100.0
    wall_tilt_deg: float = 0.0
    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0
    frame_up_mm: float = 0.0
    light_right_mm: float = 0.0
    light_up_mm: float = 0.0


def circle(n: int = 200, radius: float = 40.0) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(t), np.sin(t), np.zeros(n)])


def trefoil(n: int = 300, scale: float = 18.0) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    return scale * np.column_stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]
    )


def tangle(n: int = 400, seed: int = 0, size: float = 60.0) -> Array:
    """A random smooth closed curve that fits a cube of side 2 `size`; it may come near itself."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    points = np.zeros((n, 3))
    for k in range(1, 7):
        a, b = rng.normal(size=(2, 3)) / k
        points += np.cos(k * t)[:, None] * a + np.sin(k * t)[:, None] * b
    points -= (points.max(axis=0) + points.min(axis=0)) / 2
    return points / np.abs(points).max(axis=0) * size


def tube(points: Array, radius: float, sides: int = 48) -> tuple[Array, NDArray[np.int64]]:
    """A closed tube of mesh rings across the curve: vertices (n, 3), faces (m, 3), outwards."""
    n = len(points)
    tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    u = np.zeros_like(points)
    first = np.cross(tangent[0], [0.3, 0.5, 0.8])
    u[0] = first / np.linalg.norm(first)
    for i in range(1, n):
        v = u[i - 1] - tangent[i] * (u[i - 1] @ tangent[i])
        u[i] = v / np.linalg.norm(v)
    last = u[-1] - tangent[0] * (u[-1] @ tangent[0])
    twist = np.arctan2(np.cross(last, u[0]) @ tangent[0], last @ u[0]) * np.arange(n) / n
    w = np.cross(tangent, u)
    a = np.cos(twist)[:, None] * u + np.sin(twist)[:, None] * w
    b = np.cross(tangent, a)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[:, None] * a[:, None] + np.sin(angle)[:, None] * b[:, None]
    vertices = (points[:, None] + radius * ring).reshape(-1, 3)
    i, j = np.arange(n)[:, None], np.arange(sides)[None]
    here, there = i * sides, (i + 1) % n * sides
    after = (j + 1) % sides
    p, q, r, s = here + j, there + j, there + after, here + after
    faces = np.concatenate([np.stack([p, r, q], -1), np.stack([p, s, r], -1)]).reshape(-1, 3)
    return vertices, faces


def hairpin(bend: float, leg: float = 20.0, n: int = 24) -> Array:
    """A closed path of two legs 2 `bend` apart, a tight turn at one end and a wide loop at the other."""
    t = np.linspace(-np.pi / 2, np.pi / 2, n + 1)
    turn = bend * np.column_stack([np.cos(t), np.sin(t), 0 * t]) + [leg, 0, 0]
    wide = 4 * bend
    u = np.linspace(0, 2 * np.pi, 6 * n)[1:-1]
    # opens from the legs' ends as a raised cosine, and comes back behind
    there = np.column_stack([-wide * (1 - np.cos(u)), bend * np.cos(u / 2), 0 * u])
    there[:, 1] += 2.5 * wide * np.sin(u) * (1 - np.cos(u)) / 4
    x = np.arange(0, leg, 1.0)
    lower = np.column_stack([x, -bend + 0 * x, 0 * x])
    upper = np.column_stack([x[::-1], bend + 0 * x, 0 * x])
    return np.concatenate([lower, turn, upper, there])


RADIUS, SIDES = 4.0, 48
CIRCLE = circle(90)


def ring(**changes: Array | Ints) -> Mesh:
    vertices, faces = tube(CIRCLE, RADIUS, SIDES)
    return Mesh(**{"vertices": vertices, "faces": faces, **changes})  # type: ignore[arg-type]


def two(first: Mesh, second: Mesh) -> Mesh:
    return Mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
    )


def curves(*polygons: Array, radius: float | None = RADIUS) -> Curves:
    n = len(polygons)
    return Curves(polygons, ("unknot",) * n, (True,) * n, radius)


def by_name(checks: list[Check]) -> dict[str, Check]:
    assert tuple(c.name for c in checks) == MESH
    return {c.name: c for c in checks}


CURVE = circle(360, 40.0)  # in the plane z = 0
KNOT = Curves((CURVE,), ("unknot",), (True,), 3.0)


def prism(*outline: tuple[float, float], low: float = -30.0, high: float = 30.0) -> Mesh:
    """What stands over a polygon that is a star about its first corner, from z `low` to `high`."""
    n = len(outline)
    flat = np.array(outline)
    vertices = np.vstack([np.c_[flat, np.full(n, low)], np.c_[flat, np.full(n, high)]])
    i = np.arange(n)
    j = (i + 1) % n
    caps = np.array([[0, k, k + 1] for k in range(1, n - 1)])
    sides = np.concatenate([np.c_[i, j, j + n], np.c_[i, j + n, i + n]])
    return Mesh(vertices, np.concatenate([caps[:, ::-1], caps + n, sides]))


def box_mesh(size: tuple[float, float, float]) -> Mesh:
    x, y, z = (s / 2 for s in size)
    return prism((-x, -y), (x, -y), (x, y), (-x, y), low=-z, high=z)


needs_rendering = pytest.mark.skipif(
    why_no_rendering() is not None, reason=f"no rendering here: {why_no_rendering()}"
)
PIXELS = 240  # pixels of a frame of 120 mm, on a wall 100 mm behind; the light is 500 mm before the piece


def geometry() -> ViewGeometry:
    return view_geometry(PlainView(frame_width_mm=120.0, frame_height_mm=120.0), PIXELS, PIXELS)
