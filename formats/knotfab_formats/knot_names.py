"""The prime knots of up to 8 crossings by name: braid words, and what may be asked for.

Braid words are those of the table of knots, each the mirror image called right-handed (for the
trefoil the common one, whose crossings are positive).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from knotfab_formats.errors import InputError

__all__ = ["BRAIDS", "NICKNAMES", "NO_SUCH_KNOT", "Factor", "KnotName", "parse_knot_name"]


# Letter k > 0: strands k and k + 1 cross right-handedly; k < 0: left-handedly.
BRAIDS: dict[str, tuple[int, ...]] = {
    "3_1": (1, 1, 1),
    "4_1": (1, -2, 1, -2),
    "5_1": (1, 1, 1, 1, 1),
    "5_2": (1, 1, 1, 2, -1, 2),
    "6_1": (1, 1, 2, -1, -3, 2, -3),
    "6_2": (1, 1, 1, -2, 1, -2),
    "6_3": (1, 1, -2, 1, -2, -2),
    "7_1": (1, 1, 1, 1, 1, 1, 1),
    "7_2": (1, 1, 1, 2, -1, 2, 3, -2, 3),
    "7_3": (1, 1, 1, 1, 1, 2, -1, 2),
    "7_4": (1, 1, 2, -1, 2, 2, 3, -2, 3),
    "7_5": (1, 1, 1, 1, 2, -1, 2, 2),
    "7_6": (1, 1, -2, 1, 3, -2, 3),
    "7_7": (1, -2, 1, -2, 3, -2, 3),
    "8_1": (1, 1, 2, -1, 2, 3, -2, -4, 3, -4),
    "8_2": (1, 1, 1, 1, 1, -2, 1, -2),
    "8_3": (1, 1, 2, -1, -3, 2, -3, -4, 3, -4),
    "8_4": (1, 1, 1, -2, 1, -2, -3, 2, -3),
    "8_5": (1, 1, 1, -2, 1, 1, 1, -2),
    "8_6": (1, 1, 1, 1, 2, -1, -3, 2, -3),
    "8_7": (1, 1, 1, 1, -2, 1, -2, -2),
    "8_8": (1, 1, 1, 2, -1, -3, 2, -3, -3),
    "8_9": (1, 1, 1, -2, 1, -2, -2, -2),
    "8_10": (1, 1, 1, -2, 1, 1, -2, -2),
    "8_11": (1, 1, 2, -1, 2, 2, -3, 2, -3),
    "8_12": (1, -2, 1, 3, -2, -4, 3, -4),
    "8_13": (-1, -1, 2, -1, 2, 2, 3, -2, 3),
    "8_14": (1, 1, 1, 2, -1, 2, -3, 2, -3),
    "8_15": (1, 1, -2, 1, 3, 2, 2, 2, 3),
    "8_16": (1, 1, -2, 1, 1, -2, 1, -2),
    "8_17": (1, 1, -2, 1, -2, 1, -2, -2),
    "8_18": (1, -2, 1, -2, 1, -2, 1, -2),
    "8_19": (1, 1, 1, 2, 1, 1, 1, 2),
    "8_20": (1, 1, 1, 2, -1, -1, -1, 2),
    "8_21": (1, 1, 1, 2, -1, -1, 2, 2),
}

_AMPHICHIRAL = frozenset({"4_1", "6_3", "8_3", "8_9", "8_12", "8_17", "8_18"})
# names that people use, and those of the table
NICKNAMES = {
    "trefoil": "3_1",
    "figure-eight": "4_1",
    "figure eight": "4_1",
    "cinquefoil": "5_1",
    "stevedore": "6_1",
    "granny": "3_1#3_1",
    "square": "3_1#m3_1",
}
_WORDS = {**NICKNAMES, "t(2,3)": "3_1", "t(2,5)": "5_1", "t(2,7)": "7_1", "t(3,4)": "8_19"}
_MOST_FACTORS = 6
NO_SUCH_KNOT = (
    "Use trefoil, figure-eight, cinquefoil, stevedore, granny, square, a knot of the table from 3_1 to "
    'any of 8 crossings (8_19), with "left" or "right" before it if the hand matters, or a sum such '
    "as 3_1#4_1 (m3_1 is the left-handed one)."
)


@dataclass(frozen=True)
class Factor:
    """A prime knot of the table; `mirrored` is its left-handed form (never of an amphichiral one)."""

    name: str
    mirrored: bool


@dataclass(frozen=True)
class KnotName:
    """A knot that is asked for: `promise` is the type as knots.json states it, the unknot has no factors."""

    promise: str
    factors: tuple[Factor, ...]


def parse_knot_name(text: str) -> KnotName:
    """Return the knot that a name stands for; without a hand, the right-handed one.

    Raises:
        InputError: no such name is known.
    """
    name = " ".join(text.lower().replace("_{", "_").replace("}", "").split())
    name = re.sub(r"\(\s*(\d+)\s*,\s*(\d+)\s*\)", r"(\1,\2)", name)
    left = False
    if found := re.match(r"(left|right)(-handed)? ", name):
        left, name = found[1] == "left", name[found.end() :]
    name = name.removesuffix(" knot")
    if name in ("unknot", "trivial", "0_1", ""):
        return KnotName("unknot", ())
    factors = []
    for part in (p.strip() for p in _WORDS.get(name, name).split("#")):
        minus = part.startswith("m") and part.removeprefix("m") in BRAIDS
        plain = _WORDS.get(part, part.removeprefix("m") if minus else part)
        if plain not in BRAIDS:
            raise InputError(
                f"the knot {text!r}", "there is no such name in the table", NO_SUCH_KNOT
            )
        factors.append(Factor(plain, (minus != left) and plain not in _AMPHICHIRAL))
    if len(factors) > _MOST_FACTORS:
        raise InputError(
            f"the knot {text!r}",
            f"it is a sum of {len(factors)} knots",
            f"Use {_MOST_FACTORS} at most.",
        )
    return KnotName(_state_type(tuple(factors)), tuple(factors))


def _state_type(factors: tuple[Factor, ...]) -> str:
    """Return the type as a file states it: with the hand, where there is one."""
    hands = {f.mirrored for f in factors if f.name not in _AMPHICHIRAL}
    if len(hands) == 2:
        return "#".join(("m" if f.mirrored else "") + f.name for f in factors)
    hand = "" if not hands else "left-handed " if hands.pop() else "right-handed "
    return hand + "#".join(f.name for f in factors)
