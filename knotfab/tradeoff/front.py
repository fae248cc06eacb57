"""Compare points over the pictures: those that nothing beats, and what a step of a knob buys."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf, log
from typing import Any

from knotfab.tradeoff.measure import Run
from knotfab.tradeoff.points import KNOBS, Effect, Point
from knotfab_formats.search import SearchSettings

__all__ = ["Measured", "Step", "frontier", "halve", "list_effects", "list_steps", "merge_turns"]

_LEAST = 1e-6  # an error of 0 has no logarithm
_NEAR = log(1.15)  # points within 15 % in seconds or in error are near the front
_DEAR = log(4.0)  # more of the middle's seconds is only worth while for less error


@dataclass(frozen=True)
class Measured:
    """A point's runs on the first so many pictures, one each; means of their figures.

    `clock`: what seconds are, "cpu" or "wall".
    """

    point: Point
    runs: tuple[Run, ...]
    clock: str = "cpu"

    def mean(self, key: str) -> float:
        """Return the mean of a figure of its runs."""
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
        """The seconds of a picture: radius, search and sweep together."""
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
        """Mean curvature times the tube's radius: the less the more graceful."""
        return self.mean("curvature")

    @property
    def legible(self) -> float | None:
        """Measure how well the picture is read 45 degrees aside: the less the better hidden."""
        found = [run.legible for run in self.runs if run.legible is not None]
        return statistics.fmean(found) if found else None

    @property
    def feasible(self) -> bool:
        return all(run.feasible for run in self.runs)

    @property
    def repairs(self) -> int:
        return sum(run.repairs for run in self.runs)

    def over(self, pictures: int) -> Measured:
        """Return the same on the first so many pictures."""
        return replace(self, runs=self.runs[:pictures])

    def keeps(self, middle: Measured) -> bool:
        """Tell whether its knots are sound, as graceful as the middle's, and as well hidden."""
        # the most curvature of a point on the front, over the middle's
        if not self.feasible or self.curvature > 1.1 * middle.curvature:
            return False
        # legibility from aside over the middle's, likewise
        return (self.legible or 0.0) <= (middle.legible or 0.0) + 0.05


def merge_turns(turns: Sequence[Run]) -> Run:
    """Merge runs of the same point and picture into one: the first one's knots, the median of the seconds."""
    keys = ("radius_s", "search_s", "sweep_s", "cpu_s")
    times = {key: statistics.median(getattr(run, key) for run in turns) for key in keys}
    return replace(turns[0], feasible=all(run.feasible for run in turns), **times)


def frontier(measured: Sequence[Measured], middle: Measured | None = None) -> list[Measured]:
    """Return the points that no other beats in both error and seconds, fastest first.

    Args:
        measured: on the same pictures.
        middle: only points that keep its grace and legibility count.
    """
    best: list[Measured] = []
    sound = [m for m in measured if (m.feasible if middle is None else m.keeps(middle))]
    for one in sorted(sound, key=lambda m: (m.seconds, m.error)):
        if not best or one.error < best[-1].error:
            best.append(one)
    return best


def _distance(one: Measured, others: Sequence[Measured]) -> float:
    """Return the logarithm of the factor by which its seconds and its error must shrink to be unbeaten.

    Below 0 on the front: by so much they might grow. The additive epsilon indicator (Zitzler et al. 2003).
    """
    farther = -inf
    for other in others:
        if other is not one:
            slower, worse = one.seconds / other.seconds, one.error / other.error
            farther = max(farther, min(log(slower), log(worse)))
    return farther


def _in_vain(one: Measured, middle: Measured) -> bool:
    """Tell whether it takes several times the middle's seconds and is no better, as a slow renderer is."""
    dear = log(one.seconds / middle.seconds) > _DEAR
    return dear and log(one.error / middle.error) > -_NEAR


def halve(
    measured: Sequence[Measured], middle: Measured, beside: Sequence[Measured]
) -> list[Point]:
    """Return the half of the points that are nearest to the front, the best and the fastest on it first.

    What takes several times the middle's seconds and is no better is known well enough.

    Args:
        beside: points that the front is drawn with, and that stay in any case.
    """
    sound = [m for m in (*measured, *beside) if m.keeps(middle)]
    own = [m for m in measured if m.keeps(middle) and not _in_vain(m, middle)]
    ends = {id(m) for m in (frontier(own)[:1] + frontier(own)[-1:])}
    ranked = sorted(own, key=lambda m: (id(m) not in ends, _distance(m, sound)))
    return [m.point for m in ranked[: ceil(len(measured) / 2)]]


@dataclass(frozen=True)
class Step:
    """A step from one value of a knob to the next: IoU gained, and by which factor it takes longer."""

    knob: str
    before: str
    after: str
    iou: float
    seconds: float
    pictures: int  # it was measured on

    def __str__(self) -> str:
        gain = f"{self.iou:+.4f}".replace("0.", ".").replace("-", "−")
        return f"{self.knob} {self.before} → {self.after}: {gain} IoU, ×{self.seconds:.2f} seconds"


def _by_settings(measured: Sequence[Measured]) -> dict[SearchSettings, Measured]:
    return {m.point.settings: m for m in measured}


def list_steps(measured: Sequence[Measured], middle: SearchSettings) -> list[Step]:
    """List what each step of each knob buys and costs, the others as in the middle, on the same pictures."""
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
    """List by knob the values on or near the front, and what each does to seconds and error."""
    known = _by_settings(measured)
    sound = [m for m in measured if m.keeps(middle)]
    found: dict[str, dict[Any, Effect]] = {}
    for knob in KNOBS:
        for value in knob.values:
            one = known.get(knob.turn(middle.point.settings, value))
            if one is None or one is middle or one not in sound or _in_vain(one, middle):
                continue
            if _distance(one, sound) > _NEAR:
                continue
            effect = log(one.seconds / middle.seconds), log(one.error / middle.error)
            found.setdefault(knob.name, {})[value] = effect
    return found
