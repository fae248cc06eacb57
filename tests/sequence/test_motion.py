"""The motion bound: Hausdorff distances known by hand, and a hinge with the right slope."""

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon
from slopes import assert_slope, state_at

from knotfab.base.arrays import Array
from knotfab.limits.base import Felt
from knotfab.search.objective import Term, Weights
from knotfab.sequence.motion import Anchor, Tautness, measure, outline_motion, pair_pieces


def _square(x: float, y: float, side: float) -> MultiPolygon:
    return MultiPolygon([shapely.box(x, y, x + side, y + side)])


def test_outline_motion_of_a_shifted_square() -> None:
    assert outline_motion(_square(0, 0, 10), _square(3, 0, 10)) == pytest.approx(3.0)
    # the corner that sticks out is a diagonal away from the other's corner
    assert outline_motion(_square(0, 0, 10), _square(3, 4, 10)) == pytest.approx(5.0)


def test_a_piece_goes_its_own_way_whatever_else_it_comes_near() -> None:
    """A ball that rises from a floor to a ceiling: either is nearer to it than where it was."""
    still = shapely.box(-50, -5, 50, 0), shapely.box(-50, 60, 50, 66)
    low, high = (MultiPolygon([*still, shapely.Point(0, y).buffer(10)]) for y in (10.1, 49.9))
    pairs = pair_pieces(low, high, 3)
    assert [one.equals(other) for one, other in pairs] == [True, True, False]
    assert outline_motion(low, high, 3) == pytest.approx(39.8, abs=0.1)
    assert outline_motion(low, high) < 25.0
    # where a piece is missing, all is one
    floor = MultiPolygon(still[:1])
    assert pair_pieces(low, floor, 3) == [(low, floor)]


def test_outline_motion_is_symmetric_and_sees_what_is_new() -> None:
    limb = shapely.box(9, 4, 30, 6)
    body, grown = _square(0, 0, 10), MultiPolygon([shapely.box(0, 0, 10, 10).union(limb)])
    assert outline_motion(body, grown) == pytest.approx(np.hypot(20, 0))
    assert outline_motion(grown, body) == outline_motion(body, grown)


def test_outline_motion_counts_holes() -> None:
    whole = shapely.box(0, 0, 20, 20)
    pierced = MultiPolygon([whole.difference(shapely.box(9, 9, 11, 11))])
    # the middle of a hole's side is 9 from the square's own outline
    assert outline_motion(MultiPolygon([whole]), pierced) == pytest.approx(9.0)


def test_outline_motion_of_circles() -> None:
    large, small = (MultiPolygon([shapely.Point(0, 0).buffer(r, 256)]) for r in (10, 7))
    assert outline_motion(large, small) == pytest.approx(3.0, abs=1e-3)
    assert outline_motion(large, large) == 0.0


def test_measure_holds_and_refuses() -> None:
    old = np.zeros((4, 3))
    new = old.copy()
    new[2] = (3.0, 0.0, 4.0)
    assert measure(old, new, 3.5, 1.5).held
    found = measure(old, new, 3.4, 1.5)
    assert not found.held
    assert (found.largest_mm, found.limit_mm, found.mean_mm) == (5.0, 4.9, 1.25)


def _pull(term: Term, points: Array) -> Felt:
    """A term at the vertices (N, 3) of one closed polyline."""
    return term(state_at(points, 5.0), Weights())


def test_anchor_is_silent_within_its_bound() -> None:
    anchor = Anchor(np.zeros((5, 3)), 2.0, 1.5)
    loss, slope = _pull(anchor, np.full((5, 3), 1.0))
    assert loss == 0.0
    assert not slope.any()
    assert anchor.beyond(np.full((5, 3), 1.0)) == pytest.approx(np.sqrt(3) - 2)
    assert anchor.kept(np.full((5, 3), 1.1)) and not anchor.kept(np.full((5, 3), 1.2))


def test_anchor_pulls_back_with_its_true_slope() -> None:
    rng = np.random.default_rng(3)
    anchor = Anchor(rng.normal(size=(6, 3)), 0.7, 1.3)
    assert_slope(lambda x: _pull(anchor, x), rng.normal(size=(6, 3)) * 2)
    _, slope = _pull(anchor, anchor.points)
    assert np.isfinite(slope).all()


def test_an_anchor_pulls_by_the_squared_radii_beyond_it() -> None:
    anchor = Anchor(np.zeros((4, 3)), 2.0, 1.3)
    at = np.zeros((4, 3))
    at[1] = (3.0, 0.0, 4.0)
    weights = Weights()
    expected = weights.hold * ((5.0 - 0.97 * 2.0) / 1.3) ** 2
    assert _pull(anchor, at)[0] == pytest.approx(expected)


def test_a_knot_is_drawn_taut_only_beyond_its_length() -> None:
    t = 2 * np.pi * np.arange(50) / 50
    ring = 10.0 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    length = float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())
    assert _pull(Tautness(length + 0.1, 1.5), ring)[0] == 0.0
    once, twice = (_pull(Tautness(length - d, 1.5), ring)[0] for d in (3.0, 6.0))
    assert 0 < once == pytest.approx(twice / 4)
    assert_slope(lambda x: _pull(Tautness(length - 3.0, 1.5), x), ring)
    _, slope = _pull(Tautness(length - 3.0, 1.5), ring)
    assert ((slope * ring).sum(axis=1) > 0).all()  # inwards is downhill
