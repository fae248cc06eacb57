"""A right tube passes every check of its surface; each kind of damage fails the check for it."""

import numpy as np
import pytest
from validator_parts import (
    CIRCLE,
    RADIUS,
    SIDES,
    Array,
    by_name,
    circle,
    curves,
    ring,
    trefoil,
    tube,
    two,
)

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, merge_equal
from knotfab_validators.geometry.surface import overlapping_boxes, tell_heap
from knotfab_validators.mesh import surface_checks as second_opinion
from knotfab_validators.mesh.surface_checks import (
    check_mesh,
    crossing_faces,
    opinions,
    self_intersections,
)


def failures(mesh: Mesh, known: Curves | None = None) -> set[str]:
    return {c.name for c in check_mesh(mesh, known) if c.status == "fail"}


def test_a_right_tube_passes() -> None:
    checks = by_name(check_mesh(ring(), curves(CIRCLE)))
    assert {c.status for c in checks.values()} == {"pass"}
    assert all(c.required for c in checks.values())
    # this is the polygon's area over the circle's
    section = SIDES / (2 * np.pi) * np.sin(2 * np.pi / SIDES)
    assert checks["mesh_volume"].measured == pytest.approx(1 - section, abs=1e-3)
    assert all(not c.at for c in checks.values() if c.name != "mesh_volume")


def test_an_edge_of_three_faces_is_not_closed() -> None:
    mesh = ring()
    twice = np.concatenate([mesh.faces, mesh.faces[:1]])
    assert failures(ring(faces=twice)) >= {"mesh_closed", "mesh_duplicate", "mesh_manifold"}


@pytest.mark.slow
def test_two_bodies_that_overlap_are_found() -> None:
    other = Mesh(ring().vertices[:, [2, 0, 1]] + [0.0, 78.0, 0.0], ring().faces)
    touching = two(ring(), other)
    assert failures(touching) == {"mesh_self_intersection"}
    place = by_name(check_mesh(touching))["mesh_self_intersection"].at[0]
    assert np.linalg.norm(np.array(place) - [0.0, 39.0, 0.0]) < 6.0
    linked = Mesh(other.vertices + [0.0, -38.0, 0.0], other.faces)
    assert failures(two(ring(), linked), curves(CIRCLE, CIRCLE)) == set()


def test_a_tube_that_overlaps_itself_is_found_where_it_does() -> None:
    curve = trefoil(300, 12.0)
    fine = Mesh(*tube(curve, 3.0, 24))
    assert len(self_intersections(fine)) == 0
    thick = Mesh(*tube(curve, 8.0, 24))
    assert failures(thick) == {"mesh_self_intersection"}


def test_nan_and_a_mesh_without_faces_are_refused() -> None:
    vertices = ring().vertices.copy()
    vertices[3, 1] = np.nan
    assert failures(ring(vertices=vertices)) == {"mesh_closed"}
    assert failures(ring(faces=np.empty((0, 3), dtype=np.int64))) == {"mesh_closed"}


@pytest.mark.slow
def test_volumes_are_compared_body_by_body() -> None:
    """One body too thick and one too thin by as much: the sum alone would be right."""
    near, far = circle(120, 40.0), circle(120, 40.0) + [200, 0, 0]
    right = two(Mesh(*tube(near, RADIUS, 96)), Mesh(*tube(far, RADIUS, 96)))
    assert failures(right, curves(far, near)) == set()
    thin, thick = RADIUS * np.sqrt(0.95), RADIUS * np.sqrt(1.05)
    wrong = two(Mesh(*tube(near, thick, 96)), Mesh(*tube(far, thin, 96)))
    assert failures(wrong, curves(near, far)) == {"mesh_volume"}


TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
SIDES_OF_IT = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def solid(scale: float = 1.0, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A tetrahedron about its own middle."""
    return Mesh((TETRAHEDRON - 0.25) * scale + shift, SIDES_OF_IT)


def flip(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def weld(mesh: Mesh) -> Mesh:
    """Weld equal corners into one vertex, as the reading of a file does."""
    return merge_equal(mesh.vertices[mesh.faces])


@pytest.mark.slow
def test_doubled_faces_and_bodies_are_found_by_where_they_lie() -> None:
    mesh = ring()
    other = two(mesh, mesh)  # vertices of its own
    checks = by_name(check_mesh(other))
    assert checks["mesh_duplicate"].measured == len(mesh.faces)
    assert checks["mesh_closed"].status == checks["mesh_manifold"].status == "pass"
    assert failures(weld(other)) >= {"mesh_duplicate", "mesh_manifold"}
    # turned over, as a wall without thickness is
    assert "mesh_duplicate" in failures(weld(two(mesh, flip(mesh))))
    one = np.concatenate([mesh.faces, mesh.faces[[5]][:, [1, 0, 2]]])
    found = by_name(check_mesh(ring(faces=one)))["mesh_duplicate"]
    assert found.measured == 1
    assert found.at == (tuple(mesh.vertices[mesh.faces[5]].mean(axis=0).tolist()),)
    # the least difference makes them two
    near = Mesh(np.nextafter(mesh.vertices, np.inf), mesh.faces)
    assert by_name(check_mesh(two(mesh, near)))["mesh_duplicate"].status == "pass"


def test_edges_of_four_faces_are_told_from_open_ones() -> None:
    back = Mesh(TETRAHEDRON * [1, -1, -1], SIDES_OF_IT)  # shares the edge along x
    checks = by_name(check_mesh(weld(two(Mesh(TETRAHEDRON, SIDES_OF_IT), back))))
    assert checks["mesh_closed"].status == checks["mesh_winding"].status == "pass"
    assert checks["mesh_manifold"].measured == 1 and checks["mesh_manifold"].at == ((0.5, 0, 0),)
    assert checks["mesh_bodies"].status == "skipped"


def test_a_corner_where_two_bodies_touch_is_found() -> None:
    corner, back = Mesh(TETRAHEDRON, SIDES_OF_IT), flip(Mesh(-TETRAHEDRON, SIDES_OF_IT))
    joined = weld(two(corner, back))
    assert len(joined.vertices) == 7
    checks = by_name(check_mesh(joined))
    assert checks["mesh_closed"].status == "pass"
    assert checks["mesh_manifold"].measured == 1 and checks["mesh_manifold"].at == ((0.0, 0, 0),)
    apart = weld(two(corner, Mesh(back.vertices - 1e-9, back.faces)))
    assert failures(apart) == set()


def test_a_wide_fan_is_no_pinch() -> None:
    n = 200
    t = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack([np.cos(t), np.sin(t), np.zeros(n)])
    i = np.arange(n)
    j = (i + 1) % n
    up = np.column_stack([i, j, np.full(n, n)])
    cone = Mesh(
        np.vstack([rim, [[0, 0, 1], [0, 0, -1]]]), np.vstack([up, up[:, [1, 0, 2]] + [0, 0, 1]])
    )
    assert failures(cone) == set()
    pinned = two(cone, Mesh(cone.vertices + [0.0, 0, 2], cone.faces))
    assert failures(weld(pinned)) == {"mesh_manifold"}


def test_bodies_and_genus_inform_where_nothing_is_expected() -> None:
    checks = by_name(check_mesh(two(ring(), solid(1.0, (90.0, 0, 0)))))
    for name, measured in (("mesh_bodies", 2), ("mesh_genus", "1, 0")):
        assert (checks[name].status, checks[name].required) == ("pass", False)
        assert checks[name].measured == measured


def test_expected_bodies_and_genus_decide() -> None:
    both = two(ring(), solid(1.0, (90.0, 0, 0)))
    assert {c.name for c in check_mesh(both, bodies=2, genus=[0, 1]) if c.status == "fail"} == set()
    wrong = by_name(check_mesh(both, bodies=1, genus=[1]))
    assert wrong["mesh_bodies"].status == wrong["mesh_genus"].status == "fail"
    for name in ("mesh_bodies", "mesh_genus"):  # the small one is named
        assert np.linalg.norm(np.array(wrong[name].at[0]) - [90.0, 0, 0]) < 2
    assert by_name(check_mesh(both, bodies=3))["mesh_bodies"].status == "fail"


def open_tube(points: Array, radius: float, balls: bool) -> Mesh:
    """A straight tube along x with flat ends, or with (coarse) half balls."""
    sides, (low, high) = 96, (points[0, 0], points[-1, 0])
    angle = 2 * np.pi * np.arange(sides) / sides
    profile = [(x, radius) for x in np.linspace(low, high, 30)]
    if balls:
        arc = np.pi / 2 * np.arange(1, 48) / 48
        ends = [(np.sin(a) * radius, np.cos(a) * radius) for a in arc]
        profile = [(low - x, r) for x, r in ends[::-1]] + profile + [(high + x, r) for x, r in ends]
        low, high = low - radius, high + radius
    rings = [
        np.column_stack([np.full(sides, x), r * np.cos(angle), r * np.sin(angle)])
        for x, r in profile
    ]
    n = len(rings)
    vertices = np.vstack([*rings, [[low, 0, 0], [high, 0, 0]]])
    i, j = np.arange(n - 1)[:, None] * sides, np.arange(sides)
    k = (j + 1) % sides
    faces = [
        np.stack([i + j, i + sides + k, i + sides + j], -1).reshape(-1, 3),
        np.stack([i + j, i + k, i + sides + k], -1).reshape(-1, 3),
        np.column_stack([k, j, np.full(sides, n * sides)]),
        np.column_stack([(n - 1) * sides + j, (n - 1) * sides + k, np.full(sides, n * sides + 1)]),
    ]
    return Mesh(vertices, np.concatenate(faces))


@pytest.mark.slow
@pytest.mark.parametrize("balls", [False, True])
def test_the_tube_of_an_open_curve_has_no_handle(balls: bool) -> None:
    line = np.column_stack([np.linspace(0, 60, 31), np.zeros((31, 2))])
    known = Curves((line,), ("open",), (False,), RADIUS)
    assert failures(open_tube(line, RADIUS, balls), known) == set()
    assert failures(ring(), known) >= {"mesh_genus"}
    assert failures(open_tube(line, RADIUS * 1.01, balls), known) == {"mesh_volume"}


def test_a_cavity_is_right_in_other_parts_and_wrong_in_a_tube() -> None:
    hollow = two(solid(10.0), flip(solid(2.0)))
    assert failures(hollow) == set()
    assert failures(two(hollow, solid(0.5))) == set()  # a body loose in the cavity
    assert failures(two(solid(10.0), flip(solid(2.0, (30.0, 0, 0))))) == {"mesh_volume"}
    nested = by_name(check_mesh(two(solid(10.0), solid(2.0))))["mesh_volume"]
    assert nested.status == "fail" and np.abs(np.array(nested.at[0])).max() < 1
    tunnel = flip(Mesh(*tube(CIRCLE, RADIUS / 2, SIDES)))
    assert "mesh_volume" in failures(two(ring(), tunnel), curves(CIRCLE, CIRCLE))
    assert failures(two(ring(), tunnel)) == set()


# Faces that cross: both libraries are asked, and where they do not agree it is said.


# Each face is paired with (0, 0, 0), (4, 0, 0), (0, 4, 0), and shares no corner with it.
TOUCHING = {
    "corner on face": [[1, 1, 0], [1, 1, 1], [2, 1, 1]],
    "corner on edge": [[2, 0, 0], [2, 0, 1], [3, 0, 1]],
    "edge along edge": [[1, 0, 0], [3, 0, 0], [2, 0, 1]],
    "in one plane": [[1, 1, 0], [5, 1, 0], [1, 5, 0]],
    "the same": [[0, 0, 0], [4, 0, 0], [0, 4, 0]],
}


FIRST = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize("case", TOUCHING)
def test_exact_touching_counts_for_libigl_alone(case: str) -> None:
    pair = Mesh(
        np.array(FIRST + TOUCHING[case], dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]])
    )
    found = opinions(pair)
    assert found.pairs is not None and found.seen is not None
    assert (found.pairs.tolist(), found.seen.tolist()) == ([[0, 1]], [])
    check = by_name(check_mesh(pair))["mesh_self_intersection"]
    assert check.status == "fail" and "do not agree" in check.detail and len(check.at) == 1
    # the least gap is none
    lifted = Mesh(pair.vertices + np.array([[0, 0, 0]] * 3 + [[0, 0, 1e-9]] * 3), pair.faces)
    if case in ("corner on face", "in one plane", "the same"):
        assert by_name(check_mesh(lifted))["mesh_self_intersection"].status == "pass"


def test_both_libraries_see_what_crosses() -> None:
    sunk = [[1, 1, -1e-9], [1, 1, 1], [2, 1, 1]]
    pair = Mesh(np.array(FIRST + sunk, dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]]))
    found = opinions(pair)
    assert found.pairs is not None and found.seen is not None
    assert (found.pairs.tolist(), found.seen.tolist()) == ([[0, 1]], [0, 1])
    assert "do not agree" not in by_name(check_mesh(pair))["mesh_self_intersection"].detail


# two faces of a stand's base, apart from each other, in its aslant plane
BESIDE = [
    [57.14777374267578, 38.441162109375, 7.15132474899292],
    [197.86212158203125, 62.775794982910156, 4.109495639801025],
    [56.996315002441406, 38.42103958129883, 7.153840065002441],
    [197.20518493652344, 45.61954879760742, 6.254026412963867],
    [168.7625732421875, 27.10506820678711, 8.568336486816406],
    [197.31759643554688, 45.57883834838867, 6.259115219116211],
]


def test_faces_beside_each_other_in_one_plane_do_not_cross() -> None:
    pair = Mesh(np.array(BESIDE), np.array([[0, 1, 2], [3, 4, 5]]))
    assert len(crossing_faces(pair)) == 2  # by the rounding of pymeshlab
    assert by_name(check_mesh(pair))["mesh_self_intersection"].status == "pass"


def test_a_crossing_is_seen_however_it_is_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    sunk = [[1, 1, -0.01], [1, 1, 1], [2, 1, 1]]
    pair = Mesh(np.array(FIRST + sunk, dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]]))
    monkeypatch.setattr(second_opinion, "self_intersections", lambda *a, **k: np.empty((0, 2), int))
    found = opinions(pair)
    assert found.seen is not None and found.seen.tolist() == [0, 1]


def test_a_crossing_that_one_library_alone_sees_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    some = {True: np.array([3, 4]), False: np.array([0, 1])}  # by the mesh, and by them alone
    monkeypatch.setattr(second_opinion, "crossing_faces", lambda mesh: some[len(mesh.faces) > 2])
    check = by_name(check_mesh(ring(), curves(CIRCLE)))["mesh_self_intersection"]
    assert check.status == "fail" and check.measured == 2 and len(check.at) == 2
    assert (
        "0 by libigl, 2 faces that cross others by pymeshlab (the two do not agree)" in check.detail
    )


def test_a_part_is_not_accepted_without_the_second_opinion(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(mesh: Mesh) -> None:
        raise ImportError("libGL.so.1")

    monkeypatch.setattr(second_opinion, "crossing_faces", missing)
    check = by_name(check_mesh(ring()))["mesh_self_intersection"]
    assert check.status == "skipped" and check.required and "libGL" in check.detail


@pytest.mark.slow
def test_a_heap_of_faces_is_refused_without_counting_all_pairs() -> None:
    rng = np.random.default_rng(0)
    heap = Mesh(rng.normal(size=(18000, 3)), np.arange(18000).reshape(-1, 3))
    check = by_name(check_mesh(heap))["mesh_self_intersection"]
    assert check.status == "fail"
    assert (
        "not tested" in check.detail or "at least 1 by libigl, and pymeshlab agrees" in check.detail
    )
    few = Mesh(heap.vertices[:3000], heap.faces[:1000])
    check = by_name(check_mesh(few))["mesh_self_intersection"]
    assert check.status == "fail" and isinstance(check.measured, float) and check.measured > 1000


def test_a_few_long_faces_aslant_do_not_make_a_heap() -> None:
    """Bars across a fine surface: sixteen faces drawn from all once foresaw many times the work."""
    n = 80
    x, y = np.meshgrid(np.linspace(0, 100, n), np.linspace(0, 100, n))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    fine = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n], 1),
            np.stack([corner + 1, corner + n + 1, corner + n], 1),
        ]
    )
    bars = np.array([[[0, 0, -5], [100, 100, 5], [100, 99, 5 + k]] for k in range(40)], dtype=float)
    long = len(vertices) + np.arange(120).reshape(-1, 3)
    mesh = Mesh(np.concatenate([vertices, bars.reshape(-1, 3)]), np.concatenate([fine, long]))
    low, high = (f(mesh.vertices[mesh.faces], axis=1) for f in (np.min, np.max))
    exact = sum(
        int(((low[k + 1 :] <= high[k]) & (high[k + 1 :] >= low[k])).all(axis=1).sum())
        for k in range(0, len(mesh.faces), 7)
    )
    exact *= 7
    assert overlapping_boxes(mesh) == pytest.approx(exact, rel=0.35)


@pytest.mark.parametrize(("apart_mm", "heap"), [(1e-6, True), (1e-4, True), (2.0, False)])
def test_faces_that_lie_on_each_other_are_told_before_any_library_is_asked(
    apart_mm: float, heap: bool
) -> None:
    count = 20_000  # pymeshlab's grid would take gigabytes
    triangle = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])
    corners = triangle + apart_mm * np.arange(count)[:, None, None] * [0.0, 0, 1]
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    said = tell_heap(mesh)
    assert (said is not None and "20000 faces lie on each other" in said) == heap
