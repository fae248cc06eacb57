"""The fit of straights and bends: strands side by side stay apart, and no corner is there for nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from knotfab.apps.wire.arcs import round_corners, space_sites
from knotfab.apps.wire.fit import fit_wires, measure_fault, measure_worst, prune
from knotfab.apps.wire.judge import measure_least_distance
from knotfab.apps.wire.residual import (
    FitLimits,
    GridLikeness,
    Strand,
    Work,
    measure_distances,
    measure_gaps,
    measure_strays,
)
from knotfab.base.arrays import Array
from knotfab_formats.scene import ResolvedView
from knotfab_validators.shadows.tube_field import tube_field
from knotfab_validators.shadows.view import ViewGeometry, view_geometry


def wavy(radius: float) -> Array:
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    out = radius + 1.2 * np.sin(4 * t)
    return np.column_stack([out * np.cos(t), out * np.sin(t), 1.5 * np.sin(3 * t)])


@pytest.mark.slow
def test_strands_side_by_side_cost_few_more_bends() -> None:
    """0.18 mm of air between them: less than straights and bends need within the tolerance."""
    curves = [wavy(13.0), wavy(15.3)]
    limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.475, LIGHT)
    wires = fit_wires(curves, limits)
    fine = [wire.at(space_sites(wire, 0.2)[0]) for wire in wires]
    assert 2.0 < measure_least_distance(curves, 2.0) < 2.2
    assert measure_least_distance(fine, 2.0) >= 2.0 - 0.01
    # alone, pruning goes farther: what it takes from strands side by side must keep them apart too
    alone = [len(fit_wires([curve], limits)[0].corners) for curve in curves]
    assert sum(len(wire.corners) for wire in wires) <= 1.2 * sum(alone)


LIGHT = np.array([0.0, 0.0, 500.0])


def test_a_fit_ends_with_its_work_and_says_so() -> None:
    def fit(work: Work) -> Array:
        limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.1, LIGHT, work)
        return fit_wires([wavy(13.0)], limits)[0].corners

    few, again, late = Work(points=3000), Work(points=3000), Work(ends=0.0)
    assert np.array_equal(fit(few), fit(again))  # counted, not timed
    assert few.over == again.over == "its limit of work" and few.points > -1000
    assert len(fit(late)) >= 3 and late.over == "--time-budget" and late.points == Work().points
    assert not Work().over


def make_strand(curve: Array, every: int, tolerance: float) -> Strand:
    index = np.arange(0, len(curve), every)
    return Strand(curve, curve, curve[index].copy(), index, np.full(len(curve), tolerance))


def test_gaps_are_those_of_all_pairs_of_places() -> None:
    limits = FitLimits(1.0, 1.0, 160.0, 2.0, 0.5)
    wires = [round_corners(wavy(radius)[::12], 1.0) for radius in (13.0, 14.9)]
    sampled = [space_sites(wire, 0.3) for wire in wires]
    points = [w.at(s) for w, (s, _) in zip(wires, sampled, strict=True)]
    away = np.linalg.norm(points[0][:, None] - points[1], axis=-1)
    found = measure_gaps(wires, limits)
    near = 0
    for k, (sites, _) in enumerate(sampled):
        for piece in range(len(wires[k].corners)):
            least = away.min(axis=1 - k)[sites.piece == piece].min()
            assert found[k][piece] == (least if least <= 2.05 else np.inf)
            near += least <= 2.05
    assert near > 10


@pytest.mark.slow
def test_corners_that_nothing_asks_for_are_taken_out() -> None:
    t = np.linspace(0, 2 * np.pi, 320, endpoint=False)
    circle = np.column_stack([30 * np.cos(t), 30 * np.sin(t), 4 * np.sin(2 * t)])
    limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.6, LIGHT)
    strand = make_strand(circle, 8, limits.tolerance_mm)
    gone = prune([strand], limits, 12)
    assert len(strand.corners) == len(strand.index) == 40 - gone
    # a corner for every chord that a circle of this size allows, and a half more
    assert len(strand.corners) <= 1.5 * np.pi / np.sqrt(4 * 0.6 / 28)
    assert measure_fault([strand], limits)[0] == 0.0
    # where there is no room for fewer all are left, each in its place
    tight = FitLimits(2.0, 2.0, 160.0, 2.0, 0.02, LIGHT)
    kept = make_strand(circle, 8, tight.tolerance_mm)
    before, fault = kept.corners.copy(), measure_fault([kept], tight)
    assert prune([kept], tight, 1) == 0
    assert measure_fault([kept], tight) <= fault and kept.corners.shape == before.shape


@pytest.mark.parametrize("shift", [1.96, 1.995])
def test_a_limit_that_is_missed_loosens_no_other(
    shift: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two strands one diameter apart, 5 % beyond the tolerance at a place: they come no nearer.

    At the first shift the first round fails as a whole: the rounds after it ask other corners.
    """
    t = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    ring = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    limits = FitLimits(1.0, 0.5, 160.0, 2.0, 0.6, LIGHT)
    strands = [make_strand(14 * ring, 2, 0.6), make_strand(18 * ring - [shift, 0, 0], 2, 0.6)]
    wires = [round_corners(s.corners, 1.0) for s in strands]
    _, size = measure_distances(strands[1], wires[1], LIGHT)
    strands[1].tolerance[91] *= size[91] / 1.05
    before = measure_worst(strands, limits)
    assert before == pytest.approx([0.05, 0, 0, 0])
    assert measure_gaps(wires, limits)[1].min() < 2.05
    # nothing pushes the strands apart again: a corner that the outer one loses brings it nearer
    monkeypatch.setattr("knotfab.apps.wire.fit.adjust", lambda *_: None)
    assert prune(strands, limits, 12) > 120
    assert (measure_worst(strands, limits) <= before).all()


def test_a_wire_that_reaches_too_far_misses_the_tolerance() -> None:
    """A turn that is drawn out beyond its curve leaves no point of the curve far from the wire."""
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    oval = np.column_stack([30 * np.cos(t), 4 * np.sin(t), 0 * t])
    limits = FitLimits(1.0, 0.5, 160.0, 2.0, 1.0, LIGHT)
    strand = make_strand(oval, 10, 1.0)
    assert (measure_worst([strand], limits)[0]) < 0.2
    strand.corners[[-2, -1, 0, 1, 2]] += [4.0, 0, 0]
    wire = round_corners(strand.corners, 1.0)
    fine = wire.at(space_sites(wire, 0.05)[0])
    truth = np.linalg.norm(fine[:, None] - oval, axis=-1).min(axis=1).max()
    _, offset, _ = measure_strays(strand, wire, limits)
    assert np.linalg.norm(offset, axis=1).max() == pytest.approx(truth, rel=0.03)
    assert measure_distances(strand, wire, LIGHT)[1].max() < 0.8 * truth
    assert measure_worst([strand], limits)[0] == pytest.approx(truth - 1.0, rel=0.05)


# The residuals of a wire's shadow beside a picture: an area, with the slopes of finite
# differences.


SQUARE = np.array([[-20.0, -20, 0], [20, -20, 4], [20, 20, 0], [-20, 20, -4]])


def look(azimuth_deg: float = 0.0) -> ViewGeometry:
    view = ResolvedView(frame_width_mm=60.0, frame_height_mm=60.0, light_distance_mm=400.0,
                        wall_distance_mm=40.0, azimuth_deg=azimuth_deg)  # fmt: skip
    return view_geometry(view, 300, 300)


def picture_of(curve: Array, geometry: ViewGeometry) -> GridLikeness:
    return GridLikeness.for_view(geometry, tube_field([curve], 1.0, geometry).mask, 1.0)


def bent(corners: Array) -> Array:
    """The wire's centre line, finely."""
    wire = round_corners(corners, 2.0)
    arcs = np.linspace(0.0, 1.0, 9)[:, None] * wire.turn
    inner = wire.entry + wire.radius * (
        np.sin(arcs)[..., None] * wire.before + (1 - np.cos(arcs))[..., None] * wire.inward
    )
    return np.asarray(inner.transpose(1, 0, 2).reshape(-1, 3))


def test_the_sum_of_squares_is_what_differs_in_squared_radii() -> None:
    geometry = look()
    picture = picture_of(bent(SQUARE), geometry)
    own, moved = (
        (picture.residual([round_corners(SQUARE + [shift, 0, 0], 2.0)], False)[0] ** 2).sum()
        for shift in (0.0, 1.0)
    )
    # two sides of 38 radii leave a strip of one radius and draw another; edges that fade make it less
    area = 2 * 2 * 38
    assert own < 20 and 0.6 * area < moved < area


@pytest.mark.parametrize("azimuth", [0.0, 50.0])
def test_slopes_are_those_of_finite_differences(azimuth: float) -> None:
    picture = picture_of(bent(SQUARE + [0.4, -0.3, 0]), look(azimuth))
    second = SQUARE[::-1] * 0.5
    residual, blocks = picture.residual([round_corners(c, 2.0) for c in (SQUARE, second)], True)
    slope = 2 * sparse.hstack(blocks).T @ residual
    both = np.concatenate([SQUARE, second])
    for number in (0, 5, 10, 14, 21):
        values = []
        for sign in (1, -1):
            moved = both.ravel() + sign * 1e-3 * (np.arange(24) == number)
            one, two = moved.reshape(2, 4, 3)
            wires = [round_corners(one, 2.0), round_corners(two, 2.0)]
            values.append((picture.residual(wires, False)[0] ** 2).sum())
        found = (values[0] - values[1]) / 2e-3
        assert slope[number] == pytest.approx(found, rel=0.05, abs=0.02 * np.abs(slope).max())


@pytest.mark.slow
def test_a_wire_moves_to_where_it_draws_its_picture() -> None:
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.column_stack([12 * np.cos(t), 12 * np.sin(t), 3 * np.sin(2 * t)])
    geometry = look()
    # the picture's ring is 0.4 mm larger than the one that is followed
    picture = picture_of(1.033 * ring, geometry)
    limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.9, geometry.light)
    plain, shown = (fit_wires([ring], limits, pictures=p) for p in ((), (picture,)))
    before, after = ((picture.residual(w, False)[0] ** 2).sum() for w in (plain, shown))
    assert after < 0.95 * before
    assert len(shown[0].corners) <= len(plain[0].corners)
