"""Find the knot type of each written polygon, whether it is the promised one, and how they are linked.

Nothing is trusted: the polygons are reduced by this package's own isotopies (`reduction`). A polygon that
shrinks to nothing is thereby proved an unknot; so are curves that look simple and apart from one side.
The rest is projected to a diagram (`projection`), and named by its invariants (`identity`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely

from knotfab_formats.verdict import Check, Place, Status
from knotfab_validators.arrays import Array
from knotfab_validators.check import places, skip_check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.alexander import colouring_remainder
from knotfab_validators.knots.identity import PROVED_UNKNOT, Identity, Linking, identify, linking_of
from knotfab_validators.knots.invariants import Invariants
from knotfab_validators.knots.names import Promise, asked_knot, promised_knot
from knotfab_validators.knots.reduction import (
    Budget,
    TooTangled,
    general_position,
    nearest_approach,
    reduce_polygons,
    touching_place,
)

MOST_SHOWN = 6  # linked pairs whose places are listed

Verdict = Literal["proved", "consistent", "refuted", "unknown"]


@dataclass(frozen=True)
class KnotFinding:
    """The finding on polygon `number` alone, and whether it is what was promised.

    `verdict` "proved" or "consistent" refers to the promise or, without one, to the knot that was found.
    "unknown" means that this cannot be decided, or that the promise is not understood.
    """

    number: int
    promise: Promise
    identity: Identity
    verdict: Verdict

    @property
    def sentence(self) -> str:
        """The finding in words: "right-handed 3_1, proved"."""
        return _word_finding(self)


@dataclass(frozen=True)
class KnotTypes:
    """The findings on all closed polygons, and how these are linked.

    `touching` is a place where polygons meet, or are too near to tell: then they have no type.
    `tangled` says that they were too tangled to examine.
    """

    knots: tuple[KnotFinding, ...]
    linking: Linking
    touching: Place | None = None
    tangled: bool = False


def knot_types(curves: Curves) -> KnotTypes:
    """Determine the knot type of each closed polygon of `curves`, and their linking.

    Polygons without a crossing, seen along one of the axes, are unlinked unknots. Otherwise all are
    reduced together, and what is left is examined one by one and as a link.
    """
    numbers = [k for k, closed in enumerate(curves.closed) if closed]
    polygons = [curves.polygons[k] for k in numbers]
    promises = [promised_knot(curves.types[k]) for k in numbers]
    if not polygons:
        return KnotTypes((), Linking("apart"))
    try:
        placed = general_position(polygons)
        if placed is None:
            where = places([touching_place(polygons)])[0]
            return KnotTypes((), Linking("unknown"), touching=where)
    except TooTangled:
        return KnotTypes((), Linking("unknown"), tangled=True)
    if _crosses_nowhere(polygons):
        identities = {}
        linking = Linking("apart")
    else:
        budget = Budget()
        together = reduce_polygons(placed, budget=budget)
        left = dict(zip(together.components, together.polygons, strict=True))
        identities = {k: identify(polygon, budget) for k, polygon in left.items()}
        linking = _renumber(linking_of(together, budget), numbers)
    found_each = [identities.get(k, PROVED_UNKNOT) for k in range(len(polygons))]
    findings = [
        KnotFinding(number, promise, found, _judge(promise, found))
        for number, promise, found in zip(numbers, promises, found_each, strict=True)
    ]
    return KnotTypes(tuple(findings), linking)


def knot_checks(curves: Curves, asked: str | None = None) -> tuple[Check, Check]:
    """Return the checks `knot_type` and `linking`, from one search for the types.

    Args:
        asked: the scene's `[piece] knot`, where it has one: one of the knots is of that type, and all
            others are unknots. What is found must fit both this and each knot's own promise.

    `knot_type`: `measured` says what each closed polygon is, and whether that is proved or only
    consistent; `limit` is the promise. Polygons that touch fail: they have no type. It is skipped for
    open curves alone, and where a promise is not understood; a promised unknot that could not be
    decided is skipped and required. `at` are places on the knot that is not as promised.

    `linking`: `measured` is the largest size of a linking number, 0 allowed, or says that the polygons
    are linked although all these are 0. Passes where it is proved that they are apart, or where every
    invariant is consistent with it. `at` is where the linked ones are nearest.
    """
    found = knot_types(curves)
    own = _check_own_types(curves, found)
    if asked is not None and own.status != "fail" and any(curves.closed):
        own = _compare_with_scene(own, found.knots, asked_knot(asked))
    return own, _check_linking(curves, found)


def _compare_with_scene(own: Check, knots: Sequence[KnotFinding], asked: Promise) -> Check:
    """Fail the check `own`, of the knots' own promises, if they refute the scene's promise."""
    said = f"the scene's piece.knot is {asked.text!r}"
    limit = "unknot" if asked.unknot else asked.text
    if not asked.meant:
        return replace(own, status="fail", required=True, detail=f"{said}, which names no knot")
    trivial = asked_knot("unknot")
    plain = [_judge(trivial, knot.identity) for knot in knots]
    tied = [_judge(asked, knot.identity) for knot in knots]
    # one must be of the type asked for, and all others unknots
    fits = any(
        tied[k] != "refuted" and "refuted" not in plain[:k] + plain[k + 1 :]
        for k in range(len(knots))
    )
    if knots and not fits:
        judged = [replace(knot, promise=asked, verdict=tied[k]) for k, knot in enumerate(knots)]
        wrong = [knot for knot in judged if knot.verdict == "refuted"] or judged
        found = ", ".join(dict.fromkeys(_word_finding(knot) for knot in judged))
        others = " and all other knots are unknots" if len(knots) > 1 and not asked.unknot else ""
        at = places(place for knot in wrong for place in knot.identity.places)
        detail = f"{said}{others}; found: {found}"
        return replace(
            own, status="fail", required=True, measured=found, limit=limit, detail=detail, at=at
        )
    required = own.required or (own.status == "skipped" and asked.unknot)
    return replace(own, required=required, limit=own.limit or limit)


def _check_own_types(curves: Curves, found: KnotTypes) -> Check:
    name = "knot_type"
    left_out = _name_left_out(curves)
    if not any(curves.closed):
        return skip_check(name, "an open curve has no knot type")
    kinds = [k for k, closed in zip(curves.types, curves.closed, strict=True) if closed]
    limit = ", ".join(dict.fromkeys(k for k in kinds if promised_knot(k).given)) or None
    if found.touching is not None:
        detail = "the polygons touch themselves or each other" + left_out
        return Check(name, "fail", True, "no knot", limit, "", detail, (found.touching,))
    if found.tangled:
        required = any(promised_knot(k).unknot for k in kinds)
        return Check(
            name, "skipped", required, None, limit, "", "not found: too tangled" + left_out
        )
    refuted = [knot for knot in found.knots if knot.verdict == "refuted"]
    unknown = [knot for knot in found.knots if knot.verdict == "unknown"]
    trouble = [knot for knot in found.knots if knot.identity.trouble]
    misspelt = [knot for knot in unknown if knot.promise.misspelt]
    status: Status = "fail" if refuted or trouble or misspelt else "skipped" if unknown else "pass"
    required = status != "skipped" or any(knot.promise.unknot for knot in unknown)
    several = len(found.knots) > 1
    shown = refuted or trouble or misspelt or unknown or found.knots
    detail = "; ".join(_word_detail(knot, several) for knot in shown) + left_out
    at = [place for knot in refuted or trouble for place in knot.identity.places]
    measured = ", ".join(dict.fromkeys(knot.sentence for knot in refuted or trouble or found.knots))
    return Check(name, status, required, measured, limit, "", detail, places(at))


def _check_linking(curves: Curves, found: KnotTypes) -> Check:
    name = "linking"
    if not any(curves.closed):
        return skip_check(name, "an open curve is not linked with anything")
    left_out = _name_left_out(curves)
    if sum(curves.closed) == 1:
        return Check(name, "pass", True, 0.0, 0.0, "", "there is only one closed curve" + left_out)
    if found.touching is not None:
        detail = "the polygons touch themselves or each other"
        return Check(name, "fail", True, "touching", 0.0, "", detail, (found.touching,))
    linking = found.linking
    names = " and ".join(map(str, linking.group))
    if linking.state == "unknown" or found.tangled:
        why = f"not found: {linking.reason or 'too tangled'}{left_out}"
        return Check(name, "skipped", True, None, 0.0, "", why)
    if linking.numbers:
        worst = sorted(linking.numbers, key=lambda pair: -abs(pair[2]))
        detail = "; ".join(f"knots {i} and {j} are linked, number {n:+d}" for i, j, n in worst)
        shown = worst[:MOST_SHOWN]
        at = [nearest_approach(curves.polygons[i], curves.polygons[j]) for i, j, _ in shown]
        largest = float(abs(worst[0][2]))
        return Check(name, "fail", True, largest, 0.0, "", detail + left_out, places(at))
    if linking.state == "linked":
        i, j = linking.group[:2]  # naming two of them is enough
        detail = f"knots {names} are linked, proved: {linking.reason}; all linking numbers are 0"
        at = [nearest_approach(curves.polygons[i], curves.polygons[j])]
        measured = "linked, with linking number 0"
        return Check(name, "fail", True, measured, 0.0, "", detail + left_out, places(at))
    if linking.state == "apart":
        detail = "all are apart from each other, proved"
    else:
        detail = f"knots {names}: all invariants are consistent with their being unlinked"
    return Check(name, "pass", True, 0.0, 0.0, "", detail + left_out)


def _renumber(linking: Linking, numbers: Sequence[int]) -> Linking:
    """Renumber findings to the curves' numbers among all, open ones included."""
    return Linking(
        linking.state,
        tuple((numbers[i], numbers[j], n) for i, j, n in linking.numbers),
        linking.reason,
        tuple(numbers[k] for k in linking.group),
    )


def _name_left_out(curves: Curves) -> str:
    open_curves = [str(k) for k, closed in enumerate(curves.closed) if not closed]
    if not open_curves:
        return ""
    return f"; open curves have no type and are left out: {', '.join(open_curves)}"


def _crosses_nowhere(polygons: Sequence[Array]) -> bool:
    """Return whether the polygons, seen along z, y or x, are simple and do not cross each other.

    Leaving out a coordinate rounds nothing, and shapely's orientation test is exact.
    """
    for axes in ((0, 1), (0, 2), (1, 2)):
        flat = [shapely.linestrings(np.concatenate([p, p[:1]])[:, axes]) for p in polygons]
        if shapely.is_simple(shapely.multilinestrings(flat)):
            return True
    return False


def _judge(promise: Promise, found: Identity) -> Verdict:
    if not promise.given:
        nothing = found.invariants is None
        return "unknown" if nothing else "proved" if found.proved else "consistent"
    if not promise.meant or found.trouble:
        return "unknown"
    if found.complete:
        same = {knot.name for knot in found.knots} & {knot.name for knot in promise.meant}
        if not same:
            return "refuted"
        return "proved" if found.proved else "consistent"
    if found.invariants is not None:
        known_not = {knot.name for knot in found.ruled_out}
        fits = any(
            knot.invariants.fits(found.invariants) and knot.name not in known_not
            for knot in promise.meant
        )
        return "consistent" if fits else "refuted"
    if found.colouring is not None:
        allowed = {colouring_remainder(knot.invariants.determinant) for knot in promise.meant}
        if found.colouring not in allowed:
            return "refuted"
    return "unknown"


def _word_finding(knot: KnotFinding) -> str:
    found = knot.identity
    if found.trouble:
        return "not found"
    if found.knots:
        return f"{_word_either(found)}, {'proved' if found.proved else 'consistent'}"
    if knot.verdict == "consistent" and knot.promise.given:
        return f"{knot.promise.text}, consistent"
    if knot.verdict == "refuted":
        article = "an" if knot.promise.unknot else "a"
        return f"not {article} {knot.promise.text}"
    if found.invariants is None:
        return "not found"
    return f"not a knot of the table (determinant {found.invariants.determinant})"


def _word_either(found: Identity) -> str:
    """Name the knots that it may be; both hands of one are named once."""
    names = [knot.name for knot in found.knots]
    both = {name.removeprefix("left-handed ") for name in names if name.startswith("left-handed ")}
    both &= {
        name.removeprefix("right-handed ") for name in names if name.startswith("right-handed ")
    }
    kept = []
    for name in names:
        plain = name.removeprefix("left-handed ").removeprefix("right-handed ")
        kept.append(f"{plain} of either hand" if plain in both else name)
    return " or ".join(dict.fromkeys(kept))


def _word_detail(knot: KnotFinding, several: bool) -> str:
    found = knot.identity
    where = f"knot {knot.number}: " if several else ""
    if knot.verdict == "refuted":
        where += f"promised as {knot.promise.text}; found: "
    text = where + (found.trouble or _word_finding(knot))
    if not knot.promise.meant and knot.promise.given:
        text += f"; the promised type {knot.promise.text!r} is not understood"
        if knot.promise.misspelt:
            text += ": write a name such as unknot, trefoil, 5_2 or 3_1#4_1, or leave it out"
    if found.reason:
        text += f" ({found.reason})"
    if found.invariants is not None and found.crossings:
        text += f"; {found.crossings} crossings left, {_word_numbers(found.invariants)}"
    return text


def _word_numbers(found: Invariants) -> str:
    """Write the invariants in words."""
    jones = "not found" if found.jones is None else found.jones.text(half=True)
    text = f"Alexander {found.alexander.text()}, Jones {jones}, signature {found.signature}"
    if found.floer is None:
        return text + ", no Floer homology"
    fibred = ", fibred" if found.floer.fibred else ""
    return f"{text}, Floer homology of rank {found.floer.total}, genus {found.floer.genus}{fibred}"
