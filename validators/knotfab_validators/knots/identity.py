"""Identify the knot of a polygon, with proof where possible; else list the table's knots that it may be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    jones_polynomial,
)
from knotfab_validators.knots.invariants import UNKNOT, Disagreement, Invariants, invariants
from knotfab_validators.knots.names import MOST_CROSSINGS as MOST_IN_TABLE
from knotfab_validators.knots.names import Factor, Knot, braid_of, candidates, known_knot
from knotfab_validators.knots.planar_diagram import Laurent, PlanarDiagram, closed_braid, simplify
from knotfab_validators.knots.projection import PRIMES, cusp_counts, diagram_of
from knotfab_validators.knots.reduction import Budget, Reduced, reduce_polygons
from knotfab_validators.knots.rerouting import reroute, summands

MOST_CROSSINGS = 60  # crossings up to which invariants are computed
MOST_SEEN = 800  # crossings up to which a determinant is computed modulo a prime


@dataclass(frozen=True)
class Identity:
    """What was found about the knot of one polygon.

    `knots` are those of the table that it may be; `complete` says that it must be one of them. If
    that leaves one it is `proved`, and `reason` says how. `invariants` are None if too many
    crossings are left, or if two ways to one number disagree (`trouble`); `colouring`, ±Δ(-1)
    modulo 2^31 - 1, may be known even then. `ruled_out` are knots with the same invariants that
    representations exclude. `places` (m, 3) are the vertices that the reduction leaves.
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
        # all knots with a diagram of so few crossings are in the table, or are sums of knots in it
        complete = True
        knots = tuple(knot for knot in knots if knot.crossings <= count)
        reason = f"a diagram of {count} crossings, and no other knot of so few has its invariants"
    if not reason and (whole := _sum_of_parts(diagram, places)) is not None:
        complete, knots = True, (whole,) if whole.invariants.fits(found) else ()
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
    """Return the sum of the diagram's summands if each is proved; None if it shows no sum."""
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
    """Compare knots with equal invariants by representations: those it may be, and those ruled out."""
    kept = list(knots)
    for prime in PRIMES:
        own = cusp_counts(diagram, prime)
        if own is None or len(kept) == 1:
            break
        of_each = [cusp_counts(simplify(closed_braid(braid_of(knot))), prime) for knot in kept]
        kept = [knot for knot, other in zip(kept, of_each, strict=True) if other in (None, own)]
    return tuple(kept), tuple(knot for knot in knots if knot not in kept)


def _why_proved(found: Invariants) -> str:
    """Say why knot Floer homology alone proves the knot; empty if it does not."""
    if found.floer is None:
        return ""
    genus, total = found.floer.genus, found.floer.total
    if total == 1:
        return "knot Floer homology of rank 1"
    if genus == 1 and found.floer.fibred:
        return "knot Floer homology: genus 1 and fibred"
    cinquefoil = any(knot.name.endswith("handed 5_1") for knot in candidates(found))
    if genus == 2 and total == 5 and abs(found.signature) == 4 and cinquefoil:
        return "knot Floer homology of T(2,5)"
    return ""


# The linking of closed polygons: by linking numbers, by polynomials, or proved to be none.

MOST_COUNTED = 200_000  # crossings up to which linking numbers are counted
SHAKES = 20  # rounds of random isotopies if nothing proves a link
MOST_SHAKEN = 200  # vertices up to which polygons are shaken
APART = Laurent(-1, (-1, 0, -1))  # -t^(1/2) - t^(-1/2), exponents doubled


@dataclass(frozen=True)
class Linking:
    """How polygons are linked: the nonzero linking `numbers` by pair, or another proof as `reason`.

    `state` is "apart" (proved), "linked" (proved), "consistent" with being apart, or "unknown".
    `group` are the components that are linked, or may be.
    """

    state: Literal["apart", "linked", "consistent", "unknown"]
    numbers: tuple[tuple[int, int, int], ...] = ()
    reason: str = ""
    group: tuple[int, ...] = ()


def linking_of(left: Reduced, budget: Budget | None = None) -> Linking:
    """Judge the linking of the polygons left by a joint reduction; those removed are split from the rest."""
    if len(left.polygons) < 2:
        return Linking("apart")
    polygons = dict(zip(left.components, left.polygons, strict=True))
    diagram = _diagram(polygons, MOST_SEEN)
    if diagram is None:
        diagram = _diagram(polygons, MOST_COUNTED, directions=5)
    if diagram is None:
        return Linking("unknown", reason="too many crossings", group=left.components)
    numbers = tuple((i, j, n) for (i, j), n in diagram.linking_numbers().items())
    if numbers:
        group = tuple(sorted({k for i, j, _ in numbers for k in (i, j)}))
        return Linking("linked", numbers, group=group)
    groups = [piece for piece in diagram.pieces() if len(piece) > 1]
    budget = budget or Budget()
    found = [_group_linking({k: polygons[k] for k in group}, budget) for group in groups]
    for state in ("linked", "unknown", "consistent"):
        for linking in found:
            if linking.state == state:
                return linking
    return Linking("apart")


def _group_linking(polygons: Mapping[int, Array], budget: Budget) -> Linking:
    """Judge polygons whose linking numbers are all 0: pairs first, then all together."""
    parts = list(combinations(polygons, 2)) if len(polygons) > 2 else []
    unsure: list[Linking] = []
    for part in [*parts, tuple(polygons)]:
        rest = reduce_polygons([polygons[k] for k in part], seed=3, budget=budget)
        if len(rest.polygons) < 2:
            if len(part) == len(polygons):
                return Linking("apart")
            continue
        chosen = tuple(part[k] for k in rest.components)
        linking = _by_polynomials(dict(zip(chosen, rest.polygons, strict=True)))
        if linking.state == "linked":
            return linking
        unsure.append(linking)
    whole = unsure[-1]
    if whole.state != "consistent":
        return whole
    if sum(map(len, polygons.values())) <= MOST_SHAKEN:
        rest = reduce_polygons(list(polygons.values()), seed=4, shakes=SHAKES)
        if len(rest.polygons) < 2:
            return Linking("apart")
    return whole


def _by_polynomials(polygons: Mapping[int, Array]) -> Linking:
    """Use the Alexander or the Jones polynomial to show that the polygons cannot be pulled apart."""
    group = tuple(polygons)
    diagram = _diagram(polygons, MOST_SEEN)
    if diagram is None:
        return Linking("unknown", reason="too many crossings are left", group=group)
    if len(diagram.pieces()) == len(polygons):
        return Linking("apart")
    if len(diagram.pieces()) > 1:
        found = [_by_polynomials({k: polygons[k] for k in p}) for p in diagram.pieces()]
        order = ("linked", "unknown", "consistent", "apart")
        return min(found, key=lambda linking: order.index(linking.state))
    count = len(diagram.crossings)
    if count > MOST_CROSSINGS:
        if colouring_number(diagram):
            return Linking("linked", reason="its determinant is not 0", group=group)
        return Linking("unknown", reason=f"too many crossings are left ({count})", group=group)
    alexander = alexander_polynomial(diagram)
    if alexander:
        reason = f"its Alexander polynomial is {alexander.text()}, not 0"
        return Linking("linked", reason=reason, group=group)
    whole = jones_polynomial(diagram)
    product = _jones_apart(polygons)
    if whole is None or product is None:
        return Linking("unknown", reason="its Jones polynomial takes too long", group=group)
    if whole != product:
        reason = f"its Jones polynomial is {whole.text(half=True)}, not {product.text(half=True)}"
        return Linking("linked", reason=reason, group=group)
    return Linking("consistent", group=group)


def _jones_apart(polygons: Mapping[int, Array]) -> Laurent | None:
    """Return the Jones polynomial that the polygons would have if they were apart."""
    product = Laurent(0, (1,))
    for k, polygon in enumerate(polygons.values()):
        alone = reduce_polygons([polygon], seed=1)
        if alone.vertices:
            diagram = _diagram({0: alone.polygons[0]}, MOST_CROSSINGS)
            jones = None if diagram is None else jones_polynomial(diagram)
            if jones is None:
                return None
            product = product * jones
        product = product * APART if k else product
    return product


def _diagram(
    polygons: Mapping[int, Array], most: int, directions: int = 40
) -> PlanarDiagram | None:
    """Return a diagram of the polygons, which become its components in order."""
    found = diagram_of(list(polygons.values()), most=most, directions=directions)
    if found is None:
        return None
    number = list(polygons)
    return simplify(
        PlanarDiagram(
            found.crossings,
            found.signs,
            tuple(number[k] for k in found.component),
            tuple(number[k] for k in found.loops),
        )
    )
