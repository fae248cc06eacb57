"""The motion bound: Hausdorff distances known by hand, and a hinge with the right slope."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from oracles import assert_slope, state_at
from shapely import MultiPolygon, affinity

from knotfab.base.arrays import Array
from knotfab.design import film_motion as module
from knotfab.design.film_motion import (
    Anchor,
    Tautness,
    measure_motion,
    outline_motion,
    pair_pieces,
    register,
    transport,
)
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Felt
from knotfab.search.objective import Term, Weights


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
    assert measure_motion(old, new, 3.5, 1.5).held
    found = measure_motion(old, new, 3.4, 1.5)
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
    assert anchor.excess(np.full((5, 3), 1.0)) == pytest.approx(np.sqrt(3) - 2)
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


# Registration and transport: displacements that are known, and no step without its certificate.


BODY = MultiPolygon([shapely.box(-30, -8, 30, 8).union(shapely.Point(0, 0).buffer(18))])


def _ring(radius: float, n: int = 120) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([radius * np.cos(t), radius * np.sin(t), 20 * np.sin(t)], axis=1)


def _iou(a: MultiPolygon, b: MultiPolygon) -> float:
    return float(a.intersection(b).area / a.union(b).area)


def test_no_displacement_between_the_same_pictures() -> None:
    assert np.abs(register(BODY, BODY, 10.0).values).max() < 1e-9


@pytest.mark.parametrize("kind", ["shift", "turn", "grow"])
def test_registration_takes_one_picture_to_the_other(kind: str) -> None:
    new = {
        "shift": affinity.translate(BODY, 9.0, 4.0),
        "turn": affinity.rotate(BODY, 20.0, origin=(0, 0)),
        "grow": affinity.scale(BODY, 1.2, 0.85, origin=(0, 0)),
    }[kind]
    field = register(BODY, new, 12.0)
    moved = shapely.transform(BODY.segmentize(0.5), lambda p: p + field.at(p)).buffer(0)
    assert _iou(moved, new) > 0.97 > _iou(BODY, new) + 0.05


def test_what_has_left_its_place_is_shifted_and_stretched() -> None:
    """A ball that falls and is squashed on the ground: every point goes where its own shape says."""
    ball = MultiPolygon([shapely.Point(0, 30).buffer(12.0)])
    squashed = affinity.translate(affinity.scale(ball, 1.35, 1 / 1.35), 0.0, -45.0)
    assert ball.disjoint(squashed)
    inside = np.array([[0.0, 30.0], [-8.0, 30.0], [3.0, 37.0], [11.9, 30.0], [0.0, 18.1]])
    away = inside - [0.0, 30.0]
    wanted = [0.0, -45.0] + away * [0.35, 1 / 1.35 - 1.0]
    np.testing.assert_allclose(register(ball, squashed, 8.0).at(inside), wanted, atol=0.1)


def test_a_knot_goes_along_and_keeps_its_depth() -> None:
    old, new = BODY, affinity.translate(BODY, 8.0, 0.0)
    points, light = _ring(17.0), 500.0
    found = transport(points, polylines_of_sizes((120,)), old, new, light, 2.0, 20.0)
    assert found.reached == 1.0
    assert found.least_margin > 0
    np.testing.assert_allclose(found.points[:, 2], points[:, 2], atol=1e-9)
    # seen from the light, what was on the outline has gone along with it
    seen = found.points[:, :2] / (1 - found.points[:, 2:] / light)
    edge = new.buffer(2.5).difference(new.buffer(-3.5))
    assert shapely.contains_xy(edge, *seen.T).mean() > 0.8


def test_no_vertex_goes_further_than_allowed() -> None:
    points = _ring(17.0)
    new = affinity.translate(BODY, 12.0, 0.0)
    found = transport(points, polylines_of_sizes((120,)), BODY, new, 500.0, 2.0, 3.0)
    assert np.linalg.norm(found.points - points, axis=1).max() <= 3.0 + 1e-9


def test_strands_that_would_cross_stop_the_transport(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sides of a long loop pushed through each other: the way ends before they meet."""

    class Through:
        def at(self, where: np.ndarray) -> np.ndarray:
            return np.column_stack([np.zeros(len(where)), -2.0 * where[:, 1]])

    monkeypatch.setattr(module, "register", lambda *_: Through())
    t = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    loop = np.stack([30 * np.cos(t), 3 * np.sin(t), np.zeros(160)], axis=1)
    found = transport(loop, polylines_of_sizes((160,)), BODY, BODY, 500.0, 1.0, 50.0)
    assert 0 < found.reached < 0.5
    assert found.refused > 0
    assert found.least_margin > 0
    # the upper side is still above
    assert (np.sign(found.points[1:80, 1]) == 1).all()


def test_each_of_two_knots_goes_with_its_own_piece() -> None:
    """One stays, one falls past where a smooth displacement of the whole would take both."""
    floor = shapely.box(-60, -8, 60, 8)
    old, new = (MultiPolygon([shapely.Point(0, y).buffer(20), floor]) for y in (90.0, 40.0))
    lying, ball = _ring(7.0, 60) * [6.0, 1.0, 0.2], _ring(17.0, 60) * [1.0, 1.0, 0.2] + [0, 90, 0]
    rings = polylines_of_sizes((60, 60))
    found = transport(np.concatenate([lying, ball]), rings, old, new, 500.0, 2.0, 60.0)
    assert found.reached == 1.0
    at_floor, fallen = rings.split(found.points)
    np.testing.assert_allclose(at_floor, lying, atol=0.3)
    np.testing.assert_allclose(fallen[:, :2].mean(0), [0.0, 40.0], atol=0.5)
