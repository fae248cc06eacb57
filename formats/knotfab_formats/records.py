"""Records of what was found, as JSON has them and back.

A record is a frozen dataclass. A field whose default is None is left out of the JSON where nothing was found;
one without a default is null there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from math import isfinite
from os import PathLike, fspath
from typing import Any, TypeVar

from knotfab_formats.errors import spelled

__all__ = ["plain", "read_as"]

T = TypeVar("T")
_READERS: dict[type[Any], Any] = {}


def plain(value: Any) -> Any:
    """Return `value` in JSON's own types; numbers that are not finite become None.

    Raises:
        TypeError: the value has no such form.
    """
    if isinstance(value, str):
        return spelled(value)
    if value is None or isinstance(value, bool):
        return value
    if hasattr(value, "tolist"):  # an array or a number of numpy
        return plain(value.tolist())
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    if isinstance(value, PathLike):
        return spelled(fspath(value))
    if hasattr(value, "model_dump"):  # a model of pydantic
        return plain(value.model_dump())
    if is_dataclass(value):
        found = {f: getattr(value, f.name) for f in fields(value)}
        return {f.name: plain(x) for f, x in found.items() if x is not None or f.default is MISSING}
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def read_as(kind: type[T], content: Any) -> T:
    """Read the record in the content of a JSON text; keys that `kind` does not know are passed over.

    Raises:
        ValueError: a key lacks, or has a value of another type.
    """
    from pydantic import TypeAdapter

    if kind not in _READERS:
        _READERS[kind] = TypeAdapter(kind)
    found: T = _READERS[kind].validate_python(content)
    return found
