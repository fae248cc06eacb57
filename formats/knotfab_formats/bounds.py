"""Every kind of number that a scene holds, with its bounds: a value beyond is a slip, or no part at all.

A number is a number (whole ones too), never a text or a truth value that looks like one. The bounds are
shown by docs/scene.schema.json.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

__all__ = [
    "AUTO",
    "MOST_COORDINATE_MM",
    "MOST_MM",
    "Angle",
    "Auto",
    "Coordinate",
    "Count",
    "Density",
    "Extent",
    "LampDistance",
    "Length",
    "Matrix",
    "Modulus",
    "Number",
    "Pixels",
    "Ratio",
    "Row",
    "Shift",
    "Side",
    "Spread",
    "TubeLength",
    "Turn",
    "Vector",
    "Volume",
    "WallRadius",
    "Whole",
    "Word",
    "why_out_of_bounds",
]

MOST_MM, LEAST_MM = 1e5, 1e-3  # the shadow on a tower; a thousandth of a hair
MOST_COORDINATE_MM = 1e7  # coordinates, and a tube's length
_FAR_MM = 1e9  # a lamp that stands for the sun, and the radius of a wall that is all but flat
_MOST_WHOLE = 10**9


def _not_nothing(radius: float) -> float:
    """Positive: hollow towards the light; negative: a column."""
    if abs(radius) < LEAST_MM:
        raise PydanticCustomError(
            "radius", "a radius, not 0: positive of a hollow wall, negative of a column"
        )
    return radius


AUTO = "auto"  # the word of a file for what a build is to choose


@dataclass(frozen=True)
class Word:
    """Reads a word of a file as a value, so that no stage tells words from numbers; a table writes it again.

    A word for nothing is read as None; where the key may be `AUTO` too, which is None then, as 0 or False.
    """

    word: str
    value: Any = None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        word = core_schema.no_info_after_validator_function(
            lambda _: self.value, core_schema.literal_schema([self.word])
        )
        return core_schema.with_info_before_validator_function(
            self._spell, word, serialization=core_schema.simple_ser_schema("any")
        )

    def _spell(self, value: Any, about: ValidationInfo) -> Any:
        """Return the word for its own value, which a program may give, but no file (`about.context`)."""
        alike = type(value) is type(self.value) and value == self.value
        return self.word if alike and (value is None or about.context is None) else value


Auto = Annotated[None, Word(AUTO)]
Number = Annotated[float, Strict()]
Length = Annotated[float, Strict(), Field(ge=LEAST_MM, le=MOST_MM)]
Spread = Annotated[float, Strict(), Field(ge=0, le=MOST_MM)]  # a length that may be nothing
LampDistance = Annotated[float, Strict(), Field(ge=LEAST_MM, le=_FAR_MM)]
TubeLength = Annotated[float, Strict(), Field(ge=1, le=MOST_COORDINATE_MM)]
Coordinate = Annotated[float, Strict(), Field(ge=-MOST_COORDINATE_MM, le=MOST_COORDINATE_MM)]
Shift = Annotated[float, Strict(), Field(ge=-MOST_MM, le=MOST_MM)]
WallRadius = Annotated[
    float, Strict(), Field(ge=-_FAR_MM, le=_FAR_MM), AfterValidator(_not_nothing)
]
Angle = Annotated[float, Strict(), Field(ge=-90, le=90)]
Turn = Annotated[float, Strict(), Field(ge=-3600, le=3600)]
Density = Annotated[float, Strict(), Field(ge=1e-3, le=25)]  # from aerogel to osmium
Modulus = Annotated[float, Strict(), Field(ge=1e-3, le=2e6)]  # MPa
Ratio = Annotated[
    float, Strict(), Field(ge=0, le=1e6)
]  # over the lamp's own light, and square metres
Volume = Annotated[float, Strict(), Field(ge=0, le=1e9)]  # cm³
Pixels = Annotated[float, Strict(), Field(gt=0, le=1024)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Extent = tuple[Length, Length, Length]
Row = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Matrix = tuple[Row, Row, Row, Row]
Count = Annotated[int, Strict(), Field(ge=1, le=1000)]
Whole = Annotated[int, Strict(), Field(ge=0, le=_MOST_WHOLE)]
Side = Annotated[int, Strict(), Field(ge=1, le=_MOST_WHOLE)]


def why_out_of_bounds(model: type[BaseModel], key: str, value: Any) -> str | None:
    """Return the bounds of a key, in words, where a number lies beyond them; None where it does not."""
    kind, adapter = _kind_of(model, key)
    try:
        adapter.validate_python(value)
    except ValidationError:
        words = {Ge: "from", Gt: "above", Le: "up to", Lt: "below"}
        found = [(words[type(b)], getattr(b, type(b).__name__.lower())) for b in _bounds(kind)]
        return " ".join(f"{word} {bound:.12g}" for word, bound in found)
    return None


@cache
def _kind_of(model: type[BaseModel], key: str) -> tuple[Any, TypeAdapter[Any]]:
    """Return the type of a key with its bounds, and the adapter that checks its values."""
    field = model.model_fields[key]
    # pydantic takes Strict, Ge, … off the field's own type, and leaves them in its branches
    kind: Any = Annotated[(field.annotation, *field.metadata, None)]
    return kind, TypeAdapter(kind)


def _bounds(kind: Any) -> Iterator[Any]:
    """Yield the bounds in an annotation, the lower one first."""
    for part in get_args(kind):
        for bound in getattr(part, "metadata", [part]):
            if isinstance(bound, Ge | Gt | Le | Lt):
                yield bound
        yield from _bounds(part)
