"""Identify the knot of one polygon: proved where it can be, else the knots of the table that it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.knots.alexander import colouring_number
from knotfab_validators.knots.invariants import UNKNOT, Disagreement, Invariants, invariants
from knotfab_validators.knots.parabolic import PRIMES, cusp_counts
from knotfab_validators.knots.planar_diagram import PlanarDiagram, closed_braid, simplify
from knotfab_validators.knots.projection import diagram_of
from knotfab_validators.knots.reduction import Budget, reduce_polygons
from knotfab_validators.knots.rerouting import reroute, summands
from knotfab_validators.knots.table import MOST_CROSSINGS as MOST_IN_TABLE
from knotfab_validators.knots.table import Factor, Knot, braid_of, candidates, known_knot

__all__ = ["PROVED_UNKNOT", "Identity", "identify"]


MOST_CROSSINGS = 60  # crossings for the invariants
MOST_SEEN = 800  # crossings for a determinant modulo a prime


@dataclass(frozen=True)
class Identity:
    """The knot of one polygon, as far as it was found.

    `knots` are those of the table that it may be, and `complete` says that it is one of them: one
    alone where that is `proved`; `reason` says by what. `invariants` are None where too many
    crossings are left, or where `trouble` says that two ways to one number disagree; `colouring` is
    ±Δ(-1) modulo 2^31 - 1, which may be had even then. `ruled_out` are knots with these invariants
    that other representations tell from it. `places` (m, 3) are vertices that the reduction leaves.
    """

    knots: tuple[Knot, ...]
    reason: str
    invariants: Invariants | None
    crossings: int
    colouring: int | None
    places: Array
    complete: bool = False
    trouble: str = ""
    ruled_out: tuple[Knot, ...] = ()

    @property
    def proved(self) -> bool:
        """True if the knot is known."""
        return self.complete and len(self.knots) == 1


PROVED_UNKNOT = Identity(
    (Knot((), UNKNOT),), "it shrinks to nothing", UNKNOT, 0, 1, np.empty((0, 3)), complete=True
)


def identify(polygon: Array, budget: Budget | None = None) -> Identity:
    """Identify a closed polygon (n, 3) in general position."""
    rest = reduce_polygons([polygon], seed=1, budget=budget)
    if not rest.vertices:
        return PROVED_UNKNOT
    places = rest.polygons[0]
    diagram = diagram_of([places], most=MOST_SEEN)
    if diagram is not None:
        diagram = reroute(diagram, enough=MOST_IN_TABLE)
    if diagram is None or len(diagram.crossings) > MOST_CROSSINGS:
        return _give_up(diagram, places)
    if not diagram.crossings:
        return PROVED_UNKNOT
    return _identify_diagram(diagram, places)


def _give_up(diagram: PlanarDiagram | None, places: Array) -> Identity:
    if diagram is None:
        return Identity((), "too many crossings left", None, -1, None, places)
    count = len(diagram.crossings)
    reason = f"too many crossings left ({count})"
    return Identity((), reason, None, count, colouring_number(diagram), places)


def _identify_diagram(diagram: PlanarDiagram, places: Array) -> Identity:
    count = len(diagram.crossings)
    try:
        found = invariants(diagram)
    except Disagreement as error:
        trouble = f"the two methods disagree: {error}"
        return Identity((), "", None, count, None, places, trouble=trouble)
    knots = candidates(found)
    reason = _why_proved(found)
    ruled_out: tuple[Knot, ...] = ()
    complete = bool(reason)
    if not reason and count <= MOST_IN_TABLE:
        # every knot with a diagram of so few crossings is in the table, or a sum of knots in it
        complete = True
        knots = tuple(knot for knot in knots if knot.crossings <= count)
        reason = f"a diagram of {count} crossings, and no other knot of so few has its invariants"
    if not reason and (whole := _sum_of_parts(diagram, places)) is not None:
        complete, knots = True, tuple(knot for knot in knots if knot.factors == whole.factors)
        reason = f"a diagram of {count} crossings that falls into the summands, each proved"
    if len(knots) > 1 and not _why_proved(found):
        knots, ruled_out = _compare_representations(diagram, knots)
        if complete and len(knots) == 1:
            reason += ", nor its representations in PSL(2, p)"
    if complete and not knots:
        trouble = f"a diagram of {count} crossings has invariants that no knot of so few has"
        return Identity((), "", None, count, None, places, trouble=trouble)
    knots = knots[:1] if _why_proved(found) else knots
    reason = reason if len(knots) == 1 else ""
    return Identity(
        knots, reason, found, count, found.determinant, places, complete, ruled_out=ruled_out
    )


def _sum_of_parts(diagram: PlanarDiagram, places: Array) -> Knot | None:
    """Return the sum of its diagram's summands where each of these is proved; None where it shows none."""
    parts = summands(diagram)
    if len(parts) < 2:
        return None
    factors: list[Factor] = []
    for part in parts:
        found = _identify_diagram(part, places)
        if not found.proved:
            return None
        factors += found.knots[0].factors
    return known_knot(tuple(sorted(factors)))


def _compare_representations(
    diagram: PlanarDiagram, knots: tuple[Knot, ...]
) -> tuple[tuple[Knot, ...], tuple[Knot, ...]]:
    """Compare some knots with equal invariants by representations: which it may be, and which not."""
    kept = list(knots)
    for prime in PRIMES:
        own = cusp_counts(diagram, prime)
        if own is None or len(kept) == 1:
            break
        of_each = [cusp_counts(simplify(closed_braid(braid_of(knot))), prime) for knot in kept]
        kept = [knot for knot, other in zip(kept, of_each, strict=True) if other in (None, own)]
    return tuple(kept), tuple(knot for knot in knots if knot not in kept)


def _why_proved(found: Invariants) -> str:
    """Say why knot Floer homology alone proves the knot (see floer.py), or nothing."""
    if found.floer is None:
        return ""
    genus, total = found.floer.genus, found.floer.total
    if total == 1:
        return "knot Floer homology of rank 1"
    if genus == 1 and found.floer.fibred:
        return "knot Floer homology: genus 1 and fibred"
    if genus == 2 and total == 5 and abs(found.signature) == 4 and _is_cinquefoil(found):
        return "knot Floer homology of T(2,5)"
    return ""


def _is_cinquefoil(found: Invariants) -> bool:
    return any(knot.name.endswith("handed 5_1") for knot in candidates(found))
