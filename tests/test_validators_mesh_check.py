"""A right tube passes every check of its surface; each kind of damage fails the check for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from validator_parts import Array, circle, trefoil, tube

from knotfab_validators.check import Check
from knotfab_validators.mesh_check import check_mesh, self_intersections, survey
from knotfab_validators.read_knots import Curves
from knotfab_validators.read_mesh import Mesh

RADIUS, SIDES = 4.0, 48
CIRCLE = circle(120)
Faces = NDArray[np.int64]


def ring(**changes: Array | Faces) -> Mesh:
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
    assert len({c.name for c in checks}) == len(checks) == 7
    return {c.name: c for c in checks}


def failures(mesh: Mesh, known: Curves | None = None) -> set[str]:
    return {c.name for c in check_mesh(mesh, known) if c.status == "fail"}


def test_a_right_tube_passes() -> None:
    checks = by_name(check_mesh(ring(), curves(CIRCLE)))
    assert {c.status for c in checks.values()} == {"pass"}
    assert all(c.required for c in checks.values())
    section = SIDES / (2 * np.pi) * np.sin(2 * np.pi / SIDES)  # of the polygon, of the circle
    assert checks["mesh_volume"].measured == pytest.approx(1 - section, abs=1e-3)


def test_survey_finds_genus_and_volume_of_each_body() -> None:
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    ball = Mesh(
        np.concatenate([axes, -axes]) + 100,
        np.array(
            [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
        ),
    )
    found = survey(two(ring(), ball))
    assert found.open_edges == found.flipped_edges == 0
    assert found.genus.tolist() == [1, 0]
    assert found.volumes_mm3[1] == pytest.approx(4 / 3)
    assert np.bincount(found.body).tolist() == [len(ring().faces), 8]


def test_a_hole_is_found_with_its_place() -> None:
    mesh = ring()
    checks = by_name(check_mesh(ring(faces=mesh.faces[1:])))
    assert checks["mesh_closed"].status == "fail" and checks["mesh_closed"].measured == 3
    assert "the first at" in checks["mesh_closed"].detail
    assert checks["mesh_volume"].status == "skipped"


def test_an_edge_of_three_faces_is_not_closed() -> None:
    mesh = ring()
    twice = np.concatenate([mesh.faces, mesh.faces[:1]])
    assert "mesh_closed" in failures(ring(faces=twice))


def test_a_face_wound_the_wrong_way_is_found() -> None:
    faces = ring().faces.copy()
    faces[7] = faces[7, ::-1]
    checks = by_name(check_mesh(ring(faces=faces)))
    assert checks["mesh_closed"].status == "pass"
    assert checks["mesh_winding"].status == "fail" and checks["mesh_winding"].measured == 3


def test_a_mesh_inside_out_has_no_positive_volume() -> None:
    mesh = ring()
    assert failures(ring(faces=mesh.faces[:, ::-1])) == {"mesh_volume"}
    # a large right body does not hide a small wrong one
    small = Mesh(mesh.vertices / 50, mesh.faces[:, ::-1])
    assert failures(two(mesh, small)) == {"mesh_volume"}


@pytest.mark.parametrize(("factor", "status"), [(1.0, "pass"), (1.004, "fail"), (0.996, "fail")])
def test_the_volume_is_that_of_the_tube(factor: float, status: str) -> None:
    # the polygon's section lacks 0.3 % of the circle's: a factor makes up for it, then errs by 0.8 %
    fair = np.sqrt(2 * np.pi / SIDES / np.sin(2 * np.pi / SIDES))
    vertices, faces = tube(CIRCLE, RADIUS * fair * factor, SIDES)
    checks = by_name(check_mesh(Mesh(vertices, faces), curves(CIRCLE)))
    assert checks["mesh_volume"].status == status


def test_another_number_of_bodies_than_knots_is_found() -> None:
    assert "mesh_bodies" in failures(ring(), curves(CIRCLE, CIRCLE + 200))
    far = Mesh(ring().vertices + 200, ring().faces)
    assert failures(two(ring(), far), curves(CIRCLE, CIRCLE + 200)) == set()


def test_a_body_that_is_no_tube_is_found() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    solid = Mesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    checks = by_name(check_mesh(solid))
    assert checks["mesh_genus"].status == "fail" and checks["mesh_genus"].measured == 0


def test_a_face_without_area_is_found() -> None:
    vertices = ring().vertices.copy()
    faces = ring().faces
    vertices[faces[0, 0]] = vertices[faces[0, 1]]
    checks = by_name(check_mesh(ring(vertices=vertices)))
    assert checks["mesh_degenerate"].status == "fail"
    assert checks["mesh_self_intersection"].status == "skipped"


def test_two_bodies_that_overlap_are_found() -> None:
    other = Mesh(ring().vertices[:, [2, 0, 1]] + [0.0, 78.0, 0.0], ring().faces)
    touching = two(ring(), other)
    assert failures(touching) == {"mesh_self_intersection"}
    linked = Mesh(other.vertices + [0.0, -38.0, 0.0], other.faces)
    assert failures(two(ring(), linked), curves(CIRCLE, CIRCLE)) == set()


def test_a_tube_that_overlaps_itself_is_found_where_it_does() -> None:
    curve = trefoil(300, 12.0)
    fine = Mesh(*tube(curve, 3.0, 24))
    assert len(self_intersections(fine)) == 0
    thick = Mesh(*tube(curve, 8.0, 24))
    assert failures(thick) == {"mesh_self_intersection"}


def test_numbers_that_are_none_are_refused() -> None:
    vertices = ring().vertices.copy()
    vertices[3, 1] = np.nan
    assert failures(ring(vertices=vertices)) == {"mesh_closed"}
    assert failures(ring(faces=np.empty((0, 3), dtype=np.int64))) == {"mesh_closed"}


def test_volumes_are_compared_body_by_body() -> None:
    """One body too thick and one too thin by as much: the sum alone would be right."""
    near, far = circle(120, 40.0), circle(120, 40.0) + [200, 0, 0]
    right = two(Mesh(*tube(near, RADIUS, 96)), Mesh(*tube(far, RADIUS, 96)))
    assert failures(right, curves(far, near)) == set()
    thin, thick = RADIUS * np.sqrt(0.95), RADIUS * np.sqrt(1.05)
    wrong = two(Mesh(*tube(near, thick, 96)), Mesh(*tube(far, thin, 96)))
    assert failures(wrong, curves(near, far)) == {"mesh_volume"}
