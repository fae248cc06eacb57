"""The names by which a file may promise a knot type.

A name is a knot of the table ("3_1" to "10_165"), "unknot" or "0_1", a word ("trefoil", "figure-eight",
"cinquefoil", "stevedore", "granny", "square"), a torus knot "T(3,4)", or a sum: "3_1#4_1". Without a
hand, the knot and its mirror image both keep the promise. "left-handed 5_2" or "right-handed 5_2" ask
for one (`invariants.Invariants.hand` defines which is which). A prefix "m" is a factor's mirror image:
in a sum it says how the factors' hands relate ("3_1#m3_1" is the square knot, "3_1#3_1" a granny of
either hand); on every factor it means left-handed ("m3_1"), and so does a negative number ("T(2,-3)").
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources

from knotfab_formats.knots import NICKNAMES
from knotfab_validators.knots.invariants import UNKNOT, Floer, Invariants, invariants
from knotfab_validators.knots.planar_diagram import Laurent, closed_braid, laurent

# The knots of up to 10 crossings and their sums, recognised by their invariants.


MOST_CROSSINGS = 10  # every knot with a diagram of so few crossings is in the table
MOST_OF_SUMS = 12  # crossings up to which sums are looked for


@dataclass(frozen=True, order=True)
class Factor:
    """A prime knot of the table; `hand` is 1 right-handed, -1 left-handed, 0 equal to its mirror image."""

    crossings: int
    number: int
    hand: int

    @property
    def name(self) -> str:
        """The name in the table: 3_1."""
        return f"{self.crossings}_{self.number}"

    def mirror(self) -> Factor:
        """Return its mirror image."""
        return Factor(self.crossings, self.number, -self.hand)


@dataclass(frozen=True)
class Knot:
    """A sum of factors in order, none for the unknot, with its invariants.

    `title` names a knot that is not in the table; it has no factors.
    """

    factors: tuple[Factor, ...]
    invariants: Invariants
    title: str = ""

    @property
    def crossings(self) -> int:
        """The number of crossings of all factors together."""
        return sum(factor.crossings for factor in self.factors)

    def mirror(self) -> Knot:
        """Return its mirror image."""
        factors = tuple(sorted(factor.mirror() for factor in self.factors))
        mirrored = self.title.replace(",", ",-").replace("--", "")
        return Knot(factors, self.invariants.mirror(), mirrored)

    @property
    def name(self) -> str:
        """The name, such as "unknot", "right-handed 3_1", "4_1", "3_1#m3_1": see names.py."""
        if not self.factors:
            return self.title or "unknot"
        signs = {factor.hand for factor in self.factors} - {0}
        hand = {1: "right-handed ", -1: "left-handed "}.get(sum(signs), "")
        if len(signs) == 2:
            ordered = sorted(self.factors, key=lambda f: (f.crossings, f.number, -f.hand))
            return "#".join(("m" if f.hand < 0 else "") + f.name for f in ordered)
        return hand + "#".join(f.name for f in self.factors)


def known_knot(factors: tuple[Factor, ...]) -> Knot:
    """Return the sum of these prime knots of the table."""
    result = UNKNOT
    for factor in factors:
        result = result * _prime(factor)
    return Knot(tuple(sorted(factors)), result)


def candidates(found: Invariants) -> tuple[Knot, ...]:
    """List the table's knots that fit, and their sums of up to 12 crossings, simplest first."""
    return tuple(
        knot for knot in _by_alexander().get(found.alexander, ()) if knot.invariants.fits(found)
    )


@cache
def _by_alexander() -> dict[Laurent, tuple[Knot, ...]]:
    table: dict[Laurent, list[Knot]] = {}
    for factors in sorted(_sums(MOST_OF_SUMS, ()), key=lambda f: (sum(x.crossings for x in f), f)):
        knot = known_knot(factors)
        table.setdefault(knot.invariants.alexander, []).append(knot)
    return {alexander: tuple(knots) for alexander, knots in table.items()}


def _sums(room: int, chosen: tuple[Factor, ...]) -> Iterator[tuple[Factor, ...]]:
    yield chosen
    for factor in _factors():
        if factor.crossings <= room and (not chosen or factor >= chosen[-1]):
            yield from _sums(room - factor.crossings, (*chosen, factor))


@cache
def _factors() -> tuple[Factor, ...]:
    found = []
    for name in prime_names():
        crossings, number = map(int, name.split("_"))
        hands = (0,) if name in _table()["amphichiral"] else (1, -1)
        found += [Factor(crossings, number, hand) for hand in hands]
    return tuple(sorted(found))


def prime_names() -> tuple[str, ...]:
    """List the names of the table's prime knots."""
    return tuple(_table()["knots"])


def braid_word(name: str) -> tuple[int, ...]:
    """Return a braid whose closure (`closed_braid`) is the right-handed knot of that name."""
    return tuple(_table()["knots"][name]["braid"])


def braid_of(knot: Knot) -> tuple[int, ...]:
    """Return a braid whose closure is the knot, which is one of the table or a sum of such."""
    word: list[int] = []
    strands = 0
    for factor in knot.factors:
        letters = [(factor.hand or 1) * letter for letter in braid_word(factor.name)]
        word += [letter + (strands if letter > 0 else -strands) for letter in letters]
        strands += max(map(abs, letters))
    return tuple(word)


def is_amphichiral(name: str) -> bool:
    """Return whether the knot is the same as its mirror image."""
    return name in _table()["amphichiral"]


@cache
def _prime(factor: Factor) -> Invariants:
    row = _table()["knots"][factor.name]
    half = row["alexander"]
    alexander = laurent(1 - len(half), [*half[:0:-1], *half])
    lowest, coefficients = row["jones"]
    doubled = [0] * (2 * len(coefficients) - 1)
    doubled[::2] = coefficients
    if "floer" in row:
        ranks = {(a, m): rank for a, m, rank in row["floer"]}
    else:
        thin = enumerate(alexander.coefficients, start=alexander.lowest)
        ranks = {(a, a + row["signature"] // 2): abs(c) for a, c in thin if c}
    found = Invariants(
        alexander,
        row["signature"],
        laurent(2 * lowest, doubled),
        Floer(tuple(sorted(ranks.items()))),
    )
    return found.mirror() if factor.hand < 0 else found


@cache
def _table() -> dict[str, dict[str, dict]]:  # type: ignore[type-arg]
    text = resources.files(__package__).joinpath("table.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


WORDS = {"trivial": "unknot", "trivial knot": "unknot", "0_1": "unknot", **NICKNAMES}
OPEN = ("", "unknown", "?")  # nothing is promised
MOST_FACTORS = 12
MOST_TORUS_CROSSINGS = 60


@dataclass(frozen=True)
class Promise:
    """What a file promises about a knot; `meant` are the knots that keep it, none if it is not understood."""

    text: str
    meant: tuple[Knot, ...]

    @property
    def given(self) -> bool:
        """True if anything was promised."""
        return self.text.strip().lower() not in OPEN

    @property
    def misspelt(self) -> bool:
        """True if what was promised names no knot at all, in this table or a larger one."""
        larger = re.fullmatch(r"m?\d+[an]?_\{?\d+\}?", self.text.strip().lower()) is not None
        return self.given and not self.meant and not larger

    @property
    def unknot(self) -> bool:
        """True if the unknot was promised."""
        return any(not knot.factors and not knot.title for knot in self.meant)


def promised_knot(text: str) -> Promise:
    """Parse the promise in a knot's "type"."""
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

    People write "left 5_2" for "left-handed 5_2", "3_{1}", or "T( 2, 3 )"; no name at all means the unknot.
    With a mirrored factor, "left" and "right" do not say which hand is meant: both keep that promise.
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
    """Return the hand that all factors share, or 0."""
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
    """Return T(p, q) from its braid, as a knot of the table if it is one."""
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
    # torus knots in the table are recognised by their crossings, (p - 1) q
    for knot in candidates(found_invariants):
        if knot.crossings == (p - 1) * q and len(knot.factors) == 1:
            return knot
    return Knot((), found_invariants, title=f"T({p},{sign * q})")
