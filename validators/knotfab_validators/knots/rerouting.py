"""Diagrams with fewer crossings: a strand that runs above (or below) all it meets may be laid anywhere.

A run of passages above is lifted off the diagram and laid down again along the way between its ends
that crosses the fewest arcs; so is a run below. Each such step is an isotopy. Steps to ways of as many
crossings, taken at random, lead on where no run can be shortened (Reidemeister's third move is the
least of them).
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

WORK = 300_000  # crossings of the diagrams looked at while runs are laid: a second or two
STARTS = 4  # walks from the given diagram, each by other chances; they share the work
TIE = 1e-3  # the largest random share that tells ways of equal length apart


@dataclass(frozen=True)
class _Run:
    """Passages on one side of all that they meet: arcs[k] leads to crossings[k], the last arc away."""

    arcs: tuple[int, ...]
    crossings: tuple[int, ...]
    above: bool


def reroute(knot: PlanarDiagram, enough: int = 0, seed: int = 0) -> PlanarDiagram:
    """Give the knot's diagram with the fewest crossings that is met; the search ends at `enough` of them."""
    walk = _Walk(WORK, random.Random(seed))
    best = first = walk.shorten(simplify(knot))
    share = walk.left / STARTS
    for k in range(1, STARTS + 1):
        here = first
        while here.crossings and walk.left > (STARTS - k) * share:
            if len(best.crossings) <= enough:
                return best
            here = walk.shorten(walk.aside(here))
            if len(here.crossings) < len(best.crossings):
                best = here
    return best


def summands(knot: PlanarDiagram) -> list[PlanarDiagram]:
    """Split a knot's diagram by circles that meet it in two arcs alone, which show it to be a sum."""
    passages = _passages(knot)
    left, right = _sides(knot)
    between: dict[tuple[int, int], int] = {}
    for arc in range(len(passages)):
        other = between.setdefault((left[arc], right[arc]), arc)
        if other != arc:
            inside = passages[other + 1 : arc + 1]
            outside = passages[arc + 1 :] + passages[: other + 1]
            return [part for run in (inside, outside) for part in summands(_close(run, knot))]
    return [knot]


def _close(passages: list[Passage], knot: PlanarDiagram) -> PlanarDiagram:
    """Draw the diagram of a part of the knot's passages, which holds both passages of its crossings."""
    kept = {i: n for n, i in enumerate(dict.fromkeys(p.crossing for p in passages))}
    run = [Passage(kept[p.crossing], p.above) for p in passages]
    return from_passages({knot.components[0]: run}, [knot.signs[i] for i in kept])


@dataclass
class _Walk:
    """Steps from diagram to diagram; `left` is how many crossings may still be looked at."""

    left: float
    chance: random.Random

    def shorten(self, knot: PlanarDiagram) -> PlanarDiagram:
        """Return the diagram after every run was laid along a shorter way, where it has one."""
        again = True
        while again:
            again = False
            for run in _runs(knot):
                laid = self._lay(knot, run, fewer=True)
                if laid is not None:
                    knot, again = simplify(laid), True
                    break
        return knot

    def aside(self, knot: PlanarDiagram) -> PlanarDiagram:
        """Return the diagram with a part of a run, by chance, laid along a way no longer."""
        run = self.chance.choice(list(_runs(knot)))
        begin = self.chance.randrange(len(run.crossings))
        end = self.chance.randrange(begin, len(run.crossings)) + 1
        part = _Run(run.arcs[begin : end + 1], run.crossings[begin:end], run.above)
        return simplify(self._lay(knot, part) or knot)

    def _lay(self, knot: PlanarDiagram, run: _Run, fewer: bool = False) -> PlanarDiagram | None:
        self.left -= len(knot.crossings)
        return None if self.left < 0 else _lay(knot, run, self.chance, fewer)


def _passages(knot: PlanarDiagram) -> list[Passage]:
    """Passage k of the one component lies between arcs k - 1 and k."""
    found = [Passage(-1, False)] * len(knot.component)
    for i, (quad, sign) in enumerate(zip(knot.crossings, knot.signs, strict=True)):
        found[quad[2]] = Passage(i, False)
        found[quad[1 if sign > 0 else 3]] = Passage(i, True)
    return found


def _runs(knot: PlanarDiagram) -> Iterator[_Run]:
    """Yield the longest runs of a knot's diagram: from its first passage above to the next below, etc."""
    passages = _passages(knot)
    count = len(passages)
    turns = [k for k in range(count) if passages[k].above != passages[k - 1].above]
    for first, after in zip(turns, [*turns[1:], turns[0] + count] if turns else [], strict=True):
        members = [k % count for k in range(first, after)]
        arcs = ((first - 1) % count, *members)
        yield _Run(arcs, tuple(passages[k].crossing for k in members), passages[first].above)


def _lay(
    knot: PlanarDiagram, run: _Run, chance: random.Random, fewer: bool = False
) -> PlanarDiagram | None:
    """Lay the diagram's run along a shortest way; None: there is no other way (or none `fewer`)."""
    left, right = _sides(knot)
    way = _way(left, right, run, chance)
    if way is None or len(way) > len(run.crossings) - fewer:
        return None
    gone = set(run.crossings)
    signs = [sign for i, sign in enumerate(knot.signs) if i not in gone]
    number = {i: n for n, i in enumerate(i for i in range(len(knot.signs)) if i not in gone)}
    met: dict[int, Passage] = {}  # keyed by the crossed arcs, each with the run
    laid: list[Passage] = []
    for arc, to_right in way:
        crossing = len(signs)
        met[arc] = Passage(crossing, not run.above)
        laid.append(Passage(crossing, run.above))
        # the strand above turns counter-clockwise onto the other one in a right-handed crossing
        signs.append(1 if to_right == run.above else -1)
    after: list[Passage] = []
    for k, passage in enumerate(_passages(knot)):
        if passage.crossing not in gone:
            after.append(Passage(number[passage.crossing], passage.above))
        if k == run.arcs[0]:
            after += laid
        elif k in met:
            after.append(met[k])
    return from_passages({knot.components[0]: after}, signs)


def _sides(knot: PlanarDiagram) -> tuple[list[int], list[int]]:
    """Return the faces at the left and at the right of each arc."""
    face = faces(knot)
    left, right = ([0] * len(knot.component) for _ in range(2))
    for i, (quad, sign) in enumerate(zip(knot.crossings, knot.signs, strict=True)):
        for side in (2, 1 if sign > 0 else 3):  # the sides on which arcs leave the crossing
            left[quad[side]] = face[i, side]
            right[quad[side]] = face[i, (side + 3) % 4]
    return left, right


def _way(
    left: list[int], right: list[int], run: _Run, chance: random.Random
) -> list[tuple[int, bool]] | None:
    """Return the arcs that a shortest way between the run's ends crosses, each with whether to its right."""
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
