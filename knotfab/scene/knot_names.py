"""The prime knots of up to 8 crossings by name: braid words, tight centre lines, and what may be asked for.

Braid words are those of the table of knots, each the mirror image called right-handed (for the
trefoil the common one, whose crossings are positive); the tight centre lines were made from them by
`paper/named_knots.py`, which a test repeats in part.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import InputError
from knotfab.geometry.sampling import arc_lengths

__all__ = ["BRAIDS", "Factor", "KnotName", "load_knot", "parse_knot_name"]


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
_WORDS = {
    "trefoil": "3_1",
    "figure-eight": "4_1",
    "figure eight": "4_1",
    "cinquefoil": "5_1",
    "stevedore": "6_1",
    "granny": "3_1#3_1",
    "square": "3_1#m3_1",
    "t(2,3)": "3_1",
    "t(2,5)": "5_1",
    "t(2,7)": "7_1",
    "t(3,4)": "8_19",
}
_UNKNOT = ("unknot", "trivial", "0_1", "")
_MOST_FACTORS = 6
_REMEDY = (
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
    """What was asked for: `promise` is the type as knots.json states it, the unknot has no factors."""

    promise: str
    factors: tuple[Factor, ...]


def parse_knot_name(text: str) -> KnotName:
    """The knot that a name stands for; without a hand, the right-handed one.

    Raises:
        InputError: no such name is known.
    """
    name = " ".join(text.lower().replace("_{", "_").replace("}", "").split())
    name = re.sub(r"\(\s*(\d+)\s*,\s*(\d+)\s*\)", r"(\1,\2)", name)
    left = False
    if found := re.match(r"(left|right)(-handed)? ", name):
        left, name = found[1] == "left", name[found.end() :]
    name = name.removesuffix(" knot")
    if name in _UNKNOT:
        return KnotName("unknot", ())
    factors = []
    for part in (p.strip() for p in _WORDS.get(name, name).split("#")):
        minus = part.startswith("m") and part.removeprefix("m") in BRAIDS
        plain = _WORDS.get(part, part.removeprefix("m") if minus else part)
        if plain not in BRAIDS:
            raise InputError(f"the knot {text!r}", "there is no such name in the table", _REMEDY)
        factors.append(Factor(plain, (minus != left) and plain not in _AMPHICHIRAL))
    if len(factors) > _MOST_FACTORS:
        raise InputError(
            f"the knot {text!r}",
            f"it is a sum of {len(factors)} knots",
            f"Use {_MOST_FACTORS} at most.",
        )
    return KnotName(_state_type(tuple(factors)), tuple(factors))


def _state_type(factors: tuple[Factor, ...]) -> str:
    """The type as a file states it: with the hand, where there is one."""
    hands = {f.mirrored for f in factors if f.name not in _AMPHICHIRAL}
    if len(hands) == 2:
        return "#".join(("m" if f.mirrored else "") + f.name for f in factors)
    hand = "" if not hands else "left-handed " if hands.pop() else "right-handed "
    return hand + "#".join(f.name for f in factors)


@cache
def _table() -> dict[str, Any]:
    text = (
        resources.files("knotfab.scene").joinpath("data", "knots.toml").read_text(encoding="utf-8")
    )
    return tomllib.loads(text)["knots"]  # type: ignore[no-any-return]


def load_knot(name: str, mirrored: bool = False, step: float = 0.4) -> Array:
    """The tight centre line of a knot of the table, (n, 3) in tube radii, about its middle.

    Vertices are about `step` apart. Strands keep 2 between them and bends a radius of 1.

    Raises:
        InputError: no such knot is known.
    """
    if name not in BRAIDS:
        raise InputError(f"the knot {name!r}", "there is no such name in the table", _REMEDY)
    from scipy.interpolate import CubicSpline

    points = np.asarray(_table()[name], dtype=np.float64)
    arc = arc_lengths(points)
    spline = CubicSpline(arc, np.concatenate([points, points[:1]]), bc_type="periodic")
    fine = spline(np.linspace(0.0, arc[-1], 8 * len(points) + 1))
    run = arc_lengths(fine[:-1])
    count = max(12, round(run[-1] / step))
    at = np.interp(np.arange(count) * run[-1] / count, run, np.linspace(0.0, arc[-1], len(fine)))
    result = np.asarray(spline(at), dtype=np.float64)
    result -= result.mean(axis=0)
    return result * [1.0, 1.0, -1.0] if mirrored else result
