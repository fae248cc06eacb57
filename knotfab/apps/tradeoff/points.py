"""Choose and compare the points of a trade-off: presets, one knob turned at a time, combinations."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf, log
from typing import Any, TypeVar

import numpy as np

from knotfab.apps.tradeoff.measure import Run
from knotfab_formats.search import PRESETS, SearchSettings

PRESET = "preset"
COMBINED = "combined"
_TRIED = 4000  # random combinations whose cost and error are predicted
_LEFT = 0.5  # share of knobs that a combination leaves unchanged

Costed = TypeVar("Costed")
Effect = tuple[float, float]  # log of the ratio to the middle, of seconds and of the error


@dataclass(frozen=True)
class Point:
    """Settings to be measured. `knob` names what was turned: a knob, "preset" or "combined"."""

    knob: str
    label: str
    settings: SearchSettings


@dataclass(frozen=True)
class Knob:
    """A setting, or several that change together, and the values to try, cheapest first.

    A knob without `keys` multiplies the iterations of all phases. The values of an `alike` knob have no
    order, so each of them is one step from the middle's.
    """

    name: str
    unit: str
    keys: tuple[str, ...]
    values: tuple[Any, ...]
    alike: bool = False

    def own(self, settings: SearchSettings) -> Any:
        """Return the knob's value in these settings."""
        if not self.keys:
            return 1.0
        found = tuple(getattr(settings, key) for key in self.keys)
        return found if len(found) > 1 else found[0]

    def turn(self, settings: SearchSettings, value: Any) -> SearchSettings:
        """Return the settings with the knob at this value."""
        if not self.keys:
            return settings if value == 1.0 else settings.scaled(value)
        given = value if len(self.keys) > 1 else (value,)
        return settings.but(**dict(zip(self.keys, given, strict=True)))

    def label(self, value: Any) -> str:
        """Format a value for readers."""
        parts = value if isinstance(value, tuple) else (value,)
        return "flow" if parts[0] == "flow" else self.unit.format(*parts)

    def ordered(self, settings: SearchSettings) -> list[Any]:
        """Return all values and the settings' own, cheapest first; `alike` ones after the settings' own."""
        own = self.own(settings)
        others = [v for v in self.values if v != own]
        if self.alike:
            return [own, *others]
        return sorted([own, *others], reverse=self.values[0] > self.values[-1])


KNOBS = (
    Knob("iterations", "× {:g}", (), (0.125, 0.25, 0.5, 0.75, 1.5)),
    Knob("picture size", "{:g} px", ("fine_px",), (256, 384, 512, 1024)),
    Knob("coarse picture", "{:g} px coarse", ("coarse_px",), (128, 256)),
    Knob("vertex spacing", "{:g} r", ("edge_radii",), (0.6, 0.45)),
    Knob("last spacing", "{:g} r last", ("settle_edge_radii",), (0.6, 0.3)),
    Knob("winner search", "winners every {:g}", ("winners_every",), (8, 1)),
    Knob("sharpness", "τ {:g}", ("tau",), (6.0, 12.0, 36.0)),
    Knob("precision", "{} precision", ("precision",), ("double",), alike=True),
    Knob("renderer", "{} distance", ("renderer",), ("capsule", "ellipse"), alike=True),
    Knob("depth candidates", "{:g} depths", ("depth_candidates",), (100, 600)),
    Knob("radius candidates", "{:g} radii", ("radius_candidates",), (4, 16)),
    Knob("thicker tube", "{:g} given", ("radius_give",), (0.02, 0.008, 0.0)),
    Knob("thinner tube", "from {:g} of the usual radius", ("radius_from",), (0.75, 0.6)),
    Knob("effect tolerance", "effects {:g} px", ("tolerance_px",), (1.0, 0.1)),
    Knob(
        "mesh",
        "outline within {:g} px, {:g} sides",
        ("outline_px", "mesh_sides"),
        ((1.0, 18), (0.25, 48)),
    ),
    Knob("grace", "grace {:g}", ("grace",), (0.05, 0.0), alike=True),
    Knob(
        "search",
        "{} {:g} × {:g}",
        ("method", "network_depth", "network_width"),
        (("inn", 4, 32), ("inn", 8, 128), ("inn+flow", 4, 32), ("inn+flow", 8, 128)),
        alike=True,
    ),
)


def list_points(own: SearchSettings | None = None) -> list[Point]:
    """List the presets, and the points that turn one knob of `own` (`standard` by default)."""
    middle = own or PRESETS["standard"]
    found = [Point(PRESET, name, settings) for name, settings in PRESETS.items()]
    if middle not in PRESETS.values():
        found.append(Point(PRESET, "the scene's", middle))
    for knob in KNOBS:
        for value in knob.values:
            if value != knob.own(middle):
                found.append(Point(knob.name, knob.label(value), knob.turn(middle, value)))
    return found


def combine(
    middle: SearchSettings,
    effects: Mapping[str, Mapping[Any, Effect]],
    known: Sequence[Point],
    count: int,
    seed: int = 0,
) -> list[Point]:
    """Return up to `count` promising combinations of values, spread over the range of cost.

    Many random combinations are drawn by the seed, and of each class of cost the one with the least
    predicted error is returned. The effects of single knobs are assumed to multiply.

    Args:
        effects: of the values on or near the front, by knob.
        known: points measured already.
    """
    turned = [knob for knob in KNOBS if effects.get(knob.name)]
    if not (turned and count):
        return []
    random = np.random.default_rng(seed)
    # 0 leaves a knob unchanged
    sizes = [len(effects[knob.name]) for knob in turned]
    chosen = random.integers(1, 1 + np.array(sizes), (_TRIED, len(turned)))
    chosen = np.unique(chosen * (random.random(chosen.shape) >= _LEFT), axis=0)
    logs = [np.array([(0.0, 0.0), *effects[knob.name].values()]) for knob in turned]
    foretold = sum(log[choice] for log, choice in zip(logs, chosen.T, strict=True))
    costs, errors = np.asarray(foretold).T
    bins = np.linspace(costs.min(), costs.max(), count + 1)[1:-1]
    number = np.searchsorted(bins, costs)
    seen, found = {point.settings for point in known} | {middle}, []
    for one in range(count):
        members = np.flatnonzero(number == one)
        for row in members[np.argsort(errors[members], kind="stable")]:
            point = _combine_values(middle, turned, effects, chosen[row].tolist())
            if point.settings not in seen:
                seen.add(point.settings)
                found.append(point)
                break
    return found


def _combine_values(
    middle: SearchSettings,
    turned: Sequence[Knob],
    effects: Mapping[str, Mapping[Any, Effect]],
    chosen: Sequence[int],
) -> Point:
    """Turn each knob to the value with the chosen number, counted from 1; 0 leaves it unchanged."""
    settings, labels = middle, []
    for knob, choice in zip(turned, chosen, strict=True):
        if choice:
            value = list(effects[knob.name])[choice - 1]
            settings = knob.turn(settings, value)
            labels.append(knob.label(value))
    return Point(COMBINED, ", ".join(labels), settings)


def list_changes(settings: SearchSettings, other: SearchSettings) -> dict[str, tuple[Any, Any]]:
    """Return by key what differs from other settings, as (theirs, these)."""
    theirs, these = other.model_dump(), settings.model_dump()
    return {key: (theirs[key], these[key]) for key in these if these[key] != theirs[key]}


# comparing measured points

_LEAST = 1e-6  # least error, so that it has a logarithm
_NEAR = log(1.15)  # points within 15 % of the front, in seconds or in error, are near it
_DEAR = log(4.0)  # slower than this, against the middle, a point must have less error


@dataclass(frozen=True)
class Measured:
    """A point's runs, one for each of the first pictures, and the means of their figures.

    `clock` says which seconds count, "cpu" or "wall".
    """

    point: Point
    runs: tuple[Run, ...]
    clock: str = "cpu"

    def mean(self, key: str) -> float:
        """Return the mean over the runs of the field `key`."""
        return statistics.fmean(getattr(run, key) for run in self.runs)

    @property
    def iou(self) -> float:
        return self.mean("iou")

    @property
    def least_iou(self) -> float:
        return min(run.iou or 0.0 for run in self.runs)

    @property
    def error(self) -> float:
        """1 - IoU."""
        return max(1.0 - self.iou, _LEAST)

    @property
    def seconds(self) -> float:
        """Mean time for one picture: choice of radius, search and sweep."""
        if self.clock == "cpu":
            return self.mean("cpu_s")
        return self.mean("radius_s") + self.mean("search_s") + self.mean("sweep_s")

    @property
    def outline_px(self) -> float:
        return self.mean("outline_px")

    @property
    def facet_px(self) -> float:
        return self.mean("facet_px")

    @property
    def curvature(self) -> float:
        """Mean curvature times the tube's radius; lower is more graceful."""
        return self.mean("curvature")

    @property
    def legible(self) -> float | None:
        """How well the picture is read from 45 degrees to the side; lower is better hidden."""
        found = [run.legible for run in self.runs if run.legible is not None]
        return statistics.fmean(found) if found else None

    @property
    def feasible(self) -> bool:
        return all(run.feasible for run in self.runs)

    @property
    def repairs(self) -> int:
        return sum(run.repairs for run in self.runs)

    def over(self, pictures: int) -> Measured:
        """Return the point with only its runs on the first `pictures`."""
        return replace(self, runs=self.runs[:pictures])

    def keeps(self, middle: Measured) -> bool:
        """Return whether it may stand on the front: feasible, and as graceful and hidden as the middle.

        It may have 10 % more curvature than the middle, and 0.05 more legibility from the side.
        """
        if not self.feasible or self.curvature > 1.1 * middle.curvature:
            return False
        return (self.legible or 0.0) <= (middle.legible or 0.0) + 0.05


def merge_turns(turns: Sequence[Run]) -> Run:
    """Merge repeated runs into one with the median of their seconds and the first one's knots."""
    keys = ("radius_s", "search_s", "sweep_s", "cpu_s")
    times = {key: statistics.median(getattr(run, key) for run in turns) for key in keys}
    return replace(turns[0], feasible=all(run.feasible for run in turns), **times)


def frontier(measured: Sequence[Measured], middle: Measured | None = None) -> list[Measured]:
    """Return the points that no other beats in both error and seconds, fastest first.

    Args:
        measured: all on the same pictures.
        middle: leave out points that do not keep its grace and legibility.
    """
    sound = [m for m in measured if (m.feasible if middle is None else m.keeps(middle))]
    return list_unbeaten(sound, lambda m: (m.seconds, m.error))


def list_unbeaten(
    points: Iterable[Costed], costs: Callable[[Costed], tuple[float, float]]
) -> list[Costed]:
    """List the points that no other beats in both costs, cheapest in the first cost first."""
    best: list[Costed] = []
    for one in sorted(points, key=costs):
        if not best or costs(one)[1] < costs(best[-1])[1]:
            best.append(one)
    return best


def _distance_to_front(one: Measured, others: Sequence[Measured]) -> float:
    """Return the log of the factor by which seconds and error must shrink for the point to be unbeaten.

    On the front it is negative. This is the additive epsilon indicator (Zitzler et al. 2003).
    """
    farther = -inf
    for other in others:
        if other is not one:
            slower, worse = one.seconds / other.seconds, one.error / other.error
            farther = max(farther, min(log(slower), log(worse)))
    return farther


def _is_too_slow(one: Measured, middle: Measured) -> bool:
    """Return whether a point takes several times the middle's seconds and is no better."""
    dear = log(one.seconds / middle.seconds) > _DEAR
    return dear and log(one.error / middle.error) > -_NEAR


def halve(
    measured: Sequence[Measured], middle: Measured, beside: Sequence[Measured]
) -> list[Point]:
    """Return the half of the points nearest to the front, beginning with its fastest and its best.

    Points several times slower than the middle and no better are dropped.

    Args:
        beside: further points that count for the front but are not returned.
    """
    sound = [m for m in (*measured, *beside) if m.keeps(middle)]
    own = [m for m in measured if m.keeps(middle) and not _is_too_slow(m, middle)]
    ends = {id(m) for m in (frontier(own)[:1] + frontier(own)[-1:])}
    ranked = sorted(own, key=lambda m: (id(m) not in ends, _distance_to_front(m, sound)))
    return [m.point for m in ranked[: ceil(len(measured) / 2)]]


@dataclass(frozen=True)
class Step:
    """A step from one value of a knob to the next: the IoU gained, and the ratio of the seconds."""

    knob: str
    before: str
    after: str
    iou: float
    seconds: float
    pictures: int  # how many both values were measured on

    def __str__(self) -> str:
        gain = f"{self.iou:+.4f}".replace("0.", ".").replace("-", "−")
        return f"{self.knob} {self.before} → {self.after}: {gain} IoU, ×{self.seconds:.2f} seconds"


def _by_settings(measured: Sequence[Measured]) -> dict[SearchSettings, Measured]:
    return {m.point.settings: m for m in measured}


def list_steps(measured: Sequence[Measured], middle: SearchSettings) -> list[Step]:
    """List what each step of each knob buys and costs while the other knobs stay at the middle."""
    found, known = [], _by_settings(measured)
    for knob in KNOBS:
        values = [v for v in knob.ordered(middle) if knob.turn(middle, v) in known]
        for one, two in pairwise(values):
            before = values[0] if knob.alike else one
            at, to = known[knob.turn(middle, before)], known[knob.turn(middle, two)]
            pictures = min(len(at.runs), len(to.runs))
            at, to = at.over(pictures), to.over(pictures)
            labels = knob.label(before), knob.label(two)
            gain, factor = to.iou - at.iou, to.seconds / at.seconds
            found.append(Step(knob.name, *labels, gain, factor, pictures))
    return found


def list_effects(measured: Sequence[Measured], middle: Measured) -> dict[str, dict[Any, Effect]]:
    """Return by knob the effects of the values that are on or near the front."""
    known = _by_settings(measured)
    sound = [m for m in measured if m.keeps(middle)]
    found: dict[str, dict[Any, Effect]] = {}
    for knob in KNOBS:
        for value in knob.values:
            one = known.get(knob.turn(middle.point.settings, value))
            if one is None or one is middle or one not in sound or _is_too_slow(one, middle):
                continue
            if _distance_to_front(one, sound) > _NEAR:
                continue
            effect = log(one.seconds / middle.seconds), log(one.error / middle.error)
            found.setdefault(knob.name, {})[value] = effect
    return found
