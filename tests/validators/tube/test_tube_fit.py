"""Part and knots belong together, or the check says where they do not."""

from collections.abc import Callable

import numpy as np
import pytest
from knot_curves import figure_eight, ring, rotate, torus_knot
from tables import some
from thickness_oracle import KINDS, Polygons, enumerate_chords, place
from validator_parts import Array, circle, trefoil, tube

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, merge_equal
from knotfab_validators.geometry.surface import circle_functions
from knotfab_validators.knots.knot_types import knot_types
from knotfab_validators.part_checks import part_checks
from knotfab_validators.tube import critical_chords
from knotfab_validators.tube.centre_line import check_centre_lines, find_centre_line
from knotfab_validators.tube.thickness import _find_turning, thickness
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


# Centre lines found from the mesh alone: of tubes as other programs sweep them, and of what is
# none.


Array_centre_line = np.ndarray
SIZE = 20.0  # mm to the knots' own unit


def by_trimesh(points: Array_centre_line, radius: float) -> Mesh:
    import trimesh
    from shapely.geometry import Point

    path = np.concatenate([points, points[:1]])
    swept = trimesh.creation.sweep_polygon(Point(0, 0).buffer(radius, quad_segs=4), path)
    return merge_equal(np.asarray(swept.triangles))


def by_pyvista(points: Array_centre_line, radius: float) -> Mesh:
    import pyvista

    line = pyvista.lines_from_points(points, close=True).strip(join=True)
    swept = line.tube(radius=radius, n_sides=14, capping=False).triangulate()
    return merge_equal(np.asarray(swept.points)[swept.regular_faces])


def found(mesh: Mesh) -> Curves:
    check, curves = check_centre_lines(mesh)
    assert check.status == "pass" and curves is not None, check
    assert not check.required and "found from the mesh" in check.detail
    return curves


def named(curves: Curves) -> list[str]:
    return [knot.sentence for knot in knot_types(curves).knots]


KNOTS = {
    "left-handed 3_1": (torus_knot(2, 3, 90), 0.45),
    "left-handed 5_1": (torus_knot(2, 5, 130), 0.3),
    "left-handed 8_19": (torus_knot(3, 4, 130), 0.3),
    "4_1": (figure_eight(130), 0.25),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sweep"),
    some([(name, sweep) for name in KNOTS for sweep in (by_trimesh, by_pyvista)], 3),
)
def test_a_swept_knot_is_found_with_its_type_and_thickness(
    name: str, sweep: Callable[[Array_centre_line, float], Mesh]
) -> None:
    points, radius = KNOTS[name]
    points, radius = SIZE * rotate(points, 1), SIZE * radius
    curves = found(sweep(points, radius))
    assert named(curves) == [f"{name}, proved"]
    assert curves.radius_mm == pytest.approx(radius, rel=0.03)
    there = thickness((points,), (True,)).value
    assert thickness(curves.polygons, curves.closed).value == pytest.approx(there, rel=0.03)
    assert curves.length_mm == pytest.approx(
        Curves((points,), ("",), (True,), 1.0).length_mm, rel=0.01
    )


def test_noise_and_the_order_of_vertices_do_not_matter() -> None:
    points, radius = SIZE * torus_knot(2, 3, 120), 0.4 * SIZE
    plain = Mesh(*tube(points, radius, 16))
    rng = np.random.default_rng(2)
    order = rng.permutation(len(plain.vertices))
    place = np.argsort(order)
    vertices = plain.vertices + rng.normal(0, 0.03 * radius, plain.vertices.shape)
    mesh = Mesh(vertices[order], place[plain.faces][rng.permutation(len(plain.faces))])
    curves = found(mesh)
    assert named(curves) == ["left-handed 3_1, proved"]
    assert curves.radius_mm == pytest.approx(radius, rel=0.03)
    there = thickness((points,), (True,)).value
    assert thickness(curves.polygons, curves.closed).value == pytest.approx(there, rel=0.05)


@pytest.mark.slow
def test_a_decimated_tube_is_found() -> None:
    from igl import decimate

    points, radius = SIZE * torus_knot(2, 3, 150), 0.4 * SIZE
    plain = Mesh(*tube(points, radius, 24))
    few = decimate(plain.vertices, plain.faces, 3000)
    curves = found(Mesh(np.asarray(few[0]), np.asarray(few[1], dtype=np.int64)))
    assert named(curves) == ["left-handed 3_1, proved"]
    assert curves.radius_mm == pytest.approx(radius, rel=0.05)
    there = thickness((points,), (True,)).value
    assert thickness(curves.polygons, curves.closed).value == pytest.approx(there, rel=0.05)


def rosette(
    radius: float, step: float, lobes: int = 7, outwards: float = 170.0
) -> Array_centre_line:
    """Arcs of one radius, by turns to the left and to the right, as in knots that bend as they may."""
    left, right = np.radians(outwards), np.radians(outwards - 360.0 / lobes)
    bends = [np.repeat(s, round(turn * radius / step)) for s, turn in ((1, left), (-1, right))]
    turns = [b * t / len(b) for b, t in zip(bends, (left, right), strict=True)]
    heading = np.cumsum(np.tile(np.concatenate(turns), lobes))
    edges = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    return np.asarray(radius * right / len(turns[1]) * np.cumsum(edges, axis=0))


def test_bends_that_set_in_at_once_keep_their_radius() -> None:
    """Cut off, the short waves of such a line make its other bends a quarter tighter."""
    points = rosette(12.3, 4.4)
    curves = found(Mesh(*tube(points, 10.0, 32)))
    assert curves.radius_mm == pytest.approx(10.0, rel=0.01)
    there = thickness((points,), (True,))
    assert there.bend_decides
    assert thickness(curves.polygons, curves.closed).value == pytest.approx(there.value, rel=0.1)


def test_a_tube_of_varying_radius_has_a_line_and_no_radius() -> None:
    points = SIZE * torus_knot(2, 3, 200)
    vertices, faces = tube(points, 1.0, 16)
    along = np.repeat(np.arange(200), 16) * (2 * np.pi / 200)
    radius = SIZE * (0.35 + 0.12 * np.sin(4 * along))[:, None]
    centre = np.repeat(points, 16, axis=0)
    check, curves = check_centre_lines(Mesh(centre + radius * (vertices - centre), faces))
    assert check.status == "pass" and curves is not None and curves.radius_mm is None
    low, high = (float(w) for w in check.detail.split("radii ")[1].split(" mm")[0].split(" to "))
    assert low == pytest.approx(0.23 * SIZE, rel=0.06)  # but for a twentieth at either end
    assert high == pytest.approx(0.47 * SIZE, rel=0.06)
    assert named(curves) == ["left-handed 3_1, proved"]


@pytest.mark.slow
def test_several_tubes_are_told_apart_and_linked_as_they_are() -> None:
    one = tube(SIZE * torus_knot(2, 3, 120), 6.0, 12)
    far = tube(SIZE * ring(60, 2.0) + [0.0, 0.0, 90.0], 6.0, 12)
    hung = tube(SIZE * ring(60, 2.0)[:, [2, 0, 1]] + [30.0, 30.0, 90.0], 6.0, 12)
    curves = found(merge_equal(np.concatenate([v[f] for v, f in (one, far, hung)])))
    types = knot_types(curves)
    assert [k.sentence for k in types.knots] == ["left-handed 3_1, proved"] + ["unknot, proved"] * 2
    assert [(i, j, abs(n)) for i, j, n in types.linking.numbers] == [(1, 2, 1)]


def test_a_fat_ring_is_told_from_the_hole_in_it() -> None:
    """Round its hole a ring of R < sqrt(2) r is shorter than round the tube."""
    line = find_centre_line(Mesh(*tube(20.0 * ring(80), 17.0, 40)))
    assert line is not None and line.rms < 0.02
    assert np.hypot(*line.points[:, :2].T) == pytest.approx(20.0, rel=0.02)
    assert line.radii == pytest.approx(17.0, rel=0.02)


def ball() -> Mesh:
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=2, radius=10.0)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces, dtype=np.int64))


def cube() -> Mesh:
    import trimesh

    made = trimesh.creation.box((10.0, 10.0, 10.0))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces, dtype=np.int64))


def blocks(filled: object) -> Mesh:
    from tests.corpus.parts import blocks as cells

    shape = np.shape(filled)
    body = cells(np.asarray(filled, dtype=bool), *([4.0 * k for k in range(n + 1)] for n in shape))
    return Mesh(body.vertices, body.faces)


def open_tube() -> Mesh:
    import pyvista

    straight = pyvista.Line((0, 0, 0), (50, 0, 0), resolution=20).tube(radius=4.0, n_sides=12)
    swept = straight.triangulate().clean()
    points = np.asarray(swept.points, dtype=np.float64)
    return Mesh(points, np.asarray(swept.regular_faces, dtype=np.int64))


def flattened() -> Mesh:
    """A swept ring pressed into a plane: closed, of genus 1, and without any volume."""
    mesh = tube(ring(40, 15.0), 3.0)
    return Mesh(mesh[0] * [1.0, 1.0, 0.0], mesh[1])


EIGHT = np.ones((5, 3, 1))
EIGHT[1, 1] = EIGHT[3, 1] = 0
PLATE = np.ones((9, 9, 1))
PLATE[4, 4] = 0
NO_TUBES = {
    "ball": (ball, "genus 0"), "cube": (cube, "genus 0"), "two holes": (lambda: blocks(EIGHT), "genus 2"),
    "open tube": (open_tube, "genus 0"), "flattened": (flattened, "without a line within"),
    "plate with a hole": (lambda: blocks(PLATE), "off one radius"),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_TUBES)
def test_what_is_no_tube_is_said_to_be_none(name: str) -> None:
    make, reason = NO_TUBES[name]
    mesh = make()
    check, curves = check_centre_lines(mesh)
    assert check.status == "fail" and not check.required and curves is None
    assert "no closed tube" in check.detail and reason in check.detail
    checks = {c.name: c for c in part_checks(mesh, None, None, {})}
    assert (
        checks["knot_type"].status == "skipped" and "no closed tube" in checks["knot_type"].detail
    )


def test_a_surface_with_a_hole_in_it_is_no_tube() -> None:
    vertices, faces = tube(20.0 * ring(40), 5.0, 10)
    check, curves = check_centre_lines(Mesh(vertices, faces[2:]))
    assert check.status == "fail" and curves is None
    assert "open surface" in check.detail


def test_a_bulge_shows_in_the_residual() -> None:
    vertices, faces = tube(20.0 * ring(80), 5.0, 16)
    vertices[16] += 0.4 * (vertices[16] - 20.0 * ring(80)[1])
    check, _ = check_centre_lines(Mesh(vertices, faces))
    line = find_centre_line(Mesh(vertices, faces))
    assert check.status == "pass" and line is not None
    assert line.worst == pytest.approx(0.4, abs=0.05)
    assert line.at == pytest.approx(vertices[16])


def test_circle_functions_go_once_round() -> None:
    """Harmonic functions on a tube: one goes once along it, the other once round it."""
    points = SIZE * torus_knot(2, 3, 90)
    mesh = Mesh(*tube(points, 5.0, 12))
    along, round_it = circle_functions(mesh)
    for function, step in ((along, 12), (round_it, 1)):
        loop = np.arange(90) * 12 if step == 12 else np.arange(12)
        turn = np.diff(np.append(function.phase[loop], function.phase[loop[0]]))
        assert abs(((turn + 0.5) % 1.0 - 0.5).sum()) == pytest.approx(1.0)
    # the two rises of a face and the third close up: the phases at its corners say so
    first, second, third = along.phase[mesh.faces].T
    assert (first + along.rise[:, 0] - second + 0.5) % 1.0 == pytest.approx(0.5, abs=1e-9)
    assert (first + along.rise[:, 1] - third + 0.5) % 1.0 == pytest.approx(0.5, abs=1e-9)


@pytest.mark.slow
def test_a_foreign_tube_is_measured_like_any_other() -> None:
    points, radius = SIZE * torus_knot(2, 3, 90), 0.4 * SIZE
    checks = {c.name: c for c in part_checks(Mesh(*tube(points, radius, 12)), None, None, {})}
    assert checks["centre_line"].status == "pass"
    assert checks["knot_type"].measured == "left-handed 3_1, proved"
    assert checks["thickness"].limit == pytest.approx(radius, rel=0.04)
    assert checks["clearance"].measured > 0
    assert "are nearest" in checks["clearance"].detail
    assert checks["feature"].status == "pass"
    assert not any(checks[n].required for n in ("thickness", "knot_type", "linking", "clearance"))


# Thickness of thousands of small polygons of many kinds against plain enumeration.


def drawn(kind: str, seed: int) -> tuple[Polygons, list[bool]] | None:
    rng = np.random.default_rng([seed, *kind.encode()])
    polygons = place(KINDS[kind](rng), rng)
    edges = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1) for p in polygons]
    if min(float(e.min()) for e in edges) == 0:
        return None  # vertices that coincide are refused by the reader
    return polygons, [bool(rng.random() < 0.8) for _ in polygons]


def enumerated(polygons: Polygons, closed: list[bool]) -> float:
    """The thickness by enumeration: vertices at which nothing turns are no ends of edges for MinRad."""
    bare = [p[_find_turning(p, c)] for p, c in zip(polygons, closed, strict=True)]
    bent = [(p, c) for p, c in zip(bare, closed, strict=True) if len(p) > 2]
    min_rad = enumerate_chords(*zip(*bent, strict=True)).min_rad if bent else np.inf
    return float(min(min_rad, enumerate_chords(polygons, closed).half_dcsd))


def agrees(polygons: Polygons, closed: list[bool]) -> bool:
    """To 1e-9 of the value, and to what single coordinates of doubles are wrong by."""
    expected, found = enumerated(polygons, closed), thickness(polygons, closed).value
    size = max(float(np.ptp(p, axis=0).max()) for p in polygons)
    return found == expected or abs(found - expected) <= 1e-9 * expected + 1e-15 * size


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("each", some([40, 150], 2))
@pytest.mark.study
def test_as_enumerated(kind: str, each: int) -> None:
    cases = [(seed, drawn(kind, seed)) for seed in range(each)]
    assert sum(case is not None for _, case in cases) > each / 4
    assert [s for s, case in cases if case is not None and not agrees(*case)] == []


def longer(kind: str, seed: int) -> Polygons:
    """A few hundred vertices, so that arcs of several levels are paired."""
    rng = np.random.default_rng(seed)
    n = 320
    s = 2 * np.pi * np.arange(n)[:, None] / n * np.arange(1, 7)
    waves = rng.normal(size=(2, 6, 3)) / np.arange(1, 7)[:, None] ** 1.3
    if kind == "smooth":
        return [np.cos(s) @ waves[0] + np.sin(s) @ waves[1]]
    if kind == "walk":
        return [rng.normal(size=(n, 3)).cumsum(axis=0)]
    if kind == "jagged":
        return [rng.normal(size=(n, 3))]
    if kind == "lattice":
        steps = np.eye(3)[rng.integers(0, 3, n // 2)] * rng.choice([-1, 1], (n // 2, 1))
        path = np.cumsum(np.concatenate([steps, -rng.permutation(steps)]), axis=0)
        keep = np.linalg.norm(np.roll(path, -1, axis=0) - path, axis=1) > 0
        return [path[keep]]
    k = np.arange(n)
    rods = np.stack([(k // 2 + k) % 2 * 30.0, k // 2 % 13 * 1.0, k // 26 * 1.1], axis=1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return [rods @ turn]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["smooth", "walk", "jagged", "lattice", "rods"])
@pytest.mark.parametrize("blocks", [False, True])
@pytest.mark.parametrize("seed", some(range(2), 2))
def test_longer_polygons(
    kind: str, blocks: bool, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search goes through the tree of arcs to its leaves, and through blocks of edges paired at once."""
    monkeypatch.setattr(critical_chords, "TOP_ARCS", 4)
    monkeypatch.setattr(critical_chords, "BLOCK_LEVEL", 3)
    monkeypatch.setattr(critical_chords, "MANY_PAIRS", 0 if blocks else 10**9)
    monkeypatch.setattr(critical_chords, "PAIRS_AT_ONCE", 1000 if blocks else 150_000)
    polygons = longer(kind, seed)
    expected = enumerate_chords(polygons, [True])
    assert thickness(polygons).value == pytest.approx(expected.value, rel=1e-9, abs=1e-14)
    chord = critical_chords.shortest_critical_chord(polygons, [True])
    assert chord is not None
    assert chord.length / 2 == pytest.approx(expected.half_dcsd, rel=1e-9, abs=1e-14)
    assert np.linalg.norm(chord.points[1] - chord.points[0]) == pytest.approx(
        chord.length, abs=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("each", some([12, 40], 2))
def test_the_tolerance_costs_no_more_than_itself(
    each: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tolerance of 1e-3, a million times the real one, leaves nothing more than 1e-3 off."""
    monkeypatch.setattr(critical_chords, "ANGLE_TOLERANCE", 1e-3)
    for kind in KINDS:
        for seed in range(each):
            case = drawn(kind, seed)
            if case is None or not all(case[1]):
                continue
            expected, found = enumerated(*case), thickness(*case).value
            size = max(float(np.ptp(p, axis=0).max()) for p in case[0])
            assert found <= expected * (1 + 1e-9) + 1e-15 * size, (kind, seed)
            assert found >= expected * (1 - 1e-3) - 1e-15 * size, (kind, seed)


def test_a_longer_chord_than_asked_for_is_not_returned() -> None:
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    assert critical_chords.shortest_critical_chord([square], [True], up_to=1.99) is None
    found = critical_chords.shortest_critical_chord([square], [True], up_to=2.0)
    assert found is not None and found.length == 2.0
