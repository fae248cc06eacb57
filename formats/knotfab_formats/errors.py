"""Errors that a user can act on: each names the thing, the reason and the remedy (docs/contract.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from math import isfinite
from os import PathLike, fspath
from typing import Any, TypeVar


def shown(thing: object, most: int = 600) -> str:
    """Quote a thing on one line, cut after `most` characters; what no terminal shows stands as its number."""
    try:
        text = str(thing)
    except (ValueError, RecursionError):  # a number with thousands of digits; deeply nested lists
        return "something too long to be shown"
    signs = [
        c
        if c.isprintable()
        else f"\\x{ord(c) - 0xDC00:02x}"
        if "\udc80" <= c <= "\udcff"
        else repr(c)[1:-1]
        for c in text[: most + 1]
    ]
    plain = "".join(signs)
    return plain if len(plain) <= most else f"{plain[:most]} …"


def short(thing: object) -> str:
    """Quote what a file holds, for a sentence about that file."""
    return shown(thing, 80)


def in_digits(value: float, digits: int = 2) -> str:
    """Write a number in so many significant digits, never with an exponent below a million: 6.1, 100."""
    return f"{float(f'{value:.{digits}g}'):g}"


def spelled(text: str) -> str:
    """Replace bytes of a name that are not UTF-8 by their numbers, so that any encoding can hold it."""
    return re.sub("[\ud800-\udfff]", lambda found: shown(found[0]), text)


class KnotfabError(Exception):
    """Base of all errors that knotfab raises on purpose; `exit_code` follows the contract."""

    exit_code = 2

    def __init__(self, what: str, why: str, remedy: str) -> None:
        self.what, self.why, self.remedy = shown(what), why, remedy
        # a remedy may end in a command or a path, which a full stop would spoil for copying
        stop = "" if ": " in remedy or not remedy[-1:].isalnum() else "."
        about = f"{self.what}: " if what else ""
        super().__init__(f"{about}{why}. {remedy}{stop}")


class InputError(KnotfabError):
    """The picture, the scene file or the call is wrong."""

    exit_code = 2


# Convert records to JSON and back.

T = TypeVar("T")
_READERS: dict[type[Any], Any] = {}


def plain(value: Any) -> Any:
    """Convert `value` to JSON's own types; numbers that are not finite become None.

    Raises:
        TypeError: the value has no such form.
    """
    if isinstance(value, str):
        return spelled(value)
    if value is None or isinstance(value, bool):
        return value
    if hasattr(value, "tolist"):  # a numpy array or number
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
    if hasattr(value, "model_dump"):  # a pydantic model
        return plain(value.model_dump())
    if is_dataclass(value):
        found = {f: getattr(value, f.name) for f in fields(value)}
        return {f.name: plain(x) for f, x in found.items() if x is not None or f.default is MISSING}
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def read_as(kind: type[T], content: Any) -> T:
    """Parse a record from JSON text; keys that `kind` does not have are ignored.

    Raises:
        ValueError: a key is missing, or has a value of another type.
    """
    from pydantic import TypeAdapter

    if kind not in _READERS:
        _READERS[kind] = TypeAdapter(kind)
    found: T = _READERS[kind].validate_python(content)
    return found
