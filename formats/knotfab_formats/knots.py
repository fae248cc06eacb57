"""What a knots.json holds: the knots, and the members of the mount that holds them."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field, Strict, ValidationError

from knotfab_formats.bounds import MOST_COORDINATE_MM, Vector
from knotfab_formats.errors import short

__all__ = ["KnotsFile", "Member", "why_no_knots"]

MOST_KNOTS = 1000
MOST_MEMBERS = 10_000  # members of a mount; a build makes a hundred

_Radius = Annotated[float, Strict(), Field(gt=0, le=MOST_COORDINATE_MM)]
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


class Line(BaseModel):
    """A knot's centre line, a polygon in mm; where it is `closed` the last point joins the first."""

    model_config = _FINITE

    closed: Annotated[bool, Strict()] = True
    type: Annotated[str, Strict()] = ""
    points: Annotated[list[Vector], FailFast()]

    @property
    def promise(self) -> str:
        """The type, also where the file leaves it out."""
        return self.type or ("unknot" if self.closed else "open")


class KnotsFile(BaseModel):
    """The whole of a knots.json (docs/contract.md), or of a start, whose `coordinates` are the scene's."""

    model_config = _FINITE

    number: Annotated[Literal[1], Field(alias="schema")]
    unit: Literal["mm"] = "mm"
    radius_mm: _Radius | None = None
    knots: Annotated[list[Line], FailFast(), Field(min_length=1, max_length=MOST_KNOTS)]
    members: Annotated[list[Member], FailFast(), Field(max_length=MOST_MEMBERS)] = []
    coordinates: str = ""

    def dumps(self) -> str:
        """Return the text of the file, with the keys that were given."""
        return json.dumps(self.model_dump(by_alias=True, exclude_unset=True))


_WANTED = {
    "schema": "must be 1, no other is known",
    "unit": "must be 'mm'",
    "radius_mm": "must be a number above 0",
    "members": f"must be a list of at most {MOST_MEMBERS}",
    "closed": "must be true or false",
    "type": "must be a word such as 'unknot' or '3_1'",
}


def why_no_knots(error: ValidationError) -> str:
    """Return what keeps a content from being a `KnotsFile`, in words that name the knot and the point."""
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
        case ("members", number, *keys):
            where = " ".join(str(step) for step in ("members: number", number, *keys))
            return f"{where}: {first['msg'].lower()}"
    key, where = place[-1], f"knot {place[1]}: " if len(place) > 1 else ""
    has = "it is missing" if kind == "missing" else f"got {short(got)}"
    return f"{where}{key} {_WANTED.get(key, first['msg'].lower())}, {has}"
