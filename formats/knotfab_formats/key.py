"""The words of a scene's keys: the sentence below each, and the option of `knotfab build` that sets it."""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, Field

from knotfab_formats.bounds import Word

__all__ = [
    "as_written",
    "option",
    "option_of",
    "sentences_of",
    "takes_number",
    "values_of",
    "words_of",
]


def option(default: Any, name: str, **bounds: float) -> Any:
    """Return a key's default and the option that sets it, after its group: "Piece --lamp-distance"."""
    field: Any = Field
    return field(default, json_schema_extra={"option": name}, **bounds)


def option_of(model: type[BaseModel], key: str) -> tuple[str, str] | None:
    """Return the group and the name of the option that sets a key; None where there is none."""
    extra = model.model_fields[key].json_schema_extra
    if not isinstance(extra, dict):
        return None
    group, name = str(extra["option"]).split()
    return group, name


def words_of(model: type[BaseModel], key: str) -> tuple[str, ...]:
    """Return the words that a key takes beside, or instead of, a number."""
    kind = model.model_fields[key].annotation
    parts = (kind, *get_args(kind))
    literal = (w for part in parts if get_origin(part) is Literal for w in get_args(part))
    return (*values_of(model, key), *literal)


@cache
def values_of(model: type[BaseModel], key: str) -> dict[str, Any]:
    """Return what a key's words are read as, where that is another value: {"none": 0.0, "auto": None}."""
    parts = get_args(model.model_fields[key].annotation)
    found = (said for part in parts for said in getattr(part, "__metadata__", ()))
    return {said.word: said.value for said in found if isinstance(said, Word)}


def as_written(model: type[BaseModel], key: str, value: Any) -> Any:
    """Return a key's value as a file holds it: the word that stands for it, where there is one."""
    return next((word for word, read in values_of(model, key).items() if read == value), value)


def takes_number(model: type[BaseModel], key: str) -> bool:
    """Tell whether a key takes a number that need not be whole."""
    kind = model.model_fields[key].annotation
    return any(float in (part, *get_args(part)) for part in (kind, *get_args(kind)))


def sentences_of(model: type[BaseModel]) -> dict[str, str]:
    """Give the sentence that stands below each key of a table, read from the source when it is asked for."""
    found: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        if kind.__module__.startswith("knotfab_formats"):
            found |= _sentences(kind.__module__).get(kind.__name__, {})
    return found


@cache
def _sentences(module: str) -> dict[str, dict[str, str]]:
    """Return the sentences below the fields of each class of a module."""
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
