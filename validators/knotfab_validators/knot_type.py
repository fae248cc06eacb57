"""Knot type of the written polygons against the type that the file promises.

Nobody is trusted: the polygon is reduced by isotopies of its own (`knot_reduction`). What shrinks
to nothing is an unknot, or an unlink, by that proof. What does not shrink is compared by an
invariant, which can refute its type and otherwise is only consistent with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .check import Check
from .knot_invariants import determinant, expected_determinant, linking_number
from .knot_reduction import general_position, reduce_polygons
from .read_knots import Curves

__all__ = ["KnotFinding", "KnotTypes", "check_knot_type", "knot_types"]

Verdict = Literal["proved", "consistent", "refuted", "unknown"]

UNKNOTS = ("unknot", "0_1")
SHAKES = 60  # rounds of random isotopies when a polygon that may be an unknot does not shrink


@dataclass(frozen=True)
class KnotFinding:
    """What was found of one polygon alone.

    `vertices` are what is left of it, 0 for a proved unknot; `determinant` is None where it was
    not needed or could not be had.
    """

    promised: str
    verdict: Verdict
    vertices: int
    determinant: int | None


@dataclass(frozen=True)
class KnotTypes:
    """Each polygon's finding, and how they are linked.

    `split` says that all are proved to be unknots apart from each other (an unlink); `linked` has
    (one, other, linking number) of the pairs that wind round each other.
    """

    knots: tuple[KnotFinding, ...]
    split: bool
    linked: tuple[tuple[int, int, int], ...]


def knot_types(curves: Curves) -> KnotTypes:
    """Find out about each polygon of `curves`, and about their link.

    All polygons are reduced together first. If something is left of several, each of these is
    reduced alone, and their linking numbers are computed.
    """
    placed = general_position(curves.polygons)
    if placed is None:
        placed = tuple(curves.polygons)
    together = reduce_polygons(placed)
    left = dict(zip(together.components, together.polygons, strict=True))
    findings = [
        _finding(left[k], promised) if k in left else _proved_unknot(promised)
        for k, promised in enumerate(curves.types)
    ]
    numbers = sorted(left)
    pairs = [(i, j) for n, i in enumerate(numbers) for j in numbers[n + 1 :]]
    linking = [(i, j, linking_number(left[i], left[j])) for i, j in pairs]
    return KnotTypes(
        knots=tuple(findings),
        split=not left or (len(left) == 1 and findings[numbers[0]].vertices == 0),
        linked=tuple(link for link in linking if link[2] != 0),
    )


def check_knot_type(curves: Curves) -> Check:
    """`knot_type`: no polygon's type is refuted; the detail says which are proved.

    It is skipped, and not required, when nothing is known of a promised type.
    """
    found = knot_types(curves)
    refuted = [k for k, knot in enumerate(found.knots) if knot.verdict == "refuted"]
    unknown = [k for k, knot in enumerate(found.knots) if knot.verdict == "unknown"]
    promised = ", ".join(dict.fromkeys(curves.types))
    if refuted:
        measured = _sentence(found.knots[refuted[0]])
        detail = f"knot {refuted[0]} is promised as {curves.types[refuted[0]]}: {measured}"
        return Check("knot_type", "fail", True, measured, promised, "", detail)
    detail = "; ".join(
        f"knot {k}: {_sentence(knot)}" for k, knot in enumerate(found.knots) if knot.vertices
    )
    links = "; ".join(f"knots {i} and {j} are linked, {n:+d}" for i, j, n in found.linked)
    if not detail:
        detail = "each polygon was reduced to a triangle by moves that nothing is in the way of"
    if len(found.knots) > 1 and not found.split and not found.linked:
        links = "pairwise linking numbers are 0, which is consistent with their being unlinked"
    detail += f"; {links}" if links else ""
    status: Literal["pass", "skipped"] = "skipped" if unknown else "pass"
    return Check("knot_type", status, not unknown, _summary(found), promised, "", detail)


def _finding(polygon: NDArray[np.float64], promised: str) -> KnotFinding:
    """What one polygon alone is, as far as it can be told."""
    wanted = expected_determinant(promised)
    rest = reduce_polygons([polygon], seed=1)
    if not rest.vertices:
        return _proved_unknot(promised)
    value = determinant(rest.polygons[0])
    if value == 1 and wanted == 1:
        rest = reduce_polygons(rest.polygons, seed=2, shakes=SHAKES)
        if not rest.vertices:
            return _proved_unknot(promised)
    verdict: Verdict = "consistent"
    if value is not None and wanted is not None and value != wanted:
        verdict = "refuted"
    elif value is None or wanted is None:
        verdict = "unknown"
    return KnotFinding(promised, verdict, rest.vertices, value)


def _proved_unknot(promised: str) -> KnotFinding:
    """An unknot: as promised, or not; a promise that is not understood stays open."""
    if promised in UNKNOTS:
        return KnotFinding(promised, "proved", 0, None)
    known = expected_determinant(promised) is not None
    return KnotFinding(promised, "refuted" if known else "unknown", 0, 1)


def _sentence(knot: KnotFinding) -> str:
    if knot.vertices == 0:
        return "proved unknot"
    value = "unknown" if knot.determinant is None else str(knot.determinant)
    if knot.verdict == "refuted":
        return f"not {knot.promised}: determinant {value}"
    rest = f"determinant {value}, reduced to {knot.vertices} vertices"
    return f"{knot.verdict} with {knot.promised} ({rest})"


def _summary(found: KnotTypes) -> str:
    if all(knot.verdict == "proved" for knot in found.knots):
        if len(found.knots) == 1:
            return "proved unknot"
        if found.split:
            return f"proved unlink of {len(found.knots)}"
        return f"{len(found.knots)} proved unknots, " + ("linked" if found.linked else "consistent")
    kinds = dict.fromkeys(
        "proved unknot" if k.vertices == 0 else f"{k.verdict} with {k.promised}"
        for k in found.knots
    )
    return ", ".join(kinds)
