"""Strands that hide each other keep their order, and are apart, without being moved out of the shadow."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.geometry.polylines import arc_lengths, pair_nearby, sample_evenly
from knotfab.start.lanes import part_sides

SEPARATION, LIGHT = 4.0, 500.0


@pytest.mark.parametrize("begin", [0.0, 0.1, 0.25, 0.4])
def test_sides_that_change_places_part_in_the_longer_order(begin: float) -> None:
    # a stroke there and back, its sides a millimetre apart, whose depths cross near one end
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    curve = sample_evenly(np.column_stack([60 * np.cos(turn), 0.5 * np.sin(turn)]), 1.5)
    curve = np.roll(curve, -round(begin * len(curve)), axis=0)  # wherever the curve begins
    # and one that lies by itself
    other = curve + np.array([0.0, 100.0])
    share = (arc_lengths(curve)[:-1] / arc_lengths(curve)[-1] + begin) % 1.0
    depth = 10 * np.sin(4 * np.pi * share) + 3 * np.sin(2 * np.pi * share)
    depths = np.concatenate([depth, np.zeros(len(other))])
    pairs, along = pair_nearby((curve, other), 3.5)
    one, two = pairs[(along > 12.0) & (pairs < len(curve)).all(axis=1)].T
    before = depths[one] - depths[two]
    assert before.min() < 0 < before.max()
    moves = part_sides((curve, other), depths, (one, two), SEPARATION, LIGHT)
    after = before + moves[one] - moves[two]
    # pairs are numbered from either side of the stroke: the sign is that of the way round
    upper = np.where(curve[one, 1] >= curve[two, 1], after, -after)
    apart = np.hypot(after, np.linalg.norm(curve[one] - curve[two], axis=1))
    assert (upper > 0).all() or (upper < 0).all()
    assert apart.min() > 0.9 * SEPARATION
    assert (moves[len(curve) :] == 0).all()


def test_nothing_is_moved_where_nothing_hides_another() -> None:
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    circle = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    none = np.empty(0, dtype=np.int64)
    assert not part_sides((circle,), np.zeros(100), (none, none), SEPARATION, LIGHT).any()
