"""Reduce a diagram's crossings by rerouting strands.

A strand that passes over (or under) all it meets may be laid anywhere else over (or under) the diagram:
along the way between its ends that crosses the fewest arcs. Each step is an isotopy. If no strand can be
shortened, random steps of equal length lead on (Reidemeister's third move is the least of them).
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterator
from dataclasses import dataclass

from knotfab_validators.knots.planar_diagram import (
    Passage,
    PlanarDiagram,
    faces,
    from_passages,
    simplify,
)

WORK = 300_000  # total crossings of the diagrams inspected: a second or two
STARTS = 4  # walks from the given diagram with different random choices, which share the work
TIE = 1e-3  # random share that breaks ties between ways of equal length


@dataclass(frozen=True)
class _Run:
    """Consecutive passages all above or all below: arcs[k] leads to crossings[k], the last arc leads away."""

    arcs: tuple[int, ...]
    crossings: tuple[int, ...]
    above: bool


def reroute(knot: PlanarDiagram, enough: int = 0, seed: int = 0) -> PlanarDiagram:
    """Return the diagram with the fewest crossings that is found; the search stops at `enough` of them."""
    walk = _Walk(WORK, random.Random(seed))
    best = first = walk.shorten(simplify(knot))
    share = walk.left / STARTS
    for k in range(1, STARTS + 1):
        here = first
        while here.crossings and walk.left > (STARTS - k) * share:
            if len(best.crossings) <= enough:
                return best
            here = walk.shorten(walk.reroute(here))
            if len(here.crossings) < len(best.crossings):
                best = here
    return best


def summands(knot: PlanarDiagram) -> list[PlanarDiagram]:
    """Split a knot's diagram into summands, by circles that meet it in only two arcs."""
    passages = _list_passages(knot)
    left, right = _faces_beside(knot)
    between: dict[tuple[int, int], int] = {}
    for arc in range(len(passages)):
        other = between.setdefault((left[arc], right[arc]), arc)
        if other != arc:
            inside = passages[other + 1 : arc + 1]
            outside = passages[arc + 1 :] + passages[: other + 1]
            return [
                part for run in (inside, outside) for part in summands(_close_summand(run, knot))
            ]
    return [knot]


def _close_summand(passages: list[Passage], knot: PlanarDiagram) -> PlanarDiagram:
    """Return the diagram of a summand from its passages, which include both of each of its crossings."""
    kept = {i: n for n, i in enumerate(dict.fromkeys(p.crossing for p in passages))}
    run = [Passage(kept[p.crossing], p.above) for p in passages]
    return from_passages({knot.components[0]: run}, [knot.signs[i] for i in kept])


@dataclass
class _Walk:
    """A random walk through diagrams; `left` is how many crossings may still be inspected."""

    left: float
    chance: random.Random

    def shorten(self, knot: PlanarDiagram) -> PlanarDiagram:
        """Return the diagram with every run laid along a shorter way, if there is one."""
        again = True
        while again:
            again = False
            for run in _longest_runs(knot):
                laid = self._lay_run(knot, run, fewer=True)
                if laid is not None:
                    knot, again = simplify(laid), True
                    break
        return knot

    def reroute(self, knot: PlanarDiagram) -> PlanarDiagram:
        """Lead part of a random run along another way, with no more crossings than before."""
        run = self.chance.choice(list(_longest_runs(knot)))
        begin = self.chance.randrange(len(run.crossings))
        end = self.chance.randrange(begin, len(run.crossings)) + 1
        part = _Run(run.arcs[begin : end + 1], run.crossings[begin:end], run.above)
        return simplify(self._lay_run(knot, part) or knot)

    def _lay_run(self, knot: PlanarDiagram, run: _Run, fewer: bool = False) -> PlanarDiagram | None:
        self.left -= len(knot.crossings)
        return None if self.left < 0 else _lay_run(knot, run, self.chance, fewer)


def _list_passages(knot: PlanarDiagram) -> list[Passage]:
    """Return the passages in order; passage k lies between arcs k - 1 and k."""
    found = [Passage(-1, False)] * len(knot.component)
    for i, (quad, sign) in enumerate(zip(knot.crossings, knot.signs, strict=True)):
        found[quad[2]] = Passage(i, False)
        found[quad[1 if sign > 0 else 3]] = Passage(i, True)
    return found


def _longest_runs(knot: PlanarDiagram) -> Iterator[_Run]:
    """Yield the longest runs of a knot's diagram, from one change between above and below to the next."""
    passages = _list_passages(knot)
    count = len(passages)
    turns = [k for k in range(count) if passages[k].above != passages[k - 1].above]
    for first, after in zip(turns, [*turns[1:], turns[0] + count] if turns else [], strict=True):
        members = [k % count for k in range(first, after)]
        arcs = ((first - 1) % count, *members)
        yield _Run(arcs, tuple(passages[k].crossing for k in members), passages[first].above)


def _lay_run(
    knot: PlanarDiagram, run: _Run, chance: random.Random, fewer: bool = False
) -> PlanarDiagram | None:
    """Lay a run along a shortest way; None if there is no other way (or, with `fewer`, no shorter one)."""
    left, right = _faces_beside(knot)
    way = _shortest_way(left, right, run, chance)
    if way is None or len(way) > len(run.crossings) - fewer:
        return None
    gone = set(run.crossings)
    signs = [sign for i, sign in enumerate(knot.signs) if i not in gone]
    number = {i: n for n, i in enumerate(i for i in range(len(knot.signs)) if i not in gone)}
    met: dict[int, Passage] = {}  # by the arc crossed: the run's passage there
    laid: list[Passage] = []
    for arc, to_right in way:
        crossing = len(signs)
        met[arc] = Passage(crossing, not run.above)
        laid.append(Passage(crossing, run.above))
        # at a right-handed crossing, the upper strand turns counter-clockwise onto the lower one
        signs.append(1 if to_right == run.above else -1)
    after: list[Passage] = []
    for k, passage in enumerate(_list_passages(knot)):
        if passage.crossing not in gone:
            after.append(Passage(number[passage.crossing], passage.above))
        if k == run.arcs[0]:
            after += laid
        elif k in met:
            after.append(met[k])
    return from_passages({knot.components[0]: after}, signs)


def _faces_beside(knot: PlanarDiagram) -> tuple[list[int], list[int]]:
    """Return the faces at the left and at the right of each arc."""
    face = faces(knot)
    left, right = ([0] * len(knot.component) for _ in range(2))
    for i, (quad, sign) in enumerate(zip(knot.crossings, knot.signs, strict=True)):
        for side in (2, 1 if sign > 0 else 3):  # the sides by which arcs leave the crossing
            left[quad[side]] = face[i, side]
            right[quad[side]] = face[i, (side + 3) % 4]
    return left, right


def _shortest_way(
    left: list[int], right: list[int], run: _Run, chance: random.Random
) -> list[tuple[int, bool]] | None:
    """Return the arcs on a shortest way between the run's ends, and which are crossed rightwards."""
    ends, inner = (run.arcs[0], run.arcs[-1]), set(run.arcs[1:-1])
    beside: dict[int, list[tuple[int, int]]] = {}
    for arc in range(len(left)):
        if arc not in ends:
            beside.setdefault(left[arc], []).append((arc, right[arc]))
            beside.setdefault(right[arc], []).append((arc, left[arc]))
    goal = {left[ends[1]], right[ends[1]]}
    came: dict[int, tuple[int, int]] = {}
    done: set[int] = set()
    far = dict.fromkeys((left[ends[0]], right[ends[0]]), 0.0)
    waiting = [(0.0, face) for face in far]
    while waiting:
        length, face = heapq.heappop(waiting)
        if face in done:
            continue
        done.add(face)
        if face in goal:
            way = []
            while face in came:
                arc, before = came[face]
                if arc not in inner:
                    way.append((arc, left[arc] == before))
                face = before
            return way[::-1]
        for arc, there in beside.get(face, []):
            further = length + (0 if arc in inner else 1 + TIE * chance.random())
            if further < far.get(there, float("inf")):
                far[there], came[there] = further, (arc, face)
                heapq.heappush(waiting, (further, there))
    return None
