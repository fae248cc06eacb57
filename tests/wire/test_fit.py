"""The fit of straights and bends: strands that run close side by side stay apart."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array
from knotfab.wire.arcs import space_sites
from knotfab.wire.fit import FitLimits, fit_wires
from knotfab.wire.replay import measure_least_distance


def wavy(radius: float) -> Array:
    t = np.linspace(0, 2 * np.pi, 600, endpoint=False)
    out = radius + 1.2 * np.sin(7 * t)
    return np.column_stack([out * np.cos(t), out * np.sin(t), 2.5 * np.sin(5 * t)])


def test_strands_side_by_side_do_not_touch_and_cost_no_more_bends() -> None:
    """0.16 mm of air between them: less than straights and bends need within the tolerance."""
    curves = [wavy(22.0), wavy(24.3)]
    limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.475, 2.0)
    wires = fit_wires(curves, np.array([0.0, 0.0, 500.0]), limits)
    fine = [wire.at(space_sites(wire, 0.2)[0]) for wire in wires]
    assert 2.0 < measure_least_distance(curves, 2.0) < 2.2
    assert measure_least_distance(fine, 2.0) >= 2.0 - 0.01
    alone = [
        len(fit_wires([curve], np.array([0.0, 0.0, 500.0]), limits)[0].corners) for curve in curves
    ]
    assert sum(len(wire.corners) for wire in wires) <= 1.1 * sum(alone)
