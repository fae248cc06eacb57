"""A TOML table whose values are checked, each for its kind and range, as they are read."""

from __future__ import annotations

import math
from typing import Any

from knotfab_validators.files.bad_file import BadFile, short

__all__ = ["Table", "Vector"]

Vector = tuple[float, float, float]

LEAST = 1e-9  # of a number that must be above 0: its square, and what it divides, stay finite
MOST = 1e15  # of any number: beyond, whole numbers overflow


class Table:
    """A table's values, each checked for its kind and range."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise BadFile(f"{where} must be a table")
        self.data, self.where = data, where

    def word(self, key: str, default: str, allowed: tuple[str, ...] = ()) -> str:
        value = self.data.get(key, default)
        if not isinstance(value, str) or (allowed and value not in allowed):
            wanted = f"one of {', '.join(allowed)}" if allowed else "a text"
            raise BadFile(f"{self.where} {key} must be {wanted}, got {short(value)}")
        return value

    def words(self, key: str, allowed: tuple[str, ...]) -> tuple[str, ...]:
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(word in allowed for word in value):
            wanted = f"a list of {', '.join(allowed)}"
            raise BadFile(f"{self.where} {key} must be {wanted}, got {short(value)}")
        return tuple(value)

    def flag(self, key: str, default: bool) -> bool:
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise BadFile(f"{self.where} {key} must be true or false, got {short(value)}")
        return value

    def number(
        self,
        key: str,
        default: float,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
        most: float = math.inf,
    ) -> float:
        value = self.data.get(key, default)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not abs(value) <= MOST
            or value < least
            or value <= above
            or (above == 0 and value < LEAST)
            or value > most
        ):
            raise BadFile(f"{self.where} {key} has an impossible value, {short(value)}")
        return float(value)

    def open_number(
        self,
        key: str,
        default: float | None,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
    ) -> float | None:
        """None where the scene says "auto", or says nothing and there is no default."""
        value = self.data.get(key, default)
        if value is None or value == "auto":
            return None
        return self.number(key, 0.0, least=least, above=above) if key in self.data else default

    def vector(self, key: str, default: Vector, *, above: float = -math.inf) -> Vector | None:
        """Three numbers, or None where the scene says "auto"."""
        if self.data.get(key) == "auto":
            return None
        return self.fixed_vector(key, default, above=above)

    def fixed_vector(self, key: str, default: Vector, *, above: float = -math.inf) -> Vector:
        x, y, z = Table({key: self.data.get(key, default)}, self.where).numbers(key, 3, above=above)
        return (x, y, z)

    def numbers(
        self,
        key: str,
        count: int,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
        most: float = math.inf,
    ) -> tuple[float, ...]:
        """So many numbers in a list; there is no default."""
        value = self.data.get(key)
        if not isinstance(value, list | tuple) or len(value) != count:
            words = {2: "two", 3: "three"}.get(count, count)
            raise BadFile(f"{self.where} {key} must be {words} numbers, got {short(value)}")
        return tuple(
            Table({key: item}, self.where).number(key, 0.0, least=least, above=above, most=most)
            for item in value
        )
