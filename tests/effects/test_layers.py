"""Layers: a bound of what half a layer shifts, as the piece lies on the printer's bed."""

from typing import Any

import numpy as np
import pytest
from lit_designs import view

from knotfab.effects.base import EffectContext, World
from knotfab.effects.layers import LAYERS
from knotfab_formats.scene import Printer, ResolvedView
from tests.oracles.parting import shift_bound_and_truth

PX = 180 / 1024


def magnitude(seen: ResolvedView, points: Any, radius: float, up: Any, layer: float = 0.2) -> float:
    world = World(printer=Printer(layer_height_mm=layer))
    return LAYERS.magnitude(EffectContext((seen,), points, radius, 0.25, world, None, up))


@pytest.mark.parametrize("bent", [False, True])
def test_it_bounds_the_shift_and_closely(bent: bool) -> None:
    rng = np.random.default_rng(6)
    ratios = [np.divide(*shift_bound_and_truth(rng, "layers", bent=bent)) for _ in range(100)]
    assert min(ratios) >= 1.0 and np.median(ratios) <= 1.1


def test_no_layers_along_the_printers_axis_or_unprinted() -> None:
    there = np.zeros((1, 3))
    along, across = (
        magnitude(view(), there, 2.0, np.array(up)) for up in ([0, 0, 1.0], [0, 1.0, 0])
    )
    assert along < 0.02 < across
    # the part of the surface that is nearer to the lamp, and the rim
    assert across == pytest.approx(0.1 * 1.2 / PX, rel=0.05)
    assert magnitude(view(), there, 2.0, None) == 0.0
