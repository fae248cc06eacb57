"""Knot type of the written polygons against the type that the file promises.

Nobody is trusted: the polygon is reduced by isotopies of its own (`knot_reduction`). What shrinks
to nothing is an unknot, or an unlink, by that proof; so are curves that look simple and apart from
one side. What does not shrink is compared by an invariant, which can refute its type and otherwise
is only consistent with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from .check import Check, Status, skipped
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
    (one, other, linking number) of the pairs that wind round each other. `touching` says that the
        polygons meet themselves or each other, or are too near to tell: then they have no type.
    """

    knots: tuple[KnotFinding, ...]
    split: bool
    linked: tuple[tuple[int, int, int], ...]
    touching: bool = False


def knot_types(curves: Curves) -> KnotTypes:
    """Find out about each polygon of `curves`, and about their link.

    Polygons without a crossing, seen along one of the axes, are unlinked unknots. Otherwise all are
    reduced together. If something is left of several, each of these is reduced alone, and their
    linking numbers are computed.
    """
    placed = general_position(curves.polygons)
    if placed is None:
        unknown = tuple(KnotFinding(t, "unknown", len(p), None) for t, p in _named(curves))
        return KnotTypes(unknown, split=False, linked=(), touching=True)
    if _no_crossing(curves.polygons):
        return KnotTypes(tuple(_proved_unknot(t) for t in curves.types), split=True, linked=())
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
        # one that is left is an unknot by itself, and all others were split from it
        split=not left or (len(left) == 1 and findings[numbers[0]].vertices == 0),
        linked=tuple(link for link in linking if link[2] != 0),
    )


def check_knot_type(curves: Curves) -> Check:
    """`knot_type`: no polygon's type is refuted and no two are linked; `measured` says what is proved.

    Polygons that touch fail: they have no type. It is skipped, and not required, for open curves
    and where nothing is known of a promised type; a promised unknot that could not be decided is
    skipped and required.
    """
    if not all(curves.closed):
        return skipped("knot_type", "an open curve has no knot type")
    found = knot_types(curves)
    count = len(found.knots)
    refuted = [k for k, knot in enumerate(found.knots) if knot.verdict == "refuted"]
    links = [f"knots {i} and {j} are linked (linking number {n})" for i, j, n in found.linked]
    if found.touching:
        return _check(curves, "fail", "no knot", "the polygons touch themselves or each other")
    if refuted:
        knot = found.knots[refuted[0]]
        where = "" if count == 1 else f"knot {refuted[0]} of {count} "
        detail = f"{where}promised as {knot.promised}; found: {_sentence(knot)}"
        return _check(curves, "fail", _sentence(knot), "; ".join([detail, *links]))
    if links:
        return _check(curves, "fail", links[0], "; ".join(links))
    parts = [f"knot {k}: {_sentence(knot)}" for k, knot in enumerate(found.knots) if knot.vertices]
    if not parts:
        parts = ["shrunk to triangles without a crossing, or simple seen along an axis"]
    if count > 1 and not found.split:
        parts.append("linking numbers are 0, which is consistent with their being unlinked")
    unknown = any(knot.verdict == "unknown" for knot in found.knots)
    return _check(curves, "skipped" if unknown else "pass", _summary(found), "; ".join(parts))


def _check(curves: Curves, status: Status, measured: str, detail: str) -> Check:
    promised = ", ".join(dict.fromkeys(curves.types))
    if len(curves.types) > 1 and set(curves.types) <= set(UNKNOTS):
        promised = f"unlink of {len(curves.types)} unknots"
    # a promised unknot can be decided: where it was not, the part is not verified
    required = status != "skipped" or set(curves.types) <= set(UNKNOTS)
    return Check("knot_type", status, required, measured, promised, "", detail)


def _named(curves: Curves) -> list[tuple[str, NDArray[np.float64]]]:
    return list(zip(curves.types, curves.polygons, strict=True))


def _no_crossing(polygons: Sequence[NDArray[np.float64]]) -> bool:
    """Whether the polygons are simple and apart when seen along z, y or x.

    Leaving out a coordinate rounds nothing, and shapely's orientation test is exact.
    """
    for axes in ((0, 1), (0, 2), (1, 2)):
        flat = [shapely.linestrings(np.concatenate([p, p[:1]])[:, axes]) for p in polygons]
        if shapely.is_simple(shapely.multilinestrings(flat)):
            return True
    return False


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
        return "unknot, proved"
    if knot.verdict == "refuted":
        article = "an" if knot.promised in UNKNOTS else "a"
        return f"not {article} {knot.promised} (determinant {knot.determinant})"
    value = "not found" if knot.determinant is None else str(knot.determinant)
    return f"{knot.promised}, {knot.verdict} (determinant {value}, {knot.vertices} vertices left)"


def _summary(found: KnotTypes) -> str:
    """What is known of all of them: proved only if all of it is."""
    proved = all(knot.verdict == "proved" for knot in found.knots)
    if len(found.knots) == 1:
        return f"{found.knots[0].promised}, {found.knots[0].verdict}"
    if proved:
        kind = f"unlink of {len(found.knots)} unknots"
        return f"{kind}, {'proved' if found.split else 'consistent'}"
    return ", ".join(dict.fromkeys(f"{knot.promised}, {knot.verdict}" for knot in found.knots))
