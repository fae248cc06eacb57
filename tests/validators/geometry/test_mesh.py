"""Meshes: joining corners, numbering bodies, what they enclose."""

from __future__ import annotations

import numpy as np
import pytest
from solids import box, inward, together

from knotfab_validators.geometry.mesh import (
    Mesh,
    enclosed_volume,
    merge_equal,
    number_bodies,
    surface_distance,
    winding_numbers,
)


def test_only_exactly_equal_corners_are_joined() -> None:
    a = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    b = a + [0, 0, 1e-12]
    assert len(merge_equal(np.stack([a, a, -0.0 * a + a])).vertices) == 3
    assert len(merge_equal(np.stack([a, b])).vertices) == 6
    signed = merge_equal(np.stack([a, np.where(a == 0, -0.0, a)]))
    assert len(signed.vertices) == 3


def two_boxes() -> Mesh:
    """The larger box's faces first; the other has the smaller coordinates."""
    return together(box((5, 0, 0), (7, 3, 4)), box((0, 0, 0), (1, 1, 1)))


def test_bodies_are_numbered_in_the_order_of_their_first_faces() -> None:
    mesh = two_boxes()
    spare = Mesh(np.vstack([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1)
    label, count = number_bodies(spare)
    assert count == 2 and label[0] == -1
    assert (label[1:] == (mesh.vertices[:, 0] < 2)).all()


def test_what_a_mesh_encloses() -> None:
    mesh = two_boxes()
    assert enclosed_volume(mesh) == pytest.approx(24 + 1)
    assert enclosed_volume(Mesh(mesh.vertices, mesh.faces[:, ::-1])) == pytest.approx(-25)


def test_a_mesh_without_faces_or_with_nan_is_not_usable() -> None:
    mesh = two_boxes()
    assert mesh.usable and not Mesh(mesh.vertices, mesh.faces[:0]).usable
    assert not Mesh(np.where(mesh.vertices == 7, np.nan, mesh.vertices), mesh.faces).usable


# Points lie inside or outside of closed and open surfaces.


BLOCK = together(box((0, 0, 0), (10, 10, 10)), inward(box((3, 3, 3), (7, 7, 7))))
POINTS = np.array([[1.0, 5, 5], [5, 5, 5], [-2, 5, 5]])


@pytest.mark.parametrize("exact", [True, False])
def test_a_hollow_is_outside(exact: bool) -> None:
    winding = winding_numbers(POINTS, BLOCK, exact=exact)
    assert winding == pytest.approx([1, 0, 0], abs=1e-9 if exact else 0.01)
    assert winding_numbers(POINTS[:0], BLOCK, exact=exact).shape == (0,)


def test_distance_is_that_of_the_nearest_face() -> None:
    assert surface_distance(POINTS, BLOCK) == pytest.approx([1, 2, 2])
