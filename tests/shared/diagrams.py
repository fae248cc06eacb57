"""Diagrams of braids and of polygons, for the tests of invariants."""

import numpy as np
from knot_curves import Array

from knotfab_validators.knots.planar_diagram import Laurent, PlanarDiagram
from knotfab_validators.knots.projection import diagram_of
from knotfab_validators.knots.reduction import general_position

TREFOIL = (1, 1, 1)


WORDS = [
    *[
        tuple(np.random.default_rng(s).choice([-3, -2, -1, 1, 2, 3], 14).tolist())
        for s in range(24)
    ],
    TREFOIL,
    (1, 1, 1, -2, -1, -1, -1, -2),
]


def diagram(*polygons: Array) -> PlanarDiagram:
    placed = general_position(polygons)
    assert placed is not None
    found = diagram_of(placed, most=2000)
    assert found is not None
    return found


def powers(value: Laurent | None) -> dict[int, int]:
    assert value is not None
    return {value.lowest + k: c for k, c in enumerate(value.coefficients) if c}
