"""The kinds of numbers in a scene, with their bounds; a value beyond them must be a slip.

Neither text nor a truth value passes for a number, but an integer does. `knotfab schema` prints the bounds.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, Field, Strict, TypeAdapter, ValidationError, ValidationInfo
from pydantic_core import CoreSchema, core_schema

MOST_MM, LEAST_MM = 1e5, 1e-3  # the shadow on a tower; a thousandth of a hair
MOST_COORDINATE_MM = 1e5  # a part's coordinates: 100 m; farther ones make its checks take minutes
_LONGEST_MM = 1e7  # a tube
_FAR_MM = 1e9  # a lamp that stands for the sun, and the radius of an almost flat wall
_MOST_WHOLE = 10**9


AUTO = "auto"  # how a file says that the build is to choose


@dataclass(frozen=True)
class Word:
    """Reads a word of a file as a value, so that no stage deals with words; a table writes it back.

    A word for nothing is read as None or, if None stands for `AUTO`, as 0 or False.
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
        """Put the word in place of its value, which a program may pass, but not a file (`about.context`)."""
        alike = type(value) is type(self.value) and value == self.value
        return self.word if alike and (value is None or about.context is None) else value


Auto = Annotated[None, Word(AUTO)]
Number = Annotated[float, Strict()]
Length = Annotated[float, Strict(), Field(ge=LEAST_MM, le=MOST_MM)]
Spread = Annotated[float, Strict(), Field(ge=0, le=MOST_MM)]  # a length that may be 0
LampDistance = Annotated[float, Strict(), Field(ge=LEAST_MM, le=_FAR_MM)]
TubeLength = Annotated[float, Strict(), Field(ge=1, le=_LONGEST_MM)]
Coordinate = Annotated[float, Strict(), Field(ge=-MOST_COORDINATE_MM, le=MOST_COORDINATE_MM)]
Shift = Annotated[float, Strict(), Field(ge=-MOST_MM, le=MOST_MM)]
Angle = Annotated[float, Strict(), Field(ge=-90, le=90)]
Turn = Annotated[float, Strict(), Field(ge=-3600, le=3600)]
Density = Annotated[float, Strict(), Field(ge=1e-3, le=25)]  # from aerogel to osmium
Modulus = Annotated[float, Strict(), Field(ge=1e-3, le=2e6)]  # MPa
# ambient light over the lamp's own, and areas in m²
Ratio = Annotated[float, Strict(), Field(ge=0, le=1e6)]
Volume = Annotated[float, Strict(), Field(ge=0, le=1e9)]  # cm³
Amount = Annotated[float, Strict(), Field(gt=0, le=1e5)]  # hours, grams
Pixels = Annotated[float, Strict(), Field(gt=0, le=1024)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Extent = tuple[Length, Length, Length]
Row = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Matrix = tuple[Row, Row, Row, Row]
Count = Annotated[int, Strict(), Field(ge=1, le=1000)]
Whole = Annotated[int, Strict(), Field(ge=0, le=_MOST_WHOLE)]
Side = Annotated[int, Strict(), Field(ge=1, le=_MOST_WHOLE)]


def why_out_of_bounds(model: type[BaseModel], key: str, value: Any) -> str | None:
    """Say in words which bounds of a key a number exceeds; None if it does not."""
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
    # pydantic strips Strict, Ge, … from the field's own type, but not from its branches
    kind: Any = Annotated[(field.annotation, *field.metadata, None)]
    return kind, TypeAdapter(kind)


def _bounds(kind: Any) -> Iterator[Any]:
    """Yield the bounds in an annotation, lower one first."""
    for part in get_args(kind):
        for bound in getattr(part, "metadata", [part]):
            if isinstance(bound, Ge | Gt | Le | Lt):
                yield bound
        yield from _bounds(part)


# The documentation of a scene's keys: the sentence below each, and the build option that sets it.


def option(default: Any, name: str, **bounds: float) -> Any:
    """Declare a key's default and the option that sets it, after its group: "Piece --lamp-distance"."""
    field: Any = Field
    return field(default, json_schema_extra={"option": name}, **bounds)


def option_of(model: type[BaseModel], key: str) -> tuple[str, str] | None:
    """Return the group and the name of the option that sets a key; None if there is none."""
    extra = model.model_fields[key].json_schema_extra
    if not isinstance(extra, dict):
        return None
    group, name = str(extra["option"]).split()
    return group, name


def words_of(model: type[BaseModel], key: str) -> tuple[str, ...]:
    """List the words that a key takes beside, or instead of, a number."""
    kind = model.model_fields[key].annotation
    parts = (kind, *get_args(kind))
    literal = (w for part in parts if get_origin(part) is Literal for w in get_args(part))
    return (*values_of(model, key), *literal)


@cache
def values_of(model: type[BaseModel], key: str) -> dict[str, Any]:
    """Return the values that a key's words are read as, if they differ: {"none": 0.0, "auto": None}."""
    parts = get_args(model.model_fields[key].annotation)
    found = (said for part in parts for said in getattr(part, "__metadata__", ()))
    return {said.word: said.value for said in found if isinstance(said, Word)}


def as_written(model: type[BaseModel], key: str, value: Any) -> Any:
    """Return a key's value as a file holds it: by the word that stands for it, if there is one."""
    return next((word for word, read in values_of(model, key).items() if read == value), value)


def takes_number(model: type[BaseModel], key: str) -> bool:
    """Return whether a key takes numbers that are not integers."""
    kind = model.model_fields[key].annotation
    return any(float in (part, *get_args(part)) for part in (kind, *get_args(kind)))


def sentences_of(model: type[BaseModel]) -> dict[str, str]:
    """Return the sentence below each key of a table, read from the source when first needed."""
    found: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        if kind.__module__.startswith("knotfab_formats"):
            found |= _sentences(kind.__module__).get(kind.__name__, {})
    return found


@cache
def _sentences(module: str) -> dict[str, dict[str, str]]:
    """Parse the sentences below the fields of each class of a module."""
    found: dict[str, dict[str, str]] = {}
    for kind in ast.parse(inspect.getsource(sys.modules[module])).body:
        if not isinstance(kind, ast.ClassDef):
            continue
        for field, said in pairwise(kind.body):
            match field, said:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=text)
                ):
                    found.setdefault(kind.name, {})[name] = " ".join(str(text).split())
    return found
