"""Winding numbers of a linework in the plane."""

from __future__ import annotations

import numpy as np

from knotfab_validators.shadows.winding import Linework, winding_at, winding_raster


def test_winding_numbers_count_turns() -> None:
    square = np.array([[0.5, 0.5], [8.5, 0.5], [8.5, 8.5], [0.5, 8.5]])
    twice = Linework(square, np.roll(square, -1, axis=0), np.full(4, 2))
    raster = winding_raster(twice, 12, 10)
    assert set(np.unique(raster)) == {0, 2} or set(np.unique(raster)) == {0, -2}
    assert np.count_nonzero(raster) == 64
    points = np.array([[1.0, 1.0], [8.0, 8.0], [9.0, 1.0], [0.0, 5.0], [4.0, 20.0]])
    assert np.abs(winding_at(points, twice)).tolist() == [2, 2, 0, 0, 0]
    v, u = np.mgrid[:10, :12]
    at = winding_at(np.column_stack([u.ravel(), v.ravel()]).astype(float), twice)
    np.testing.assert_array_equal(at.reshape(10, 12), raster)
