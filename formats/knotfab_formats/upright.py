"""Limits of a piece that prints without supports, for its design and for its measurement."""

from __future__ import annotations

from math import pi, radians, tan

LEAST_FLANK_DEG = 35.0  # from the bed: a third of a 0.45 mm line then lies on the layer below
MOST_REACH_MM = 1.1  # how far a layer may reach over air, held on one side
MOST_BRIDGE_MM = 10.0
# by so much, half of an arch as wide as a bridge, flatter undersides may rise: they round off a peak
ROUNDED_MM = MOST_BRIDGE_MM / 2 * tan(radians(LEAST_FLANK_DEG))
# at a leg's tip: the nozzle's drag, a few tenths of a newton, then moves it by less than 1 mm
LEAST_STIFFNESS_N_MM = 0.5
LEAST_FOOT_SHARE = 0.5  # share of a leg's own section; what touches the bed in a line has less
MOST_UNEVEN_MM = 0.02  # between feet: a tenth of a layer
LEAST_TIP_DEG = 15.0
MOST_BAR_MM2 = 0.5  # section of a bar that pliers or fingers can break


def longest_free_leg_mm(radius_mm: float, young_modulus_mpa: float) -> float:
    """Return how long a leg may stand free while it prints: 44 mm at r 1.66, 16 mm at r 0.8, in PLA.

    A force F at the tip of a cantilever of length L moves it by F L³ / 3 E I (Euler and Bernoulli),
    with I = pi r⁴ / 4 for a round section; 3 E I / L³ = `LEAST_STIFFNESS_N_MM` gives L. A leaning
    leg deflects less under a level force, and whatever joins it to another ends its free length.
    """
    inertia = pi * radius_mm**4 / 4
    return float((3 * young_modulus_mpa * inertia / LEAST_STIFFNESS_N_MM) ** (1 / 3))
