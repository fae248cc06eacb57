"""Edges and lengths of curves, closed and open."""

import numpy as np

from knotfab_validators.geometry.curves import Curves

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])


def test_a_closed_curve_alone_has_the_edge_back() -> None:
    curves = Curves((SQUARE, SQUARE + 5), ("unknot", "open"), (True, False), None)
    assert curves.edges.curve.tolist() == [0] * 4 + [1] * 3
    assert curves.edges.end[3].tolist() == [0, 0, 0] and curves.edges.end[-1].tolist() == [5, 7, 5]
    assert curves.lengths_mm == (8.0, 6.0) and curves.length_mm == 14.0
