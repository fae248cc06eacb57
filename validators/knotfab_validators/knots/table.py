"""The knots of up to 10 crossings and their sums, to be recognised by their invariants."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources

from knotfab_validators.knots.floer import Floer
from knotfab_validators.knots.invariants import UNKNOT, Invariants
from knotfab_validators.knots.polynomial import Laurent, laurent

__all__ = [
    "MOST_CROSSINGS",
    "Factor",
    "Knot",
    "braid_of",
    "braid_word",
    "candidates",
    "known_knot",
    "prime_names",
]

MOST_CROSSINGS = 10  # the table holds all knots that have a diagram of so many
MOST_OF_SUMS = 12  # crossings of sums that are looked for


@dataclass(frozen=True, order=True)
class Factor:
    """A prime knot of the table: `hand` 1 right-handed, -1 left-handed, 0 the same as its mirror image."""

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
        """The crossings of all factors together."""
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
    """Return a sum of prime knots of the table."""
    result = UNKNOT
    for factor in factors:
        result = result * _prime(factor)
    return Knot(tuple(sorted(factors)), result)


def candidates(found: Invariants) -> tuple[Knot, ...]:
    """Return the knots of the table, and sums of them with 12 crossings at most, that fit, simplest first."""
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
    """Return the names in the table."""
    return tuple(_table()["knots"])


def braid_word(name: str) -> tuple[int, ...]:
    """Give a braid whose closure is the right-handed knot of that name (see planar_diagram.closed_braid)."""
    return tuple(_table()["knots"][name]["braid"])


def braid_of(knot: Knot) -> tuple[int, ...]:
    """Return a braid whose closure is a knot of the table or a sum of such."""
    word: list[int] = []
    strands = 0
    for factor in knot.factors:
        letters = [(factor.hand or 1) * letter for letter in braid_word(factor.name)]
        word += [letter + (strands if letter > 0 else -strands) for letter in letters]
        strands += max(map(abs, letters))
    return tuple(word)


def is_amphichiral(name: str) -> bool:
    """Tell whether the knot is the same as its mirror image."""
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
