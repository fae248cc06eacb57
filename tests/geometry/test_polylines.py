"""Even samples of closed polylines: on the curve, evenly, and as many as were asked for."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.geometry.measures import segment_distance
from knotfab.geometry.polylines import arc_lengths, sample_evenly

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])


def test_arc_lengths_close_the_curve() -> None:
    assert arc_lengths(SQUARE).tolist() == [0.0, 4.0, 8.0, 12.0, 16.0]
    assert arc_lengths(SQUARE, closed=False).tolist() == [0.0, 4.0, 8.0, 12.0]


@pytest.mark.parametrize(
    ("step", "at_most", "count"),
    [(1.0, False, 16), (1.04, False, 15), (1.04, True, 16), (1.0, True, 16), (9.0, False, 8)],
)
def test_samples_of_a_square(step: float, at_most: bool, count: int) -> None:
    found = sample_evenly(SQUARE, step, at_most=at_most)
    assert len(found) == count and (found[0] == SQUARE[0]).all()
    inside = np.abs(found - 2.0).max(axis=1)
    assert inside == pytest.approx(2.0)  # each lies on one of the sides
    along = np.where(found[:, 1] == 0, found[:, 0], 0.0)
    sides = along[(found[:, 1] == 0) & (found[:, 0] < 4)]
    assert np.diff(sides) == pytest.approx(16.0 / count)


def test_samples_in_space_are_equally_far_along_an_uneven_circle() -> None:
    t = 2 * np.pi * np.sort(np.random.default_rng(0).random(4000))
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    found = sample_evenly(circle, 0.1)
    edges = np.linalg.norm(np.diff(found, axis=0, append=found[:1]), axis=1)
    assert edges == pytest.approx(np.full(63, 2 * np.pi / 63), rel=5e-3)


def test_the_fewest_samples() -> None:
    assert len(sample_evenly(SQUARE, 100.0, fewest=12)) == 12


# Distances of segments, against dense samples.


def test_segments_as_near_as_dense_samples_say() -> None:
    random = np.random.default_rng(3)
    a, b, c, d = random.normal(size=(4, 300, 3))
    d[:20] = c[:20] + (b - a)[:20] * 1.3  # parallel ones
    found = segment_distance(a, b, c, d)
    t = np.linspace(0, 1, 160)[:, None, None]
    p, q = a + t * (b - a), c + t * (d - c)
    dense = np.array(
        [np.linalg.norm(p[:, None, i] - q[None, :, i], axis=2).min() for i in range(300)]
    )
    assert (found <= dense + 1e-12).all() and (dense - found < 0.03).all()
    cross = segment_distance(
        *(np.array([x], dtype=float) for x in ([-1, 0, 0], [1, 0, 0], [0, -1, 2], [0, 1, 2]))
    )
    assert cross == pytest.approx([2.0])
