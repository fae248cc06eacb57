"""What limits cost: which of them bind, and what a short search reaches when one of them is loosened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from knotfab.errors import SceneError
from knotfab.problem import Infeasible, Problem, SearchResult
from knotfab.scene.model import Region
from knotfab.scene.settings import SearchSettings
from knotfab.search.search import search
from knotfab.search.several import SeveralProblem, search_several
from knotfab.start.filling import Template, fill, simple_curves

__all__ = ["SHORT", "Price", "binding_limits", "prices", "prices_several", "sparser"]

Array = NDArray[np.float64]
Asked = TypeVar("Asked", Problem, SeveralProblem)

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
# all but no steps
_STILL = {**SHORT, "coarse_iterations": 0, "fine_iterations": 0, "settle_iterations": 2}
_NEAR = 0.05  # a limit that is kept by less than this share of itself binds
_GAIN = 0.005  # IoU below which a limit costs nothing
_USUAL_CLEARANCE = 0.4  # mm, a scene's default
_WIDER = (1.5, 2.5, 4.0, 6.5, 10.0, 16.0)  # spacings of the strands that are tried, in tube radii
_RINGS = (1.1, 1.3, 1.6)  # a last ring's size in the least that may be bent
_KEYS = {  # of a limit: its key, its name, and what the knots found without it have
    "bend": ("[material] min_bend_radius_mm", "the bend limit", "bends to {} mm"),
    "clearance": ("[piece] clearance_mm", "the clearance", "leaves gaps of {} mm"),
    "region": ("[region] size_mm", "the region", "takes {} mm of room"),
    "length": ("[material] max_length_mm", "the length budget", "is {} mm long"),
}


@dataclass(frozen=True)
class Price:
    """One limit that binds (or several together), and the IoU with it and without it.

    `needed` is what the knots have that were found without it, in mm: their tightest bend, closest
    centre lines less two radii, extents with the tube, or length.
    """

    limits: tuple[str, ...]
    keys: tuple[str, ...]
    asked: tuple[Any, ...]
    needed: tuple[Any, ...]
    iou: float
    iou_without: float
    met_without: bool

    @property
    def sentence(self) -> str:
        """For a reader."""
        named = " and ".join(
            f"{_KEYS[limit][1]} ({key} = {_said(asked)} mm)"
            for limit, key, asked in zip(self.limits, self.keys, self.asked, strict=True)
        )
        found = " and ".join(
            _KEYS[limit][2].format(_said(needed))
            for limit, needed in zip(self.limits, self.needed, strict=True)
        )
        rest = "" if self.met_without else "; another limit is broken then"
        verb = "binds" if len(self.limits) == 1 else "bind together"
        return (
            f"{named[0].upper()}{named[1:]} {verb}: the IoU is {self.iou:.3f} with it, and "
            f"{self.iou_without:.3f} without it, by a short search whose piece {found}{rest}."
        )

    def to_dict(self) -> dict[str, Any]:
        """The price in report.json."""
        return {**asdict(self), "sentence": self.sentence}


def _said(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(_said(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float | int) else str(value)


def binding_limits(problem: Asked, result: SearchResult, roomy: Region) -> dict[str, Asked]:
    """The limits that are broken, or kept by little, each with the problem in which it is loosened.

    The tube's own bend limit and the usual clearance are no choice of the scene's, so they are not among
    them. `roomy`: a region in which nothing is in the picture's way.
    """
    state, limits = result.standing, result.standing.limits
    own_bend = limits.radius + 0.5 * problem.clearance
    close = {
        "bend": limits.bend_radius > own_bend * (1 + 1e-9)
        and state.bend_mm < (1 + _NEAR) * limits.bend_radius,
        "clearance": problem.clearance > _USUAL_CLEARANCE
        and state.gap_mm < (1 + _NEAR) * limits.separation,
        "region": problem.region != roomy and state.outside_mm > -0.25 * limits.radius,
        "length": state.length_mm > (1 - _NEAR) * limits.length,
    }
    return {name: _loosened(problem, (name,), roomy) for name, binds in close.items() if binds}


def _loosened(problem: Asked, names: Sequence[str], roomy: Region) -> Asked:
    """The problem without these limits."""
    bend = "bend_radius" if isinstance(problem, Problem) else "bend"
    free: dict[str, tuple[str, Any]] = {
        "bend": (bend, None),
        "clearance": ("clearance", _USUAL_CLEARANCE),
        "region": ("region", roomy),
        "length": ("length", 1e9),
    }
    return replace(problem, **dict(free[name] for name in names))


def prices(
    problem: Problem,
    template: Template,
    result: SearchResult,
    settings: SearchSettings,
    roomy: Region,
    device: str = "cpu",
    iou: float | None = None,
) -> tuple[Price, ...]:
    """What each limit that binds costs in IoU, dearest first; where none does alone, all together.

    Args:
        template: what `result` started from. iou: that of the part that keeps the limits, where it
            is not that of `result`.
    """
    radius = result.knots.radius_mm

    def searched(free: Problem) -> SearchResult:
        return _searched(free, template, radius, settings, device)

    return _prices(problem, result, roomy, searched, iou)


def prices_several(
    problem: SeveralProblem,
    curves: Sequence[Array],
    template: str,
    result: SearchResult,
    settings: SearchSettings,
    roomy: Region,
    device: str = "cpu",
) -> tuple[Price, ...]:
    """The same for several views, by the IoU of the view that is drawn worst.

    Args:
        curves: what `result` started from; `template` says why their type is known.
    """
    short = settings.model_copy(update=SHORT)
    radius = result.knots.radius_mm

    def searched(free: SeveralProblem) -> SearchResult:
        try:
            return search_several(free, curves, template, radius, short, device)
        except Infeasible as error:
            return error.result

    return _prices(problem, result, roomy, searched, None)


def _prices(
    problem: Asked,
    result: SearchResult,
    roomy: Region,
    searched: Callable[[Asked], SearchResult],
    iou: float | None,
) -> tuple[Price, ...]:
    candidates = binding_limits(problem, result, roomy)
    here = result.iou_estimate if iou is None else iou
    found = [
        _price((name,), problem, searched(free), result, here) for name, free in candidates.items()
    ]
    found = [
        p for p in found if p.iou_without > here + _GAIN or (p.met_without and iou is not None)
    ]
    if not found and len(candidates) > 1:
        names = tuple(candidates)
        both = _price(names, problem, searched(_loosened(problem, names, roomy)), result, here)
        found = [both] if both.iou_without > here + _GAIN else []
    return tuple(sorted(found, key=lambda p: (p.met_without, p.iou_without), reverse=True))


def _price(
    names: tuple[str, ...],
    problem: Problem | SeveralProblem,
    other: SearchResult,
    result: SearchResult,
    here: float,
) -> Price:
    radius = result.knots.radius_mm
    points = np.concatenate([k.points for k in other.knots.knots])
    extents = tuple((np.ptp(points, axis=0) + 2 * radius).round(2).tolist())
    limits = result.standing.limits
    asked = {
        "bend": limits.bend_radius,
        "clearance": limits.clearance,
        "region": problem.region.size_mm,
        "length": limits.length,
    }
    needed = {
        "bend": other.standing.bend_mm,
        "clearance": other.standing.gap_mm - 2 * radius,
        "region": extents,
        "length": other.standing.length_mm,
    }
    return Price(
        names,
        tuple(_KEYS[name][0] for name in names),
        tuple(asked[name] for name in names),
        tuple(needed[name] for name in names),
        here,
        other.iou_estimate,
        not other.standing.violations,
    )


def _searched(
    problem: Problem,
    template: Template,
    radius: float,
    settings: SearchSettings,
    device: str,
    steps: dict[str, Any] = SHORT,
) -> SearchResult:
    """A short search, as far as it came."""
    try:
        return search(problem, template, radius, settings.model_copy(update=steps), device)
    except Infeasible as error:
        return error.result


def sparser(
    problem: Problem,
    radius: float,
    knots: int | None,
    settings: SearchSettings,
    device: str = "cpu",
) -> SearchResult | None:
    """The best piece that keeps every limit, where the picture's own filling cannot: fewer strands.

    The picture is filled as by ever thicker tubes, whose strands lie further apart and bend less, at
    the piece's depth and then flat; the first result that is feasible is taken. The last tries
    are rings. None where there is none.
    """
    limits = problem.limits(radius)
    least = max(0.5 * limits.separation, limits.bend_radius) / radius
    wide = {*(w for w in _WIDER if w < least), *(least * w for w in _WIDER)}
    widest = 0.5 * float(np.sqrt(problem.polygon.area))
    templates = [
        fill(problem.polygon, spacing * radius, knots)
        for spacing in sorted(wide)
        if 0.5 * least < spacing and spacing * radius < widest
    ]
    flat = replace(problem, depth_mm=None)
    tries = [(t, asked, SHORT) for t in templates for asked in (problem, flat)]
    # a ring whose edges were evened bends more than a circle: the first size that serves
    tries += [(_ring(problem, w * least * radius, radius), flat, _STILL) for w in _RINGS]
    for template, asked, steps in tries:
        if not simple_curves(list(template.curves)):
            continue
        try:
            result = _searched(asked, template, radius, settings, device, steps)
        except SceneError:  # no place for the knot that is asked for
            continue
        if not result.standing.violations:
            return result
    return None


def _ring(problem: Problem, least: float, radius: float) -> Template:
    """The largest circle in the silhouette, or about its middle a larger one that may be bent so."""
    line = shapely.maximum_inscribed_circle(problem.polygon)
    middle = np.asarray(line.coords[0])
    size = max(line.length - radius, least, 2 * radius)
    turn = 2 * np.pi * np.arange(256) / 256
    ring = middle + size * np.stack([np.cos(turn), np.sin(turn)], 1)
    return Template((ring,), problem.polygon, radius)
