"""Part and knots belong together, or the check says where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from validator_parts import Array, circle, trefoil, tube

from knotfab_validators.read_knots import Curves
from knotfab_validators.read_mesh import Mesh
from knotfab_validators.tube_fit import check_tube, tube_fit

RADIUS = 3.0
TREFOIL = trefoil(300)
MESH = Mesh(*tube(TREFOIL, RADIUS, 32))


def knots(*polygons: Array, radius: float | None = RADIUS) -> Curves:
    n = len(polygons)
    return Curves(polygons, ("unknot",) * n, (True,) * n, radius)


def test_a_tube_fits_its_own_curve() -> None:
    check = check_tube(MESH, knots(TREFOIL))
    assert check.status == "pass" and check.required
    assert isinstance(check.measured, float) and check.measured < 0.01 * RADIUS


def test_deviation_equals_a_slow_reference() -> None:
    moved = TREFOIL + [0.4, -0.2, 0.7]
    fit = tube_fit(MESH, knots(moved))
    edge = np.roll(moved, -1, axis=0) - moved
    to = MESH.vertices[:, None] - moved
    along = np.clip((to * edge).sum(-1) / (edge * edge).sum(-1), 0, 1)
    distance = np.linalg.norm(to - along[..., None] * edge, axis=-1).min(axis=1)
    assert fit.off * RADIUS == pytest.approx(np.abs(distance - RADIUS).max(), abs=1e-3)


def test_long_edges_are_measured_to_the_segment() -> None:
    square = np.array([[0.0, 0, 0], [60, 0, 0], [60, 60, 0], [0, 60, 0]])
    side = np.linspace(0, 1, 60, endpoint=False)[:, None]
    fine = np.concatenate(
        [a + side * (b - a) for a, b in zip(square, np.roll(square, -1, 0), strict=True)]
    )
    on_edges = tube(fine, RADIUS, 32)[0].reshape(-1, 32, 3)
    middle = on_edges[np.arange(len(fine)) % 60 // 20 == 1].reshape(-1, 3)
    faces = np.arange(len(middle) // 3 * 3).reshape(-1, 3)
    assert tube_fit(Mesh(middle, faces), knots(square)).off < 1e-6


@pytest.mark.parametrize(
    "wrong",
    [
        knots(TREFOIL + [0, 0, 0.2 * RADIUS]),  # moved along the light
        knots(TREFOIL * [1, 1, -1]),  # mirrored in depth: the same shadow
        knots(TREFOIL, radius=1.2 * RADIUS),
        knots(TREFOIL, circle(100, 20.0) + [0, 0, 90]),  # a knot that the part lacks
        knots(TREFOIL * 1e9),
    ],
)
def test_other_knots_are_refused(wrong: Curves) -> None:
    assert check_tube(MESH, wrong).status == "fail"


def test_a_body_that_is_no_tube_is_refused() -> None:
    far = tube(circle(100, 20.0) + [0, 0, 90], RADIUS, 32)
    both = Mesh(
        np.concatenate([MESH.vertices, far[0]]),
        np.concatenate([MESH.faces, far[1] + len(MESH.vertices)]),
    )
    check = check_tube(both, knots(TREFOIL))
    assert check.status == "fail" and "one radius about" in check.detail


def test_a_knot_without_a_tube_is_named_so() -> None:
    check = check_tube(MESH, knots(TREFOIL, circle(100, 20.0) + [0, 0, 90]))
    assert "without a tube" in check.detail


def test_it_is_skipped_without_knots_or_radius() -> None:
    assert check_tube(MESH, None).status == "skipped"
    assert check_tube(MESH, knots(TREFOIL, radius=None)).status == "skipped"
