"""Numbers and lengths as people write them: `180`, `180mm`, `18 cm`, `7in`, `1,5`; always told in mm."""

from __future__ import annotations

import math
import re

from knotfab.base.errors import InputError

__all__ = ["read_length", "read_number"]

_UNITS_MM = {"": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0}
_UNITS_MM |= dict.fromkeys(("in", "inch", "inches", '"', "″"), 25.4)
_PLAIN = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:e[+-]?\d+)?"
_LENGTH = re.compile(rf"({_PLAIN})\s*(\D*)", re.IGNORECASE)
_TWO_WAYS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # 1.5 to some, 1500 to others


def read_number(what: str, text: str) -> float:
    """Read a number with a decimal point or comma.

    Args:
        what: names it in the message, such as `--threshold 0,3`.

    Raises:
        InputError: it is none, or it may be read in two ways.
    """
    plain = text.strip()
    if not re.fullmatch(_PLAIN, plain, re.IGNORECASE):
        raise InputError(what, "it is no number", "Give one such as 0.5.")
    point = plain.replace(",", ".")
    if _TWO_WAYS.fullmatch(plain):
        why = f"{plain} may be {float(point):g} or {plain.replace(',', '')}"
        raise InputError(what, why, "Write it without a comma.")
    return float(point)


def read_length(what: str, text: str, remedy: str = "") -> float:
    """Read a length in mm: a number with or without a unit (mm, cm, m, in).

    Args:
        remedy: what to give instead where it is no length.

    Raises:
        InputError: it is no length.
    """
    remedy = remedy or "Give millimetres, or a length with its unit, such as 180, 18cm or 7in."
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise InputError(what, "it is no length", remedy)
    number, unit = found.groups()
    if unit.strip().lower() not in _UNITS_MM:
        raise InputError(what, f"there is no unit {unit.strip()}", "Use mm, cm, m or in.")
    value = read_number(what, number) * _UNITS_MM[unit.strip().lower()]
    if not math.isfinite(value):
        raise InputError(what, "it is no length", remedy)
    return value
