"""The names by which a file may promise a knot type.

A name is a knot of the table ("3_1" to "10_165"), "unknot" or "0_1", a word ("trefoil", "figure-eight",
"cinquefoil", "stevedore", "granny", "square"), a torus knot "T(3,4)", or a sum: "3_1#4_1". Without a
hand, the knot and its mirror image both keep the promise. "left-handed 5_2" or "right-handed 5_2" ask
for one; which is which says `invariants.Invariants.hand`. A prefix "m" is a factor's mirror image:
in a sum it says how the factors' hands relate ("3_1#m3_1" is the square knot, "3_1#3_1" a granny of
either hand); on every factor it means left-handed ("m3_1"), and so does a negative number ("T(2,-3)").
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache

from knotfab_formats.knot_names import NICKNAMES
from knotfab_validators.knots.invariants import UNKNOT, invariants
from knotfab_validators.knots.planar_diagram import closed_braid
from knotfab_validators.knots.table import (
    Factor,
    Knot,
    candidates,
    is_amphichiral,
    known_knot,
    prime_names,
)

__all__ = ["Promise", "asked_knot", "promised_knot"]

WORDS = {"trivial": "unknot", "trivial knot": "unknot", "0_1": "unknot", **NICKNAMES}
OPEN = ("", "unknown", "?")  # nothing is promised
MOST_FACTORS = 12
MOST_TORUS_CROSSINGS = 60


@dataclass(frozen=True)
class Promise:
    """A file's promise on a knot: `meant` are the knots that keep it, empty if it is not understood."""

    text: str
    meant: tuple[Knot, ...]

    @property
    def given(self) -> bool:
        """True if anything was promised."""
        return self.text.strip().lower() not in OPEN

    @property
    def unknot(self) -> bool:
        """True if it is the unknot."""
        return any(not knot.factors and not knot.title for knot in self.meant)


def promised_knot(text: str) -> Promise:
    """Return the promise in a knot's "type"."""
    name = " ".join(text.lower().split())
    hand = 0
    for word, sign in (("left-handed ", -1), ("right-handed ", 1)):
        if name.startswith(word):
            hand, name = sign, name.removeprefix(word)
    name = name.removesuffix(" knot") if name != "trivial knot" else name
    name = WORDS.get(name, name)
    knot = _torus(name) if name.startswith("t(") else _sum(name)
    if knot is None:
        return Promise(text, ())
    mirror = knot.mirror()
    if hand:
        return Promise(text, (knot if hand * (_hand(knot) or 1) > 0 else mirror,))
    if _hand(knot) < 0:
        return Promise(text, (knot,))
    same = mirror.name == knot.name
    return Promise(text, (knot,) if same else (knot, mirror))


def asked_knot(text: str) -> Promise:
    """Return the promise in a scene's `[piece] knot`: one of a knot's "type", or as people write it.

    That is "left 5_2" for "left-handed 5_2", "3_{1}", "T( 2, 3 )"; and no name at all is the unknot. Of a
    factor that is mirrored, "left" and "right" do not say which hand is meant: both keep that promise.
    """
    name = " ".join(text.lower().replace("_{", "_").replace("}", "").split())
    name = re.sub(r"\(\s*(-?\d+)\s*,\s*(-?\d+)\s*\)", r"(\1,\2)", name) or "unknot"
    if (found := re.match(r"(left|right)(?:-handed)? (.*)", name)) is not None:
        mirrored = any(part.strip().startswith("m") for part in found[2].split("#"))
        name = found[2] if mirrored else f"{found[1]}-handed {found[2]}"
    meant = promised_knot(name).meant
    if found is not None and len(meant) == 1 and mirrored:
        mirror = meant[0].mirror()
        meant = meant if mirror.name == meant[0].name else (*meant, mirror)
    return Promise(text, meant)


def _hand(knot: Knot) -> int:
    """Return the hand that all its factors have, or 0."""
    if knot.title:
        return knot.invariants.hand
    hands = {factor.hand for factor in knot.factors} - {0}
    return hands.pop() if len(hands) == 1 else 0


def _sum(name: str) -> Knot | None:
    parts = [part.strip() for part in name.split("#")]
    if len(parts) > MOST_FACTORS:
        return None
    factors: list[Factor] = []
    for part in parts:
        plain = part.removeprefix("m")
        plain = WORDS.get(plain, plain)
        if plain == "unknot":
            continue
        if plain not in prime_names():
            return None
        crossings, number = map(int, plain.split("_"))
        hand = 0 if is_amphichiral(plain) else (-1 if part.startswith("m") else 1)
        factors.append(Factor(crossings, number, hand))
    return known_knot(tuple(factors))


@cache
def _torus(name: str) -> Knot | None:
    """Return T(p, q) from its braid; a knot of the table where it is one."""
    found = re.fullmatch(r"t\((-?\d{1,3}), ?(-?\d{1,3})\)", name)
    if found is None:
        return None
    p, q = sorted((int(found[1]), int(found[2])), key=abs)
    sign = -1 if (p < 0) != (q < 0) else 1
    p, q = abs(p), abs(q)
    if not p or math.gcd(p, q) != 1 or (p - 1) * q > MOST_TORUS_CROSSINGS:
        return None
    if p == 1:
        return Knot((), UNKNOT)
    found_invariants = invariants(closed_braid([sign * k for k in range(1, p)] * q))
    # torus knots of the table are known by their crossings, (p - 1) q
    for knot in candidates(found_invariants):
        if knot.crossings == (p - 1) * q and len(knot.factors) == 1:
            return knot
    return Knot((), found_invariants, title=f"T({p},{sign * q})")
