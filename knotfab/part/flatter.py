"""Estimate what a flatter piece would take to print, and how flat it must be to keep the printer's limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab.geometry.overhang import Rules, Strands
from knotfab.knots import Knot, Knots
from knotfab.part.orient import (
    Ranked,
    estimate_print_minutes,
    estimate_supports_cm3,
    propose_turns,
    rank_turns,
    strands_of,
)
from knotfab_formats.report import Flatter

__all__ = ["FLATTER", "Flattening", "estimate_flatter", "flatter_depth"]


STEPS = 5  # halvings, to a thirty-second of the depth
AIM = 0.95  # a share of the limit: the search that follows lays the strands anew
ROUND_MM = 0.1
FLATTER = (0.6, 0.0)  # shares of the depth that are estimated for the report as well


@dataclass(frozen=True)
class Flattening:
    """The changes for supports beyond the printer's limit and pegs that do not hold: depths in mm.

    `from_mm` is the depth of the first search, `to_mm` of the one that was kept (equal where
    none followed), and `proposed_mm` what the kept one would still need, None where nothing. `unheld` says
    why no pegs held the first, `wall_mm` how far before its wall the first and the kept one stand.
    """

    from_mm: float
    to_mm: float
    proposed_mm: float | None
    unheld: str = ""
    wall_mm: tuple[float, float] = (0.0, 0.0)


def flatter_depth(knots: Knots, depth_mm: float, rules: Rules) -> float | None:
    """Return the largest extent along z, mm, at which some pose is estimated to keep `max_support_cm3`.

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
        _, poses = _rank_flattened(knots, share, rules)
        return min(estimate_supports_cm3(p.estimate) for p in poses)

    low, high = 0.0, 1.0
    if least(high) <= limit or least(low) > limit:
        return None
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle) <= limit else (low, middle)
    depth = float(np.floor(low * depth_mm / ROUND_MM) * ROUND_MM)
    return depth if depth > 0 else None


def estimate_flatter(
    knots: Knots, sliced: Flatter, rules: Rules, shares: Sequence[float] = FLATTER
) -> list[Flatter]:
    """Estimate the cost of the same curves with less depth, each in its own best pose.

    An estimate from centre lines: the strands cost by their length what the slicer says of the piece as
    it is, less supports and layers; these are the pose's, supports scaled as the slicer's are to the
    estimate of the piece as it is. A new search with less depth lays the strands anew.

    Args:
        knots: in scene coordinates. sliced: the piece as it is, by the slicer.
    """
    whole, poses = _rank_flattened(knots, 1.0, rules)
    as_is = poses[0].estimate
    scale = sliced.support_grams / as_is.filament_cm3 if as_is.filament_cm3 > 0 else 0.0
    strands_hours = sliced.hours - estimate_print_minutes(as_is) / 60
    strands_grams = sliced.grams - sliced.support_grams
    found = []
    for share in shares:
        flat, poses = _rank_flattened(knots, share, rules)
        length = float(flat.length.sum() / whole.length.sum())
        best = poses[0].estimate
        supports = scale * best.filament_cm3
        hours = length * max(strands_hours, 0.0) + estimate_print_minutes(best) / 60
        grams = length * strands_grams + supports
        found.append(Flatter(share, round(hours, 2), round(grams, 1), round(supports, 1)))
    return found


def _rank_flattened(knots: Knots, share: float, rules: Rules) -> tuple[Strands, list[Ranked]]:
    """Return the strands with their depths scaled, and their poses, the best first."""
    flat = np.array([1.0, 1.0, share])
    scaled = (Knot(k.points * flat, closed=k.closed) for k in knots.knots)
    # rods that stand for the strands
    strands = strands_of(Knots(tuple(scaled), knots.radius_mm), most=2000)
    return strands, rank_turns(strands, propose_turns(strands), rules)
