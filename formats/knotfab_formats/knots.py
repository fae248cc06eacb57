"""The contents of knots.json: the knots, and the mount that holds them; and the names of knot types."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field, Strict, ValidationError

from knotfab_formats.bounds import MOST_COORDINATE_MM, Vector
from knotfab_formats.errors import InputError, short

MOST_KNOTS = 1000
MOST_MEMBERS = 10_000  # members of a mount; a build makes about a hundred
MOST_CORNERS = 5_000  # corners of a hull

_Radius = Annotated[float, Strict(), Field(gt=0, le=MOST_COORDINATE_MM)]
_Ring = Annotated[list[Vector], FailFast(), Field(min_length=3, max_length=MOST_MEMBERS)]
_FINITE = ConfigDict(frozen=True, allow_inf_nan=False)


class Member(BaseModel):
    """A member of a mount, from a centre line to its foot or to another centre line; lengths in mm.

    `radius_mm` are those of its ends, `foot` the unit normal of the plate, wall or base that it stands on.
    """

    model_config = _FINITE

    start: Annotated[Vector, Field(alias="from")]
    end: Annotated[Vector, Field(alias="to")]
    radius_mm: tuple[_Radius, _Radius]
    foot: Vector | None = None


class Slab(BaseModel):
    """A flat plate in which the piece stands; lengths in mm.

    `outline` are the corners of its face, whose unit normal is `out`, and `openings` those of each opening
    in it; `holes` are the middles of round holes there, `hole_mm` wide, that go through.
    """

    model_config = _FINITE

    outline: _Ring
    openings: Annotated[list[_Ring], Field(max_length=MOST_KNOTS)] = []
    holes: Annotated[list[Vector], Field(max_length=10)] = []
    hole_mm: _Radius
    thickness_mm: _Radius
    out: Vector


class Bar(BaseModel):
    """A break-away bar, a separate level box that holds two strands apart while they print; mm."""

    model_config = _FINITE

    start: Annotated[Vector, Field(alias="from")]
    end: Annotated[Vector, Field(alias="to")]
    width_mm: _Radius
    height_mm: _Radius


class Feet(BaseModel):
    """Feet cut level so that each valley stands flat; `cut_mm` of the lowest one's tube is missing."""

    model_config = _FINITE

    cut_mm: Annotated[float, Strict(), Field(ge=0, le=MOST_COORDINATE_MM)]


class Rod(BaseModel):
    """A round bar of a mount that need not begin in a strand, such as a side of an eyelet; mm."""

    model_config = _FINITE

    start: Annotated[Vector, Field(alias="from")]
    end: Annotated[Vector, Field(alias="to")]
    radius_mm: _Radius


class Hull(BaseModel):
    """A convex solid of a mount, such as a base or a dowel: the hull of its corners, mm."""

    model_config = _FINITE

    name: Annotated[str, Strict(), Field(max_length=40)] = "solid"
    corners: Annotated[list[Vector], FailFast(), Field(min_length=4, max_length=MOST_CORNERS)]


class Line(BaseModel):
    """A knot's centre line, a polygon in mm; a `closed` one joins its last point to its first."""

    model_config = _FINITE

    closed: Annotated[bool, Strict()] = True
    type: Annotated[str, Strict()] = ""
    points: Annotated[list[Vector], FailFast()]

    @property
    def promise(self) -> str:
        """The knot type, with a default if the file leaves it out."""
        return self.type or ("unknot" if self.closed else "open")


class KnotsFile(BaseModel):
    """All of a knots.json (docs/contract.md), or of a start, whose `coordinates` are the scene's."""

    model_config = _FINITE

    number: Annotated[Literal[1], Field(alias="schema")]
    unit: Literal["mm"] = "mm"
    radius_mm: _Radius | None = None
    knots: Annotated[list[Line], FailFast(), Field(min_length=1, max_length=MOST_KNOTS)]
    members: Annotated[list[Member], FailFast(), Field(max_length=MOST_MEMBERS)] = []
    plate: Slab | None = None
    bars: Annotated[list[Bar], FailFast(), Field(max_length=MOST_MEMBERS)] = []
    feet: Feet | None = None
    rods: Annotated[list[Rod], FailFast(), Field(max_length=MOST_MEMBERS)] = []
    hulls: Annotated[list[Hull], FailFast(), Field(max_length=MOST_KNOTS)] = []
    coordinates: str = ""

    def dumps(self) -> str:
        """Serialise the file, with only the keys that were given."""
        return json.dumps(self.model_dump(by_alias=True, exclude_unset=True))


_WANTED = {
    "schema": "must be 1, no other is known",
    "unit": "must be 'mm'",
    "radius_mm": "must be a number above 0",
    "plate": "must hold outline, hole_mm, thickness_mm and out",
    "members": f"must be a list of at most {MOST_MEMBERS}",
    "bars": f"must be a list of at most {MOST_MEMBERS}",
    "feet": "must hold cut_mm, a number from 0",
    "rods": f"must be a list of at most {MOST_MEMBERS}",
    "hulls": f"must be a list of at most {MOST_KNOTS}",
    "closed": "must be true or false",
    "type": "must be a word such as 'unknot' or '3_1'",
}


def why_no_knots(error: ValidationError) -> str:
    """Say why a content is no `KnotsFile`, naming the knot and the point."""
    first: Any = error.errors(include_url=False)[0]
    kind, got, place = first["type"], first["input"], first["loc"]
    match place:
        case ():
            return "must hold an object with the keys schema, radius_mm and knots"
        case ("knots",):
            count = f", it has {len(got)} knots" if kind == "too_long" else ""
            return f"knots must be a list of at least one knot, of {MOST_KNOTS} at most{count}"
        case ("knots", knot, "points", point, *_):
            if kind == "finite_number":
                return f"knot {knot}: point {point} is not finite"
            if kind.endswith("_equal"):
                return f"knot {knot}: point {point} lies beyond {MOST_COORDINATE_MM:g} mm"
            return f"knot {knot}: points must be [x, y, z], of numbers, and point {point} is not"
        case ("knots", knot) | ("knots", knot, "points"):
            return f"knot {knot} has no points: they must be a list of [x, y, z], of numbers"
        case ("plate", *keys):
            where = " ".join(str(step) for step in ("plate:", *keys))
            return f"{where}: {first['msg'].lower()}"
        case ("members" | "bars" | "rods" | "hulls" as what, number, *keys):
            where = " ".join(str(step) for step in (f"{what}: number", number, *keys))
            return f"{where}: {first['msg'].lower()}"
    key, where = place[-1], f"knot {place[1]}: " if len(place) > 1 else ""
    has = "it is missing" if kind == "missing" else f"got {short(got)}"
    return f"{where}{key} {_WANTED.get(key, first['msg'].lower())}, {has}"


# The prime knots of up to 8 crossings: their names and braid words, and the parser of names.


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
# common names, and those in the table
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
    """A prime knot of the table; `mirrored` is its left-handed form (never set for an amphichiral one)."""

    name: str
    mirrored: bool


@dataclass(frozen=True)
class KnotName:
    """A requested knot; `promise` is its type as in knots.json. The unknot has no factors."""

    promise: str
    factors: tuple[Factor, ...]


def parse_knot_name(text: str) -> KnotName:
    """Parse the name of a knot; without a hand, it is the right-handed one.

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
    """Write the type as a file states it, with the hand if there is one."""
    hands = {f.mirrored for f in factors if f.name not in _AMPHICHIRAL}
    if len(hands) == 2:
        return "#".join(("m" if f.mirrored else "") + f.name for f in factors)
    hand = "" if not hands else "left-handed " if hands.pop() else "right-handed "
    return hand + "#".join(f.name for f in factors)
