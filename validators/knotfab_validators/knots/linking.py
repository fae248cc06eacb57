"""The linking of closed polygons with each other: by number, by polynomial, or proved not to be.

A link that can be pulled apart has Alexander polynomial 0, and its Jones polynomial is the product of
its components' with -t^(1/2) - t^(-1/2) for each part more. Another value proves that it is linked,
also where all linking numbers are 0 (Whitehead's link, the Borromean rings).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from knotfab_validators.arrays import Array
from knotfab_validators.knots.alexander import alexander_polynomial, colouring_number
from knotfab_validators.knots.jones import jones_polynomial
from knotfab_validators.knots.planar_diagram import PlanarDiagram, simplify
from knotfab_validators.knots.polynomial import Laurent
from knotfab_validators.knots.projection import diagram_of
from knotfab_validators.knots.reduction import Budget, Reduced, reduce_polygons

__all__ = ["Linking", "linking_of"]


MOST_CROSSINGS = 60  # crossings for the polynomials
MOST_SEEN = 800  # crossings for a determinant modulo a prime
MOST_COUNTED = 200_000  # crossings for linking numbers
SHAKES = 20  # rounds of random isotopies where nothing proves that the link is one
MOST_SHAKEN = 200  # vertices
APART = Laurent(-1, (-1, 0, -1))  # -t^(1/2) - t^(-1/2), exponents doubled


@dataclass(frozen=True)
class Linking:
    """`numbers` of the pairs that are not 0; `reason` how else the link was proved to be one.

    `state` is "apart" (proved), "linked" (proved), "consistent" with being apart, or "unknown".
    `group` are the components that are linked, or may be.
    """

    state: Literal["apart", "linked", "consistent", "unknown"]
    numbers: tuple[tuple[int, int, int], ...] = ()
    reason: str = ""
    group: tuple[int, ...] = ()


def linking_of(left: Reduced, budget: Budget | None = None) -> Linking:
    """Judge how the polygons are linked that a joint reduction has left; the others are apart."""
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
    """Judge polygons without linking numbers: pairs first, then all together."""
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
    """Judge by the Alexander or the Jones polynomial whether the polygons cannot be pulled apart."""
    group = tuple(polygons)
    diagram = _diagram(polygons, MOST_SEEN)
    if diagram is None:
        return Linking("unknown", reason="too many crossings are left", group=group)
    if len(diagram.pieces()) == len(polygons):
        return Linking("apart")
    if len(diagram.pieces()) > 1:
        return _worst([_by_polynomials({k: polygons[k] for k in p}) for p in diagram.pieces()])
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


def _worst(found: Sequence[Linking]) -> Linking:
    order = ("linked", "unknown", "consistent", "apart")
    return min(found, key=lambda linking: order.index(linking.state))


def _jones_apart(polygons: Mapping[int, Array]) -> Laurent | None:
    """Return the Jones polynomial that the polygons would have, were they apart."""
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
    """Return the diagram with the components' own numbers."""
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
