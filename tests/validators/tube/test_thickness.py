"""Polygonal thickness against exact values, against a plain oracle, and against the limits."""

import numpy as np
import pytest
from knot_curves import curves
from tables import some
from validator_parts import circle, hairpin, trefoil, tube

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.triangles import triangle_triangle, triangles_cross
from knotfab_validators.tube import clearance, critical_chords
from knotfab_validators.tube import thickness as strand_pairs_module
from knotfab_validators.tube.clearance import check_clearance, nearest_bodies, strand_gap
from knotfab_validators.tube.critical_chords import shortest_critical_chord
from knotfab_validators.tube.thickness import (
    Thickness,
    check_length,
    check_thickness,
    sample_curves,
    strand_pairs,
    thickness,
)
from tests.corpus.curves import ThicknessRow, thickness_rows, torus_knot


def ngon(n: int, radius: float = 1.0, axes: tuple[int, int] = (0, 1)) -> Array:
    angle = 2 * np.pi * np.arange(n) / n
    points = np.zeros((n, 3))
    points[:, axes[0]], points[:, axes[1]] = radius * np.cos(angle), radius * np.sin(angle)
    return points


def turn(points: Array, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return points @ q.T + rng.normal(size=3) * 30


def move(points: Array, x: float, y: float, z: float) -> Array:
    return points + np.array([x, y, z])


def stadium(straight: float, radius: float, n: int) -> Array:
    """Two half circles of n edges, joined by one long edge each."""
    angle = np.pi * np.arange(n + 1) / n - np.pi / 2
    half = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    shift = np.array([straight / 2, 0, 0])
    return np.concatenate([half + shift, -half - shift])


def dcsd(*polygons: Array, closed: bool = True) -> float:
    """Half the shortest doubly critical chord, also where a bend decides."""
    chord = shortest_critical_chord(polygons, [closed] * len(polygons))
    assert chord is not None
    return chord.length / 2


# --- values that are known ------------------------------------------------------------------


def test_every_polygon_has_its_exact_thickness() -> None:
    rows = thickness_rows()
    assert len(rows) > 20
    assert [row for row in rows if not row.holds] == []
    assert not ThicknessRow("off by a millionth", 3, 1.0, 1.000001).holds
    assert not ThicknessRow("not a number", 3, 1.0, float("nan")).holds


def test_the_right_angles_of_a_square_and_of_a_slit() -> None:
    square = thickness([np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])])
    assert (square.value, square.min_rad) == pytest.approx((1, 1), rel=1e-12)
    slit = turn(np.array([[0.0, 0, 0], [50, 0, 0], [50, 2, 0], [0, 2, 0]]))
    assert dcsd(slit) == pytest.approx(1, rel=1e-9)
    assert thickness([slit]).value == pytest.approx(1, rel=1e-9)


def test_parallel_strands_at_an_exact_gap() -> None:
    x = np.linspace(0, 100, 201)
    rest = np.column_stack([[100.0, 0], [-60.0, -60.0], [0.0, 0]])
    one = np.concatenate([np.column_stack([x, 0 * x, 0 * x]), rest])
    other = one * [1, -1, 1] + [0.17, 3.0, 0]  # shifted along: no vertices face each other
    found = thickness([turn(one), turn(other)])
    assert found.min_rad == pytest.approx(30.0) and found.value == pytest.approx(1.5, rel=1e-9)
    assert dcsd(turn(one), turn(other)) == pytest.approx(1.5, rel=1e-9)
    chord = shortest_critical_chord([one, other], [True, True])
    assert chord is not None
    assert {end[0] for end in chord.ends} == {0, 1}


def test_where_it_is() -> None:
    x = np.linspace(0, 100, 101)
    strand = np.column_stack([x, 0 * x, 0 * x])
    across = strand[:, [1, 0, 2]] + [30.25, -50, 4]
    found = thickness([strand, across], [False, False])
    assert found.value == pytest.approx(2.0)
    assert not found.bend_decides
    assert found.point == pytest.approx((30.25, 0, 2))
    assert found.dcsd_at is not None
    one, other = sorted(found.dcsd_at)
    assert one == pytest.approx((0, 30, 0.25)) and other[0] == 1
    assert other[1] + other[2] == pytest.approx(50)


def test_open_ends() -> None:
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    straight = thickness([line], [False])
    assert straight.value == np.inf and straight.dcsd_at is None and straight.min_rad_at is None
    facing = thickness([line, move(line, 5, 0, 0)], [False, False])  # end to end, 3 apart
    assert facing.half_dcsd == pytest.approx(1.5)
    aside = thickness([line, move(line, 0, 3, 0)], [False, False])
    assert aside.half_dcsd == pytest.approx(1.5)
    hook = np.array([[0.0, 0, 0], [10, 0, 0], [10, 6, 0], [5, 6, 0]])  # its end above an edge
    assert dcsd(hook, closed=False) == pytest.approx(3.0)


@pytest.mark.slow
@pytest.mark.study
def test_vertices_on_a_straight_line_are_no_ends_of_edges() -> None:
    """The same curve has the same thickness, however its edges are cut; rounding makes no bend."""
    curve = turn(ngon(31, 10.0))
    ahead = np.roll(curve, -1, axis=0)
    cut = np.concatenate([curve, (2 * curve + ahead) / 3, (curve + ahead) / 2], axis=1).reshape(
        -1, 3
    )
    for same in (cut, np.round(cut, 6)):
        assert thickness([same]).value == pytest.approx(thickness([curve]).value, rel=1e-5)
    found = thickness([cut]).min_rad_at
    assert found is not None and found[1] % 3 == 0
    arc = np.linspace(0, np.pi, 350_000)  # each vertex turns by less than rounding
    bow = np.column_stack([np.cos(arc), np.sin(arc), 0 * arc])
    assert 0.5 < thickness([bow], [False]).min_rad < 1.001
    bent = cut.copy()
    bent[1] += 1e-3 * np.cross(bent[2] - bent[0], [1.0, 2.0, 3.0])
    assert thickness([bent]).value < 0.6 * thickness([curve]).value


def test_degenerate_polygons_have_no_thickness() -> None:
    crossing = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    assert thickness([crossing]).value == pytest.approx(0, abs=1e-12)
    back = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 2, 0]])
    assert thickness([back]).value == pytest.approx(0, abs=1e-12)
    twice = np.array([[0.0, 0, 0], [2, 0, 0], [2, 0, 0], [1, 2, 0]])
    assert thickness([twice]).value == 0
    with pytest.raises(ValueError, match="finite"):
        thickness([np.full((4, 3), np.nan)])
    with pytest.raises(ValueError, match="no polygon"):
        thickness([])


def test_scales_and_does_not_depend_on_where_the_polygon_starts() -> None:
    rng = np.random.default_rng(5)
    s = 2 * np.pi * np.arange(400) / 400
    p = np.column_stack([(3 + np.cos(3 * s)) * np.cos(2 * s), (3 + np.cos(3 * s)) * np.sin(2 * s)])
    trefoil = np.column_stack([p, np.sin(3 * s)])
    value = thickness([trefoil]).value
    for _ in range(3):
        shift = int(rng.integers(400))
        other = thickness([7 * np.roll(trefoil, shift, axis=0)[::-1]])
        assert other.value == pytest.approx(7 * value, rel=1e-9)


def test_a_long_tangle_of_many_vertices() -> None:
    """Ten thousand vertices on a torus curve: strands at a distance that a formula gives."""
    n, turns = 10_000, 40
    s = 2 * np.pi * np.arange(n) / n
    p = 50 + 20 * np.cos(turns * s)
    curve = np.column_stack([p * np.cos(s), p * np.sin(s), 20 * np.sin(turns * s)])
    found: Thickness = thickness([curve])
    # at the inner equator neighbours are about 30 * 2 pi / 40 apart, less for their slope
    assert found.half_dcsd is not None
    assert 0.9 * 30 * np.pi / turns < found.half_dcsd < 30 * np.pi / turns
    assert dcsd(ngon(n, 10.0)) == pytest.approx(10 * np.cos(np.pi / n), rel=1e-9)


# --- the checks, and what they must reject --------------------------------------------------


def test_check_thickness_rejects_strands_at_0_999_diameters() -> None:
    radius = 2.0
    one = stadium(60.0, 20.0, 60)
    near, far = (move(one, 0, 0, f * 2 * radius) for f in (0.999, 1.001))
    bad = check_thickness(curves(one, near), radius)
    assert bad.status == "fail" and bad.name == "thickness" and bad.unit == "mm"
    assert bad.measured == pytest.approx(0.999 * radius, rel=1e-9)
    assert "strands" in bad.detail and "knot 0 vertex" in bad.detail
    assert "knot 1 vertex" in bad.detail and bad.detail.count("mm") == 2  # both places
    assert bad.at[0][2] == pytest.approx(0.999 * radius)
    good = check_thickness(curves(one, far), radius)
    assert good.status == "pass" and good.limit == radius
    flat = check_thickness(curves(ngon(200, 4.9)), 5.0)
    assert flat.status == "fail" and "bend" in flat.detail and len(flat.at) == 1


def test_check_length() -> None:
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    both = curves(square, move(3 * square, 0, 0, 5))
    good = check_length(both, 32.0)
    assert good.status == "pass" and good.limit == 32.0 and good.unit == "mm"
    assert check_length(both, 32.0 * (1 - 1e-13)).status == "pass"
    short = check_length(both, 32.0 * (1 - 1e-11))
    assert short.status == "fail" and short.measured == pytest.approx(32.0)
    assert short.at == ((0.0, 0.0, 5.0),) and "longest is knot 1" in short.detail
    alone = Curves((square,), ("unknot",), (False,), 1.0)
    assert check_length(alone, None).measured == pytest.approx(6.0)


def test_a_tangle_without_end_is_told_and_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(critical_chords, "MOST_PAIRS", 1_000_000)
    tangle = np.random.default_rng(0).uniform(0, 100, (10_000, 3))
    found = check_thickness(curves(tangle), None)
    assert (found.status, found.measured) == ("fail", "untested")
    assert "over 1 million pairs of edges" in found.detail


# Places that face each other are told from neighbours; endless descents are given up, in a
# sentence.


def test_a_spike_of_a_centre_line_leaves_a_check_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    points = circle(24, 20.0)
    mesh = Mesh(*tube(points, 3.0, 8))
    points[3, 2] = 100.0
    curves = Curves((points,), ("unknot",), (True,), 3.0)
    assert check_clearance(mesh, curves, 0.4).status != "skipped"
    monkeypatch.setattr(strand_pairs_module, "MOST_MOVES", 10_000)
    check = check_clearance(mesh, curves, 0.4)
    assert check.status == "skipped" and check.required and "side by side" in check.detail


def test_neighbours_along_a_strand_meet_and_others_do_not() -> None:
    samples = sample_curves([circle(100, 10.0)], 0.5)
    assert not strand_pairs(samples, 15.0, np.inf).facing.any()
    pairs = strand_pairs(samples, 15.0, 8.0)
    along = np.abs(samples.arc[pairs.i] - samples.arc[pairs.j])
    assert len(along) and np.minimum(along, samples.lengths[0] - along).min() >= 8.0
    two = sample_curves([hairpin(2.0)], 0.5)
    legs = strand_pairs(two, 4.5, np.inf)
    x = two.point[legs.i[legs.facing], 0]
    assert x.min() < 2 and 18 < x.max() < 22


# Gaps between surfaces: against all pairs of triangles, against the centre lines, at the limit.


def made(*lines: Array, radius: float = 2.0, sides: int = 32) -> tuple[Mesh, Curves]:
    vertices, faces, offset = [], [], 0
    for line in lines:
        v, f = tube(line, radius, sides)
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    n = len(lines)
    curves = Curves(lines, ("unknot",) * n, (True,) * n, radius)
    return Mesh(np.concatenate(vertices), np.concatenate(faces)), curves


def rings(apart: float, *, radius: float = 2.0, size: float = 20.0, n: int = 100) -> Mesh:
    """Two round rings above each other, corners of 32 at their tops and bottoms."""
    s, t = (2 * np.pi * np.arange(k) / k for k in (n, 32))
    vertices, faces = [], []
    _, grid = tube(circle(n, size), radius, 32)
    for k in range(2):
        away = size + radius * np.sin(t)[None, :]
        up = np.broadcast_to(radius * np.cos(t)[None, :], (n, 32)) + k * apart
        xyz = np.stack([away * np.cos(s)[:, None], away * np.sin(s)[:, None], up], axis=-1)
        vertices.append(xyz.reshape(-1, 3))
        faces.append(grid[:, ::-1] + k * n * 32)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def two_circles(apart: float, size: float = 20.0, n: int = 100) -> Curves:
    lines = (circle(n, size), circle(n, size) + [0, 0, apart])
    return Curves(lines, ("unknot",) * 2, (True,) * 2, 2.0)


def sag(radius: float, sides: int) -> float:
    """What flat facets take off two surfaces' gap, at most: their middles lie inside the tube."""
    return 2 * radius * (1 - np.cos(np.pi / sides))


def chord_gap(curves: Curves) -> float:
    chord = shortest_critical_chord(curves.polygons, curves.closed)
    assert chord is not None and curves.radius_mm is not None
    return chord.length - 2 * curves.radius_mm


def wave(seed: int, n: int = 400) -> Array:
    """A random curve of three waves an axis."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(n)[:, None] / n * np.arange(1, 4)
    weight = rng.normal(size=(2, 3, 3)) / np.arange(1, 4)[:, None]
    points: Array = 20 * (np.cos(phase) @ weight[0] + np.sin(phase) @ weight[1])
    return points


LINKS = {
    "stacked rings": (circle(150, 20.0), circle(150, 20.0) + [0, 0, 4.3]),
    "turned rings": (circle(150, 20.0), circle(90, 30.0)[:, [0, 2, 1]] + [5.0, 0, 0]),
    "trefoil": (trefoil(300, 8.0),), "torus knot 2, 3": (torus_knot(2, 3, 24.0, 9.0, 400),),
    "torus knot 2, 7": (torus_knot(2, 7, 24.0, 9.0, 400),), "waves 15": (wave(15),),
    "waves 17": (wave(17),), "waves 23": (wave(23),), "waves 27": (wave(27),),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", some(LINKS, 2))
def test_agrees_with_the_centre_lines(name: str) -> None:
    lines = LINKS[name]
    expected = shortest_critical_chord(lines, [True] * len(lines))
    assert expected is not None
    radius, sides = min(expected.length / 2.6, 0.8 * thickness(lines).min_rad), 24
    mesh, curves = made(*lines, radius=radius, sides=sides)
    found = check_clearance(mesh, curves, None)
    assert found.status == "pass" and isinstance(found.measured, float)
    # a ring of vertices lies in a plane that halves the turn: off by second order in the edge
    skew = 0.01 * radius
    assert -skew <= found.measured - chord_gap(curves) <= sag(radius, sides) + skew
    assert np.linalg.norm(np.array(found.at[0]) - expected.middle) < 60 * radius


def test_no_pair_of_triangles_is_nearer() -> None:
    """All pairs of two links' triangles are enumerated."""
    one, other = circle(20, 10.0), circle(24, 9.0)[:, [0, 2, 1]] + [9.7, 0.3, 0.4]
    mesh, curves = made(one, other, sides=8)
    first = mesh.vertices[mesh.faces[: 2 * 20 * 8]]
    second = mesh.vertices[mesh.faces[2 * 20 * 8 :]]
    least = min(
        float(triangle_triangle(np.repeat(first[k : k + 1], len(second), axis=0), second)[0].min())
        for k in range(len(first))
    )
    gap, _, left_out = strand_gap(mesh, curves)
    assert gap is not None and left_out == 0
    assert gap.distance == pytest.approx(least, abs=1e-12)
    assert np.linalg.norm(gap.points[0] - gap.points[1]) == pytest.approx(least, abs=1e-12)
    bodies = nearest_bodies(mesh)
    assert not isinstance(bodies, str)
    assert bodies[0] == pytest.approx(least, abs=1e-9)
    blind = check_clearance(mesh, None, 0.4)
    assert blind.measured == pytest.approx(least, abs=1e-9) and "not looked for" in blind.detail


def test_the_limit() -> None:
    """Corners that face each other: the gap of the facets is that of the tubes, 0.4 mm."""
    mesh, curves = rings(4.4), two_circles(4.4)
    for asked in (None, curves):
        found = check_clearance(mesh, asked, 0.4)
        assert found.measured == pytest.approx(0.4, rel=1e-12) and found.name == "clearance"
        assert found.status == "pass" and found.unit == "mm"
        under = check_clearance(mesh, asked, 0.404)  # 1 % more than there is
        assert under.status == "fail" and under.limit == 0.404
        assert under.at[0][2] == pytest.approx(2.2, abs=1e-9)
        assert np.hypot(under.at[0][0], under.at[0][1]) == pytest.approx(20, abs=0.01)


@pytest.mark.slow
def test_facets_that_keep_the_volume_are_allowed_for() -> None:
    """Corners that stand out as those of twelve sides do narrow the gap; by more they are a fault."""
    for grown, status in ((1.0016, "pass"), (1.023, "pass"), (1.025, "fail"), (1.04, "fail")):
        found = check_clearance(rings(4.4, radius=2 * grown), two_circles(4.4), 0.4)
        assert found.status == status
        assert found.measured == pytest.approx(4.4 - 4 * grown, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.7, 0.95, 0.999])
def test_strands_nearer_than_a_diameter_are_rejected(factor: float) -> None:
    mesh, curves = rings(4 * factor), two_circles(4 * factor)
    found = check_clearance(mesh, curves, 0.4)
    assert found.status == "fail"
    assert found.measured == pytest.approx(4 * factor - 4, abs=1e-9)
    assert "interpenetrate" in found.detail
    assert "knot 0 vertex" in found.detail and "knot 1 vertex" in found.detail
    assert check_clearance(mesh, curves, 0.0).status == "fail"
    blind = check_clearance(mesh, None, 0.4)
    assert blind.status == "fail" and blind.measured == 0.0 and "interpenetrate" in blind.detail


def test_crossing_centre_lines_are_rejected() -> None:
    one = np.array([[-20.0, 0, 0], [20, 0, 0], [20, -30, 0], [-20, -30, 0]])
    other = one[:, [1, 0, 2]] * [1, 1, -1]
    mesh, curves = made(one, other)
    found = check_clearance(mesh, curves, 0.4)
    assert found.status == "fail" and found.measured == pytest.approx(-4.0, abs=1e-9)


def test_a_bend_is_no_gap_but_one_tighter_than_allowed_is() -> None:
    ring = check_clearance(*made(circle(200, 30.0)), 0.4)
    assert ring.status == "pass" and float(ring.measured or 0.0) > 10
    for bend, status in ((2.21, "pass"), (2.19, "fail")):
        mesh, curves = made(hairpin(bend), sides=48)
        found = check_clearance(mesh, curves, 0.4)
        assert found.measured == pytest.approx(2 * bend - 4, abs=0.03)
        assert found.status == status, found


def test_a_plate_belongs_to_no_strand() -> None:
    mesh, curves = made(circle(100, 20.0), circle(100, 20.0) + [0, 0, 4.6])
    plate = np.array([[-9.0, -9, 9], [9, -9, 9], [9, 9, 9], [-9, 9, 9]])
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + len(mesh.vertices)
    both = Mesh(np.concatenate([mesh.vertices, plate]), np.concatenate([mesh.faces, faces]))
    found = check_clearance(both, curves, 0.4)
    assert found.measured == check_clearance(mesh, curves, 0.4).measured
    assert "2 faces belong to no strand" in found.detail


def test_what_cannot_be_seen_is_said() -> None:
    mesh, curves = made(trefoil(200, 8.0))
    blind = check_clearance(mesh, None, 0.4)
    assert blind.status == "skipped" and "one body" in blind.detail
    assert "within one body were not looked for" in blind.detail
    unknown = check_clearance(mesh, Curves(curves.polygons, ("3_1",), (True,), None), 0.4)
    assert unknown.status == "skipped" and "radius" in unknown.detail
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert check_clearance(empty, curves, 0.4).status == "skipped"


def test_finely_cut_straight_strands(monkeypatch: pytest.MonkeyPatch) -> None:
    """A few long edges with many faces each: the same by trees of the faces' centres."""
    corners = np.array([[-10.0, -8, 0], [10, -8, 0], [10, 8, 0], [-10, 8, 0]])
    fine = np.concatenate(
        [
            a + np.linspace(0, 1, 30)[:-1, None] * (b - a)
            for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
        ]
    )
    mesh, _ = made(fine, fine + [0, 0.3, 4.4])
    coarse = Curves((corners, corners + [0, 0.3, 4.4]), ("unknot",) * 2, (True,) * 2, 2.0)
    plain = check_clearance(mesh, coarse, 0.4)
    monkeypatch.setattr(clearance, "MOST_AT_ONCE", 1000)
    assert check_clearance(mesh, coarse, 0.4).measured == pytest.approx(plain.measured, rel=1e-12)
    monkeypatch.setattr(clearance, "MOST_NEAR", 1)
    crowded = check_clearance(mesh, coarse, 0.4)
    assert crowded.status == "skipped" and crowded.required


def test_knots_of_another_part_are_refused() -> None:
    mesh, curves = made(circle(60, 10.0))
    away = Curves((curves.polygons[0] + 100.0,), ("unknot",), (True,), 2.0)
    found = check_clearance(mesh, away, 0.4)
    assert found.status == "fail" and found.required and found.measured == "no strand"


def test_a_crowd_of_vertices_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, curves = made(circle(60, 10.0))
    monkeypatch.setattr(strand_pairs_module, "MOST_PAIRS", 10)
    found = check_clearance(mesh, curves, 0.4)
    assert found.status == "skipped" and "crowded" in found.detail


@pytest.mark.slow
def test_faces_longer_than_centre_line_edges_are_the_strands() -> None:
    """A coarse tube whose line was found finely has them, as parts from elsewhere have."""
    fine, far = circle(400, 30.0), circle(400, 30.0) + [0, 0, 7.0]
    bodies = [tube(curve[::20], 3.0, 8) for curve in (fine, far)]
    mesh = Mesh(
        np.concatenate([b[0] for b in bodies]),
        np.concatenate([bodies[0][1], bodies[1][1] + len(bodies[0][0])]),
    )
    both = Curves((fine, far), ("unknot",) * 2, (True,) * 2, 3.0)
    # faces that meet are nearest to places farther apart than a bend's sides
    for asked in (None, 0.4):
        found = check_clearance(mesh, both, asked)
        assert found.status == "pass" and found.measured == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("seed", range(10))
def test_distance_of_bodies_against_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soups = [rng.normal(size=(12, 3)) * [1, 2, 0.3] + [3 * k, k % 2, 0] for k in range(4)]
    faces = [np.array([[i, i + 1, i + 2] for i in range(10)]) + 12 * k for k in range(4)]
    mesh = Mesh(np.concatenate(soups), np.concatenate(faces))
    least = np.inf
    for a in range(4):
        for b in range(a):
            one = np.repeat(mesh.vertices[faces[a]], 10, axis=0)
            other = np.tile(mesh.vertices[faces[b]], (10, 1, 1))
            distance = triangle_triangle(one, other)[0]
            least = min(least, float(np.where(triangles_cross(one, other), 0.0, distance).min()))
    found = nearest_bodies(mesh)
    assert not isinstance(found, str)
    assert found[0] == pytest.approx(least, abs=1e-9)


def test_copies_and_heaps_of_faces_cost_no_more_than_allowed() -> None:
    """Trees of boxes do not help where all boxes overlap: their work would grow with the square."""
    rng = np.random.default_rng(0)
    one = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [4, 0, 0], [3, 1, 0]])
    copies = Mesh(one, np.tile([[0, 1, 2], [3, 4, 5]], (200_000, 1)))
    found = nearest_bodies(copies)
    assert not isinstance(found, str) and found[0] == pytest.approx(2.0)
    points = rng.normal(size=(2 * 12_000, 3)) * 10
    points[12_000:] += [0, 0, 1e-6]
    chain = np.column_stack([np.arange(11_998), np.arange(11_998) + 1, np.arange(11_998) + 2])
    heap = Mesh(points, np.concatenate([chain, chain + 12_000]))
    assert "boxes that overlap" in str(nearest_bodies(heap))
