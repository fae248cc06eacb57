"""Polygonal thickness against exact values, against a plain oracle, and against the limits."""

from __future__ import annotations

import numpy as np
import pytest
from knot_curves import curves
from validator_parts import circle, hairpin, tube

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube import critical_chords
from knotfab_validators.tube import thickness as strand_pairs_module
from knotfab_validators.tube.clearance import check_clearance
from knotfab_validators.tube.critical_chords import shortest_critical_chord
from knotfab_validators.tube.thickness import (
    Thickness,
    check_length,
    check_thickness,
    sample_curves,
    strand_pairs,
    thickness,
)
from tests.corpus.curves import ThicknessRow, thickness_rows


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
