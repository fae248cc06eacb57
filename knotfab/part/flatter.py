"""How flat a piece must be for its supports to keep the printer's limit, where no pose does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.geometry.overhang import Rules
from knotfab.knots import Knot, Knots
from knotfab.part.orient import estimate_supports_cm3, propose_turns, rank_turns, strands_of

__all__ = ["Flattening", "flatter_depth"]


STEPS = 5  # of halving, to a thirty-second of the depth
AIM = 0.95  # of the limit: the search that follows lays the strands anew
ROUND_MM = 0.1


@dataclass(frozen=True)
class Flattening:
    """What was done about supports beyond the printer's limit: depths in mm.

    `from_mm` is the depth of the first search, `to_mm` of the one that was kept (equal where
    none followed), and `proposed_mm` what the kept one would still need, None where nothing.
    """

    from_mm: float
    to_mm: float
    proposed_mm: float | None


def flatter_depth(knots: Knots, depth_mm: float, rules: Rules) -> float | None:
    """The largest extent along z, mm, at which some pose is estimated to keep `max_support_cm3`.

    The curves' depths are scaled, all else stays; so the number is a proposal, for a new search.

    Args:
        knots: in scene coordinates, with centre lines that extend `depth_mm` along z.

    Returns:
        None: there is no limit, it is kept as it is, or not even a flat piece would keep it.
    """
    if rules.max_support_cm3 is None or not rules.supports or rules.powder:
        return None
    limit = AIM * rules.max_support_cm3

    def least(share: float) -> float:
        flat = np.array([1.0, 1.0, share])
        scaled = Knots(tuple(Knot(k.points * flat) for k in knots.knots), knots.radius_mm)
        strands = strands_of(scaled, most=2000)
        return min(
            estimate_supports_cm3(p.estimate)
            for p in rank_turns(strands, propose_turns(strands), rules)
        )

    low, high = 0.0, 1.0
    if least(high) <= limit or least(low) > limit:
        return None
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle) <= limit else (low, middle)
    depth = float(np.floor(low * depth_mm / ROUND_MM) * ROUND_MM)
    return depth if depth > 0 else None
