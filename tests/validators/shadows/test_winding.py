"""Winding numbers of a linework in the plane."""

import numpy as np

from knotfab_validators.shadows.winding import Linework, winding_at, wound_mask


def test_winding_numbers_count_turns() -> None:
    square = np.array([[0.5, 0.5], [8.5, 0.5], [8.5, 8.5], [0.5, 8.5]])
    twice = Linework(square, np.roll(square, -1, axis=0), np.full(4, 2))
    mask = wound_mask([twice], 12, 10)
    assert np.count_nonzero(mask) == 64
    points = np.array([[1.0, 1.0], [8.0, 8.0], [9.0, 1.0], [0.0, 5.0], [4.0, 20.0]])
    assert np.abs(winding_at(points, twice)).tolist() == [2, 2, 0, 0, 0]
    v, u = np.mgrid[:10, :12]
    at = winding_at(np.column_stack([u.ravel(), v.ravel()]).astype(float), twice)
    np.testing.assert_array_equal(at.reshape(10, 12) != 0, mask)


def test_what_parts_wind_adds_up_and_may_cancel() -> None:
    draw = np.random.default_rng(5)
    loops = draw.uniform(-4.0, 34.0, (2, 40, 2))
    parts = [Linework(p, np.roll(p, -1, axis=0), np.ones(40, dtype=np.int64)) for p in loops]
    v, u = np.mgrid[:30, :30]
    points = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    both = sum(winding_at(points, part) for part in parts)
    np.testing.assert_array_equal(wound_mask(parts, 30, 30).ravel(), both != 0)
    back = Linework(parts[0].end, parts[0].start, parts[0].weight)
    assert not wound_mask([parts[0], back], 30, 30).any()
