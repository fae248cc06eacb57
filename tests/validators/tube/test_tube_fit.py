"""Part and knots belong together, or the check says where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from validator_parts import Array, circle, trefoil, tube

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.tube_fit import check_tube, tube_fit

RADIUS = 3.0
POINTS, SIDES = 150, 24
LENGTH = 20.0  # length of the straight tube
TREFOIL = trefoil(POINTS)
MESH = Mesh(*tube(TREFOIL, RADIUS, SIDES))


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
    ends = np.stack([MESH.faces, np.roll(MESH.faces, 1, axis=1)], axis=-1).reshape(-1, 2)
    middles = MESH.vertices[ends[ends[:, 0] < ends[:, 1]]].mean(axis=1)  # where faces dip most
    places = np.concatenate([MESH.vertices, middles])
    to = places[:, None] - moved
    along = np.clip((to * edge).sum(-1) / (edge * edge).sum(-1), 0, 1)
    distance = np.linalg.norm(to - along[..., None] * edge, axis=-1).min(axis=1)
    slow = np.abs(distance - RADIUS)
    assert fit.off * RADIUS == pytest.approx(slow.max(), rel=1e-3)
    there = np.linalg.norm(places - fit.off_at[0], axis=1).argmin()
    assert slow[there] > slow.max() - 1e-3


def straight(n: int, length: float = LENGTH) -> tuple[Array, Mesh]:
    """An open curve along x of n points, and a tube about it of one long face a side, flat ends."""
    line = np.column_stack([np.linspace(0, length, n), np.zeros((n, 2))])
    angle = 2 * np.pi * np.arange(96) / 96
    ring = RADIUS * np.column_stack([np.zeros(96), np.cos(angle), np.sin(angle)])
    i = np.arange(96)
    k = (i + 1) % 96
    vertices = np.vstack([ring, ring + [length, 0, 0], [[0.0, 0, 0], [length, 0, 0]]])
    faces = np.concatenate(
        [
            np.column_stack([i, k + 96, i + 96]),
            np.column_stack([i, k, k + 96]),
            np.column_stack([k, i, np.full(96, 192)]),
            np.column_stack([i + 96, k + 96, np.full(96, 193)]),
        ]
    )
    return line, Mesh(vertices, faces)


@pytest.mark.slow
@pytest.mark.parametrize("points", [2, 3, 27])
@pytest.mark.study
def test_open_curves_may_have_flat_ends_and_long_faces(points: int) -> None:
    line, mesh = straight(points)
    curve = Curves((line,), ("open",), (False,), RADIUS)
    fit = tube_fit(mesh, curve)
    assert max(fit.off, fit.bare) < 1.1 * (1 - np.cos(np.pi / 96)) + 1e-9
    assert check_tube(mesh, curve).status == "pass"
    # an end that is pulled in, or out, by 5 % of the radius
    for shift, status in ((0.039, "pass"), (0.041, "fail"), (-0.041, "fail")):
        moved = mesh.vertices.copy()
        moved[moved[:, 0] > LENGTH / 2, 0] += shift * RADIUS
        assert check_tube(Mesh(moved, mesh.faces), curve).status == status


def test_round_ends_pass() -> None:
    line, mesh = straight(14)
    arc = np.linspace(0, np.pi / 2, 20)[1:-1]
    cap = [LENGTH + RADIUS * np.sin(arc), RADIUS * np.cos(arc)]
    cloud = np.column_stack([cap[0], cap[1], np.zeros(18)])
    ball = Mesh(
        np.vstack([mesh.vertices[:-1], cloud, [[LENGTH + RADIUS, 0, 0]]]),
        np.vstack([mesh.faces[:-96], [[193, 194, 195], [211, 210, 209]]]),
    )
    curve = Curves((line,), ("open",), (False,), RADIUS)
    assert tube_fit(ball, curve).off < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        knots(TREFOIL + [0, 0, 0.2 * RADIUS]),  # moved along the light
        knots(TREFOIL * [1, 1, -1]),  # mirrored in depth: the same shadow
        knots(TREFOIL, radius=1.2 * RADIUS),
        knots(TREFOIL * 1e9),
    ],
)
def test_other_knots_are_refused(wrong: Curves) -> None:
    assert check_tube(MESH, wrong).status == "fail"


def test_a_body_that_is_no_tube_is_refused() -> None:
    far = tube(circle(100, 20.0) + [0, 0, 90], RADIUS, SIDES)
    both = Mesh(
        np.concatenate([MESH.vertices, far[0]]),
        np.concatenate([MESH.faces, far[1] + len(MESH.vertices)]),
    )
    check = check_tube(both, knots(TREFOIL))
    assert check.status == "fail" and "one radius about" in check.detail


def test_a_knot_without_a_tube_is_named_so() -> None:
    check = check_tube(MESH, knots(TREFOIL, circle(100, 20.0) + [0, 0, 90]))
    assert "exact tube about the knots has a place" in check.detail
    assert len(check.at) > 1 and all(60 < z < 120 for _, _, z in check.at)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1, -1])
def test_the_limit_is_four_percent_of_the_radius(sign: int) -> None:
    line, mesh = straight(34)
    curve = Curves((line,), ("open",), (False,), RADIUS)
    for off, status in ((0.0398, "pass"), (0.04, "pass"), (0.0402, "fail")):
        moved = mesh.vertices.copy()
        moved[10, 1:] *= 1 + sign * off  # in the middle of no face, on the rim of the end
        moved[10 + 96, 1:] *= 1 + sign * off
        if sign > 0:  # what stands out
            check = check_tube(Mesh(moved, mesh.faces), curve)
            assert check.status == status
            assert check.measured == pytest.approx(off * RADIUS, rel=1e-3)
    for off, status in ((0.039, "pass"), (0.041, "fail")):
        whole = Mesh(*tube(circle(120), RADIUS * (1 + off * sign), 96))
        assert check_tube(whole, knots(circle(120))).status == status


@pytest.mark.slow
def test_a_flat_side_between_right_vertices_is_found() -> None:
    """Six sides: every vertex is right, and the middles of the faces are 13 % too deep."""
    six = Mesh(*tube(TREFOIL, RADIUS, 6))
    fit = tube_fit(six, knots(TREFOIL))
    assert fit.off == pytest.approx(1 - np.cos(np.pi / 6), abs=0.02)
    assert check_tube(six, knots(TREFOIL)).status == "fail"
    assert check_tube(Mesh(*tube(TREFOIL, RADIUS, 12)), knots(TREFOIL)).status == "pass"


def test_a_strand_that_is_missing_is_found_where_it_is() -> None:
    faces = MESH.faces.reshape(2, POINTS, SIDES, 3)[:, np.r_[0:70, 75:POINTS]].reshape(-1, 3)
    check = check_tube(Mesh(MESH.vertices, faces), knots(TREFOIL))
    assert check.status == "fail" and "has a place" in check.detail
    assert np.linalg.norm(TREFOIL[70:75] - check.at[0], axis=1).min() < 1.1 * RADIUS


def test_a_window_in_the_tube_is_found() -> None:
    faces = MESH.faces.reshape(2, POINTS, SIDES, 3)
    kept = np.ones((POINTS, SIDES), dtype=bool)
    kept[25:27, 2:9] = False  # about 1.6 radii square
    check = check_tube(Mesh(MESH.vertices, faces[:, kept].reshape(-1, 3)), knots(TREFOIL))
    assert check.status == "fail"
    assert np.linalg.norm(TREFOIL[24:28] - check.at[0], axis=1).min() < 1.5 * RADIUS


def test_it_is_skipped_without_knots_or_radius() -> None:
    assert check_tube(MESH, None).status == "skipped"
    assert check_tube(MESH, knots(TREFOIL, radius=None)).status == "skipped"


def test_a_mitre_is_no_bump_but_a_bump_there_is_one() -> None:
    """The mitre stands out 3.5 % where edges meet at 30 degrees: a twelfth of a circle, 12 edges."""
    n, sides = 12, 64
    t = 2 * np.pi * np.arange(n) / n
    corners = 40 * np.column_stack([np.cos(t), np.sin(t), np.zeros(n)])
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=1)[:, None]
    angle = 2 * np.pi * np.arange(sides) / sides
    outwards = np.column_stack([np.cos(t), np.sin(t), np.zeros(n)])
    wide = RADIUS / np.cos(np.pi / n)  # in the bisecting plane the section is an ellipse
    ring = corners[:, None] + wide * np.cos(angle)[:, None] * outwards[:, None]
    ring = ring + RADIUS * np.sin(angle)[:, None] * np.array([0.0, 0, 1])
    _, faces = tube(circle(n), RADIUS, sides)
    corner = Mesh(ring.reshape(-1, 3), faces)
    fit = tube_fit(corner, knots(corners))
    assert fit.off < 2 * (1 - np.cos(np.pi / sides)) and 1 / np.cos(np.pi / n) - 1 > 0.03
    bumped = corner.vertices.copy()
    bumped[0] += 0.1 * RADIUS * outwards[0]
    check = check_tube(Mesh(bumped, faces), knots(corners))
    assert check.status == "fail" and check.at[0] == pytest.approx(tuple(bumped[0]))


def test_a_mounted_part_must_show_the_tube_itself() -> None:
    """What is thicker holds the exact tube everywhere, and is no tube of that radius."""
    thick = Mesh(*tube(TREFOIL, 1.1 * RADIUS, SIDES))
    found = check_tube(thick, knots(TREFOIL), mounted=True)
    assert found.status == "fail" and found.measured == pytest.approx(0.1 * RADIUS, rel=0.2)
    assert check_tube(MESH, knots(TREFOIL), mounted=True).status == "pass"


@pytest.mark.parametrize(("radii", "status"), [(1.0, "pass"), (8.0, "fail")])
def test_a_swelling_as_long_as_a_peg_is_wide_may_be_a_mount(radii: float, status: str) -> None:
    middle = np.repeat(TREFOIL, SIDES, axis=0)
    near = np.linalg.norm(middle - TREFOIL[30], axis=1) < radii * RADIUS
    out = 0.3 * (MESH.vertices - middle) * near[:, None]
    swollen = Mesh(MESH.vertices + out, MESH.faces)
    assert check_tube(swollen, knots(TREFOIL)).status == "fail"
    assert check_tube(swollen, knots(TREFOIL), mounted=True).status == status


def test_the_radius_is_that_of_the_scene() -> None:
    assert check_tube(MESH, knots(TREFOIL), asked_mm=RADIUS * (1 + 1e-9)).status == "pass"
    other = check_tube(MESH, knots(TREFOIL), asked_mm=RADIUS * 1.001)
    assert other.status == "fail" and other.required and "tube_radius_mm" in other.detail
