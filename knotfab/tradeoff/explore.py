"""Choose points and pictures to measure: one knob at a time, then halving over combinations.

Successive halving (Jamieson and Talwalkar 2016): all on few pictures, the better half on twice as many,
and so on; presets see them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from knotfab.tradeoff.bench import Bench
from knotfab.tradeoff.front import Measured, frontier, halve, list_effects
from knotfab.tradeoff.points import PRESET, Point, combine
from knotfab_formats.search import SearchSettings

__all__ = ["Explored", "explore", "list_rungs"]


@dataclass(frozen=True)
class Explored:
    """Every point that was measured on a picture at least, and what it is compared over.

    `compared`: the first so many pictures, on which all presets were measured; `middle` is what knobs are
    turned around.
    """

    measured: tuple[Measured, ...]
    middle: Measured
    compared: int

    @property
    def whole(self) -> list[Measured]:
        """The points that are comparable, over the same pictures."""
        return [m.over(self.compared) for m in self.measured if len(m.runs) >= self.compared]

    @property
    def front(self) -> list[Measured]:
        """Return the points of these that nothing beats."""
        return frontier(self.whole, self.middle.over(self.compared))

    def sets_apart(self, one: Measured) -> bool:
        """Tell whether it saw fewer pictures than are compared, or may not stand on the front."""
        middle = self.middle.over(self.compared)
        return len(one.runs) < self.compared or not one.over(self.compared).keeps(middle)

    def place(self, one: Measured) -> tuple[float, float]:
        """Return (seconds, error) over the pictures compared; for a point with fewer, what they would be.

        It is taken to stand to the middle as it does on the pictures that it has seen.
        """
        seen = min(len(one.runs), self.compared)
        one, here, all_ = one.over(seen), self.middle.over(seen), self.middle.over(self.compared)
        return one.seconds * all_.seconds / here.seconds, one.error * all_.error / here.error


def list_rungs(pictures: int) -> list[int]:
    """List how many pictures each rung measures: an eighth of them, twice as many, …, all."""
    sizes = [-(-pictures // 8)]
    while sizes[-1] < pictures:
        sizes.append(min(2 * sizes[-1], pictures))
    return sizes


def explore(
    bench: Bench, points: Sequence[Point], middle: SearchSettings, combinations: int
) -> Explored | None:
    """Measure points, combinations of their good values, and ever fewer of both on ever more pictures.

    Returns:
        None where there was no time to measure the middle once.
    """
    total = len(bench.studies)
    presets = [p for p in points if p.knob == PRESET or p.settings == middle]
    alive = [p for p in points if p not in presets]
    first, *others = list_rungs(total)
    bench.measure(presets, first)
    measured = bench.measure([*presets, *alive], first)
    at = _find(measured, middle)
    if at is not None and combinations:
        whole = [m for m in measured if len(m.runs) >= len(at.runs)]
        effects = list_effects([m.over(len(at.runs)) for m in whole], at)
        made = combine(middle, effects, points, combinations, middle.seed)
        bench.measure(made, first)
        alive += made
    points = [*presets, *alive]
    for before, pictures in zip([first, *others], others, strict=False):
        measured = [m.over(before) for m in bench.measured(points) if len(m.runs) >= before]
        at = _find(measured, middle)
        if at is None:
            break
        beside = [m for m in measured if m.point in presets]
        alive = halve([m for m in measured if m.point in alive], at, beside)
        bench.measure(presets, pictures)
        bench.measure(alive, pictures)
    measured = bench.measured(points)
    at = _find(measured, middle)
    if at is None:
        return None
    seen = [len(m.runs) for m in measured if m.point in presets]
    return Explored(tuple(measured), at, min(seen))


def _find(measured: Sequence[Measured], settings: SearchSettings) -> Measured | None:
    return next((m for m in measured if m.point.settings == settings), None)
