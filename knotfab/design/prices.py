"""Prices of limits: those that bind, and the IoU that a short search reaches when one is loosened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from knotfab.problem import Problem, SearchResult, Start
from knotfab.render.forms import COMPILED, Forms
from knotfab.search.search import search
from knotfab_formats.report import Price
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import SearchSettings

__all__ = ["SHORT", "binding_limits", "price_limits"]

SHORT: dict[str, Any] = {
    "method": "flow",
    "network_start": "filling",
    "coarse_px": 160,
    "fine_px": 224,
    "coarse_iterations": 32,
    "fine_iterations": 16,
    "settle_iterations": 16,
    "winners_every": 4,
    "depth_candidates": 4,
}
_NEAR = 0.05  # a limit that is kept by less than this share of itself binds
_GAIN = 0.005  # IoU below which a limit costs nothing
_USUAL_CLEARANCE = 0.4  # mm, a scene's default
_KEYS = {  # for each limit: its key, its name, and the figure of the knots found without it
    "bend": ("[material] min_bend_radius_mm", "the bend limit", "bends to {} mm"),
    "clearance": ("[piece] clearance_mm", "the clearance", "leaves gaps of {} mm"),
    "region": ("[region] size_mm", "the region", "takes {} mm of room"),
    "length": ("[material] max_length_mm", "the length budget", "is {} mm long"),
}


def _word(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(_word(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float | int) else str(value)


def binding_limits(
    problem: Problem, result: SearchResult, roomy: SettledRegion
) -> dict[str, Problem]:
    """Return the limits that are broken, or kept by little, each with the problem in which it is loosened.

    The tube's own bend limit and the usual clearance are no choice of the scene's, so they are not among
    them. `roomy`: a region in which nothing is in the picture's way.
    """
    state, limits = result.feasibility, result.feasibility.limits
    own_bend = limits.radius + 0.5 * problem.clearance
    close = {
        "bend": limits.bend_radius > own_bend * (1 + 1e-9)
        and state.bend_mm < (1 + _NEAR) * limits.bend_radius,
        "clearance": problem.clearance > _USUAL_CLEARANCE
        and state.gap_mm < (1 + _NEAR) * limits.separation,
        "region": problem.region != roomy and state.outside_mm > -0.25 * limits.radius,
        "length": state.length_mm > (1 - _NEAR) * limits.length,
    }
    return {name: _loosen(problem, (name,), roomy) for name, binds in close.items() if binds}


def _loosen(problem: Problem, names: Sequence[str], roomy: SettledRegion) -> Problem:
    """Return the problem without these limits."""
    free: dict[str, tuple[str, Any]] = {
        "bend": ("bend_radius", None),
        "clearance": ("clearance", _USUAL_CLEARANCE),
        "region": ("region", roomy),
        "length": ("length", 1e9),
    }
    return replace(problem, **dict(free[name] for name in names))


def price_limits(
    problem: Problem,
    start: Start,
    result: SearchResult,
    settings: SearchSettings,
    roomy: SettledRegion,
    forms: Forms = COMPILED,
    iou: float | None = None,
) -> tuple[Price, ...]:
    """Price each limit that binds in IoU, dearest first; where none costs by itself, all together.

    The IoU is that of the view that is drawn worst.

    Args:
        start: what `result` started from. iou: that of the part that keeps the limits, where it
            is not that of `result`.
    """
    short, radius = settings.but(**SHORT), result.knots.radius_mm
    candidates = binding_limits(problem, result, roomy)
    here = result.iou_estimate if iou is None else iou

    def price(names: tuple[str, ...], free: Problem) -> Price:
        other = search(free, start, radius, short, forms=forms)
        return _price(names, problem, other, result, here)

    found = [price((name,), free) for name, free in candidates.items()]
    found = [
        p for p in found if p.iou_without > here + _GAIN or (p.met_without and iou is not None)
    ]
    if not found and len(candidates) > 1:
        names = tuple(candidates)
        both = price(names, _loosen(problem, names, roomy))
        found = [both] if both.iou_without > here + _GAIN else []
    return tuple(sorted(found, key=lambda p: (p.met_without, p.iou_without), reverse=True))


def _price(
    names: tuple[str, ...],
    problem: Problem,
    other: SearchResult,
    result: SearchResult,
    here: float,
) -> Price:
    radius = result.knots.radius_mm
    points = np.concatenate([k.points for k in other.knots.knots])
    extents = tuple((np.ptp(points, axis=0) + 2 * radius).round(2).tolist())
    limits = result.feasibility.limits
    asked = {
        "bend": limits.bend_radius,
        "clearance": limits.clearance,
        "region": problem.region.size_mm,
        "length": limits.length,
    }
    needed = {
        "bend": other.feasibility.bend_mm,
        "clearance": other.feasibility.gap_mm - 2 * radius,
        "region": extents,
        "length": other.feasibility.length_mm,
    }
    found = [needed[name] for name in names]
    return Price(
        limits=names,
        keys=tuple(_KEYS[name][0] for name in names),
        asked=tuple(asked[name] for name in names),
        needed=tuple(found),
        iou=here,
        iou_without=other.iou_estimate,
        met_without=not other.feasibility.violations,
        sentence=_tell(names, asked, found, here, other),
    )


def _tell(
    names: tuple[str, ...],
    asked: dict[str, Any],
    needed: Sequence[Any],
    here: float,
    other: SearchResult,
) -> str:
    """Return what limits cost, in a sentence."""
    named = " and ".join(f"{_KEYS[n][1]} ({_KEYS[n][0]} = {_word(asked[n])} mm)" for n in names)
    each = zip(names, needed, strict=True)
    found = " and ".join(_KEYS[name][2].format(_word(value)) for name, value in each)
    rest = "; another limit is broken then" if other.feasibility.violations else ""
    verb = "binds" if len(names) == 1 else "bind together"
    return (
        f"{named[0].upper()}{named[1:]} {verb}: the IoU is {here:.3f} with it, and "
        f"{other.iou_estimate:.3f} without it, by a short search whose piece {found}{rest}."
    )
