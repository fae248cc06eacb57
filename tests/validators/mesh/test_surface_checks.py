"""A right tube passes every check of its surface; each kind of damage fails the check for it."""

import numpy as np
import pytest
from damaged_rings import CIRCLE, RADIUS, SIDES, by_name, curves, ring, two
from validator_parts import Array, circle, trefoil, tube

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, merge_equal
from knotfab_validators.mesh.surface_checks import check_mesh, self_intersections


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
