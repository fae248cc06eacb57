"""The tube: exact area times length, closed, outwards, for every closed polyline it accepts."""

import contextlib
from math import pi

import numpy as np
import pymeshlab
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from validator_parts import trefoil

from benchmarks.hard.pictures import circle
from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.geometry.tube import (
    _transport,
    as_manifold,
    carry_torus,
    mesh_volume,
    place_rings,
    reach_mm,
    sides_for,
    sweep,
    thin_line,
)
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.surface_checks import self_intersections


def wiggle(n: int, seed: int = 0, amplitude: float = 0.3) -> Array:
    """A smooth closed random curve of about 50 mm radius, sampled at n points."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    p = 50 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    for k in range(2, 5):
        for wave in (np.cos, np.sin):
            p += wave(k * t)[:, None] * rng.normal(size=3) * 50 * amplitude / k**2
    return p


def length(p: Array) -> float:
    return float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum())


def edges_are_matched(faces: NDArray[np.int32]) -> bool:
    """Every directed edge once, and its reverse once: closed and consistently turned."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(int)
    size = directed.max() + 1
    ahead, back = directed @ [size, 1], directed @ [1, size]
    return len(np.unique(ahead)) == len(ahead) and np.array_equal(np.sort(ahead), np.sort(back))


def genus(vertices: Array, faces: NDArray[np.int32]) -> int:
    """Count the genus by another library, which finds a mesh empty where it is not closed."""
    solid = as_manifold((vertices, faces))
    assert solid.num_tri() == len(faces)
    return int(solid.genus())


@pytest.mark.parametrize("sides", [3, 7, 16, 48])
@pytest.mark.parametrize("seed", range(3))
def test_volume_is_that_of_the_round_tube(sides: int, seed: int) -> None:
    p = wiggle(400, seed)
    vertices, faces = sweep(p, 1.5, sides)
    assert vertices.shape == (400 * sides, 3) and vertices.dtype == np.float64
    assert faces.shape == (800 * sides, 3) and faces.dtype == np.int32
    wanted = np.pi * 1.5**2 * length(p)
    # What is missing is the rest of the twist, spread over 400 rings.
    assert mesh_volume(vertices, faces) == pytest.approx(wanted, rel=3e-6 if sides > 3 else 1e-5)
    assert edges_are_matched(faces)
    assert genus(vertices, faces) == 1


@pytest.mark.parametrize("within", [0.002, 0.02, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_thinner_line_passes_near_every_vertex_and_its_tube_has_the_same_volume(
    within: float, seed: int
) -> None:
    p, radius = wiggle(801, seed), 1.5
    kept = thin_line(p, radius, within)
    assert (np.diff(kept) > 0).all() and len(kept) < len(p)
    start, end = p[kept], np.roll(p[kept], -1, axis=0)
    for a, b, first, last in zip(start, end, kept, [*kept[1:], kept[0] + len(p)], strict=True):
        between = p[np.arange(first, last + 1) % len(p)] - a
        share = np.clip(between @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        assert np.linalg.norm(between - share[:, None] * (b - a), axis=1).max() <= within + 1e-12
    vertices, faces = sweep(p, radius, 20, within)
    assert len(vertices) == 20 * len(kept) and genus(vertices, faces) == 1
    # what is missing is the rest of the twist, spread over fewer rings
    near = 1e-5 if within < 0.1 else 2e-4
    assert mesh_volume(vertices, faces) == pytest.approx(np.pi * radius**2 * length(p), rel=near)


def test_a_line_keeps_its_vertices_where_it_bends_tightly() -> None:
    bend = np.linspace(0, np.pi, 40)
    leg = np.linspace(0, 40, 41)[1:-1]
    turn = 2.4 * np.column_stack([np.cos(bend), np.sin(bend), 0 * bend])
    left = np.column_stack([-2.4 + 0 * leg, -leg, 0 * leg])
    p = np.concatenate([turn, left, turn * [-1, -1, 1] - [0, 40, 0], (left * [-1, 1, 1])[::-1]])
    kept = set(thin_line(p, 2.0, 0.02).tolist())
    assert set(range(2, 38)) <= kept and len(kept) < len(p) - 40  # the legs are straight
    sweep(p, 2.0, 20, 0.02)  # and folds no more than the whole line
    for few in (3, 4, 5, 6):
        assert len(thin_line(circle(few, 9.0), 2.0, 99.0)) >= 3


@settings(max_examples=6)
@given(seed=st.integers(0, 2**31), count=st.integers(40, 400), sides=st.integers(4, 64))
def test_up_to_its_bending_limit_a_tube_has_its_volume_or_is_refused(
    seed: int, count: int, sides: int
) -> None:
    rng = np.random.default_rng(seed)
    p = wiggle(count, seed, amplitude=float(rng.uniform(0.1, 3.0)))
    bend = float(bend_radii(p, polylines_of_sizes((count,))).min())
    radius = min(bend, 50.0) * float(rng.uniform(0.5, 1.05))
    with contextlib.suppress(SceneError):
        vertices, faces = sweep(p, radius, sides)
        exact = np.pi * radius**2 * length(p)
        assert mesh_volume(vertices, faces) == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("corners", [3, 4, 5, 12])
def test_planar_polygon_has_exact_volume(corners: int) -> None:
    """A planar curve needs no closing twist, so nothing is lost, however coarse it is."""
    t = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    p = np.stack([40 * np.cos(t), 0 * t, 40 * np.sin(t)], axis=1) + np.array([5.0, -7.0, 300.0])
    for points in (p, p[::-1]):
        vertices, faces = sweep(points, 3.0, 24)
        assert mesh_volume(vertices, faces) == pytest.approx(np.pi * 9 * length(p), rel=1e-12)


def test_corners_lie_on_the_ring_around_both_segments() -> None:
    p = trefoil(300)
    rings, _ = place_rings(p, 1.0, 12)
    step = 2 * np.pi / 12
    # the segment that starts at the ring's vertex, and the one that ends there
    for shift in (0, 1):
        along = np.roll(p, shift - 1, axis=0) - np.roll(p, shift, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        distance = np.linalg.norm(np.cross(rings - p[:, None], along[:, None]), axis=2)
        assert distance == pytest.approx(np.sqrt(step / np.sin(step)), rel=1e-9)


def zigzag(corners: int) -> Array:
    """A closed curve of few corners, far from plane."""
    t = 2 * np.pi * np.arange(corners) / corners
    return 50 * np.stack([np.cos(t), np.sin(t), 0.8 * np.cos(2 * t + 0.3)], axis=1)


@pytest.mark.parametrize(
    ("points", "sides"),
    [(wiggle(400, 2), 48), (trefoil(61), 9), (wiggle(60, 2), 256), (zigzag(5), 3)]
    + [(zigzag(corners), sides) for corners in (4, 7, 11) for sides in (8, 48, 255)],
)
def test_the_tube_of_manifold3d_has_each_corner_on_its_ring_and_no_other(
    points: Array, sides: int
) -> None:
    rings, offset = place_rings(points, 1.0, sides)
    vertices, faces = sweep(points, 1.0, sides)
    away, nearest = cKDTree(vertices).query(rings.reshape(-1, 3))
    assert away.max() <= 1e-9 and len(set(nearest)) == rings.size // 3
    # the edges along the tube are those of the rings, across the seam as well
    ends = np.concatenate([rings[1:], np.roll(rings[:1], -offset, axis=1)])
    tangent = (ends - rings) / np.linalg.norm(ends - rings, axis=2)[..., None]
    others = np.setdiff1d(np.arange(len(vertices)), nearest)
    if len(others):  # rings between those of the corners lie on these edges
        gap = vertices[others, None] - rings.reshape(-1, 3)
        along = tangent.reshape(-1, 3)
        off = gap - np.einsum("ijk,jk->ij", gap, along)[..., None] * along
        assert np.linalg.norm(off, axis=2).min(axis=1).max() <= 1e-9
    assert len(vertices) == rings.size // 3 or len(points) < sides
    assert edges_are_matched(faces) and genus(vertices, faces) == 1
    exact = pytest.approx(np.pi * length(points), rel=2e-3 if len(points) < 50 else 1e-5)
    assert mesh_volume(vertices, faces) == exact


def test_a_carried_torus_that_is_no_tube_is_refused() -> None:
    """manifold3d itself says NoError of one turned inside out, and of one of no numbers at all."""
    p = wiggle(60)
    rings, offset = place_rings(p, 1.0, 12)
    volume = np.pi * length(p)
    carry_torus(rings, offset, volume)
    for wrong in (rings[:, ::-1], rings[::-1], rings * np.nan, np.where(rings > 52, np.inf, rings)):
        with pytest.raises(RuntimeError, match="manifold3d's tube is none"):
            carry_torus(wrong, 0, volume)


@pytest.mark.parametrize(("points", "sides"), [(wiggle(40, 3), 16), (trefoil(60), 9)])
def test_corners_reach_as_far_as_is_said_and_no_further(points: Array, sides: int) -> None:
    rings = place_rings(points, 1.0, sides)[0] - points[:, None]
    reach = reach_mm(points, 1.0, sides)
    # the worst mitre's reach only where a corner happens to lie in the plane of the bend
    assert 0.98 * reach < np.linalg.norm(rings, axis=2).max() <= reach * (1 + 1e-12)


def test_straight_stretches_and_every_axis() -> None:
    side = np.linspace(0, 30, 11)[:-1]
    zero = np.zeros(10)
    square = np.concatenate(
        [np.stack(s, axis=1) for s in ((side, zero), (zero + 30, side), (30 - side, zero + 30))]
        + [np.stack([zero, 30 - side], axis=1)]
    )
    for plane in ((0, 1), (1, 2), (2, 0)):
        p = np.zeros((40, 3))
        p[:, plane] = square
        vertices, faces = sweep(p, 1.0, 16)
        assert mesh_volume(vertices, faces) == pytest.approx(np.pi * 120, rel=1e-12)
        assert np.ptp(vertices[:, 3 - sum(plane)]) == pytest.approx(2.0, abs=0.03)


@pytest.mark.parametrize("writhe", np.linspace(0.0, 1.2, 13))
def test_closing_twist_of_any_angle(writhe: float) -> None:
    """Torus windings whose frames close with all angles, half a turn among them."""
    t = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    p = np.stack([50 * np.cos(t), 50 * np.sin(t), 0 * t], axis=1)
    p += (
        15
        * writhe
        * np.stack([np.cos(3 * t) * np.cos(t), np.cos(3 * t) * np.sin(t), np.sin(3 * t)], axis=1)
    )
    vertices, faces = sweep(p, 1.0, 6)
    assert mesh_volume(vertices, faces) == pytest.approx(np.pi * length(p), rel=1e-5)
    rings, _ = place_rings(p, 1.0, 6)
    # No corner line is longer than the straight mitred one by more than a twist of half a corner.
    spread = np.linalg.norm(rings[1:] - rings[:-1], axis=2)
    assert spread.max() < 2.0 * np.linalg.norm(np.diff(p, axis=0), axis=1).max()
    assert genus(vertices, faces) == 1


def test_too_tight_a_bend_is_refused_and_placed() -> None:
    p = wiggle(400)
    p[100] += [0.0, 0.0, 5.0]
    with pytest.raises(SceneError, match=r"vertex (99|100|101) .*bends to a radius of") as caught:
        sweep(p, 1.5, 16)
    assert caught.value.exit_code == 1


def test_bend_limit_is_min_rad() -> None:
    """A regular polygon's MinRad is its inscribed radius: just below it passes, above it folds."""
    t = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    p = np.stack([10 * np.cos(t), 10 * np.sin(t), 0 * t], axis=1)
    limit = 10 * np.cos(np.pi / 60)
    assert genus(*sweep(p, 0.998 * limit, 128)) == 1
    for radius in (limit * (1 + 1e-9), 1.1 * limit):
        with pytest.raises(SceneError, match="bends to a radius of"):
            sweep(p, radius, 128)
    # a coarse ring has corners that reach further
    with pytest.raises(SceneError, match="cross near"):
        sweep(p, 0.9 * limit, 3)


def test_fold_back_and_coincident_vertices_are_refused() -> None:
    back = np.array([[0, 0, 0], [10, 0, 0], [20, 0, 0], [10, 0, 0.0]])
    with pytest.raises(SceneError, match="bends to a radius of 0 mm"):
        sweep(back, 0.1, 8)
    twice = wiggle(50)
    twice[11] = twice[10]
    with pytest.raises(SceneError, match="vertices 10 and 11 coincide"):
        sweep(twice, 0.1, 8)


@pytest.mark.parametrize(
    ("points", "radius", "sides"),
    [
        (np.zeros((2, 3)), 1.0, 8), (np.zeros((5, 2)), 1.0, 8), (np.full((5, 3), np.nan), 1.0, 8),
        (wiggle(30), 0.0, 8), (wiggle(30), np.nan, 8), (wiggle(30), 1.0, 2),
    ],
)  # fmt: skip
def test_what_is_no_polyline_is_refused(points: Array, radius: float, sides: int) -> None:
    with pytest.raises(ValueError):
        sweep(points, radius, sides)


@pytest.mark.parametrize("tolerance", [0.2, 0.02, 0.002])
def test_sides_keep_the_outline_within_the_tolerance(tolerance: float) -> None:
    sides = sides_for(3.0, tolerance, least=4)
    assert sides % 2 == 0
    step = 2 * np.pi / sides
    corner = 3.0 * np.sqrt(step / np.sin(step))
    assert max(corner - 3.0, 3.0 - corner * np.cos(step / 2)) <= 1.1 * tolerance
    assert sides_for(3.0, 0.0) == 256


# their outlines alone take seconds


def _wave(height: float) -> tuple[np.ndarray, float]:
    """A closed curve that winds about a ring, and the angle by which its frame comes back turned."""
    s = 2 * pi * np.arange(300) / 300
    out, up = 10 + height * np.cos(3 * s), height * np.sin(3 * s)
    points = np.stack([out * np.cos(s), out * np.sin(s), up], 1)
    along = np.roll(points, -1, 0) - points
    along /= np.linalg.norm(along, axis=1)[:, None]
    mitre = along + np.roll(along, 1, 0)
    mitre /= np.linalg.norm(mitre, axis=1)[:, None]
    return points, _transport(along, mitre)[1]


def test_a_closing_twist_of_half_a_turn_closes() -> None:
    """A frame that comes back turned by exactly pi: both ways round are as short."""
    heights = np.linspace(0.0, 6.0, 120)
    turns = np.array([_wave(h)[1] for h in heights])
    jump = int(np.abs(np.diff(turns)).argmax())
    assert abs(turns[jump + 1] - turns[jump]) > pi
    low, high = heights[jump], heights[jump + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.sign(_wave(middle)[1]) == np.sign(turns[jump]):
            low = middle
        else:
            high = middle
    for height in (low, high):
        points, turn = _wave(height)
        assert abs(turn) == pytest.approx(pi, abs=1e-9)
        length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
        for sides in (3, 5, 64):
            vertices, faces = sweep(points, 0.3, sides)
            exact = pytest.approx(pi * 0.09 * length, rel=2e-5 if sides == 3 else 1e-5)
            assert mesh_volume(vertices, faces) == exact


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scaled_tubes_are_the_same_tube(scale: float) -> None:
    points = circle(200, 10.0)
    plain, faces = sweep(points, 1.0, 24)
    scaled, same = sweep(points * scale, scale, 24)
    assert np.array_equal(faces, same)
    assert np.abs(scaled / scale - plain).max() <= 1e-9


@pytest.mark.slow
def test_a_hundred_thousand_corners_are_swept() -> None:
    points = circle(100_000, 1000.0)
    vertices, faces = sweep(points, 1.0, 4)
    length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
    assert mesh_volume(vertices, faces) == pytest.approx(pi * length, rel=1e-9)


def _count_selected(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Faces that pymeshlab finds to intersect others."""
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.apply_filter("compute_selection_by_self_intersections_per_face")
    return int(meshes.current_mesh().selected_face_number())


@pytest.mark.parametrize(("size", "clear"), [(12.0, True), (4.0, False)])
def test_self_intersection_agrees_with_pymeshlab(size: float, clear: bool) -> None:
    vertices, faces = sweep(trefoil(300, size), 3.0, 24)
    ours = len(self_intersections(Mesh(vertices, faces.astype(np.int64))))
    assert (ours == 0) == clear
    assert (_count_selected(vertices, faces) == 0) == clear
