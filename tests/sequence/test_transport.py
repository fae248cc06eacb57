"""Registration and transport: displacements that are known, and no step without its certificate."""

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, affinity

from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.sequence import transport as module
from knotfab.sequence.transport import register, transport

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
