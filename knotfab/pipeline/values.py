"""Read the values of options, such as lengths with units, times and colours, from text or Python."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel

from knotfab.base.errors import read_length, read_number
from knotfab_formats.bounds import option_of, takes_number, why_out_of_bounds, words_of
from knotfab_formats.errors import InputError
from knotfab_formats.piece import MOST_BEND
from knotfab_formats.views import View

_TIME = re.compile(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)\s*")
_MOST_S = 100 * 86400.0  # a hundred days
_SECONDS = {"": 1.0}
_SECONDS |= dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0)
_SECONDS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0)
_SECONDS |= dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0)
# examples of lengths that are none of a frame or a distance
_SUCH_MM = {"tube_radius_mm": 2, "thicken_mm": 5, "light_diameter_mm": 5}
_FAR_MM = 200


def read_value(model: type[BaseModel], key: str, value: Any, option: str = "") -> Any:
    """Read the value of an option that sets a key: a word stays one, a length becomes mm.

    Args:
        option: its name in messages, if that is not the one the key is declared with.

    Raises:
        InputError: it is wrong or out of bounds.
    """
    option = option or (option_of(model, key) or ("", ""))[1]
    words, numeric = words_of(model, key), takes_number(model, key)
    whole = model.model_fields[key].annotation is int
    said = f"{option} {value!r}" if isinstance(value, bool) else f"{option} {value}"
    if hasattr(value, "item"):  # a number of numpy's
        value = value.item()
    if model.model_fields[key].annotation is bool:
        if not isinstance(value, bool):
            raise InputError(said, "it is neither True nor False", "Give one of them.")
    elif key in _READERS:
        return _READERS[key](option, value)
    elif isinstance(value, str) and (plain := value.strip().lower()) in words:
        return plain
    elif whole or numeric:
        known = f", or {' or '.join(words)}" if words else ""
        if isinstance(value, str) and key.endswith("_mm"):
            such = _SUCH_MM.get(key, _FAR_MM)
            value = read_length(said, value, f"Give millimetres, such as {option} {such}{known}.")
        elif isinstance(value, str):
            value = read_whole(said, value) if whole else read_number(said, value)
        elif isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            kind = "whole number" if whole else "number"
            raise InputError(said, f"it is no {kind}", "Give one such as 3.")
        _check_bounds(model, key, value, said, known)
    elif words:
        raise InputError(said, "there is no such choice", f"Choose from {', '.join(words)}.")
    elif not isinstance(value, str) or why_out_of_bounds(model, key, value) is not None:
        what, remedy = f"{option} {str(value)[:40]!r}", "Give one line of at most 200 signs."
        raise InputError(what, "it is no line of text", remedy)
    return value


def as_text(value: Any) -> str:
    """Write an option's value as the command line takes it."""
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return str(value)


def read_seconds(text: str, name: str = "--time-budget") -> float:
    """Read a time such as `30`, `90s`, `1.5min`, `1m30s` or `1h` in seconds.

    Args:
        name: of the option, for the error message.

    Raises:
        InputError: it is not a positive time.
    """
    plain = re.sub(r"(?<=\d),(?=\d)", ".", text.strip().lower())
    parts = _TIME.findall(plain)
    if "".join(_TIME.sub("", plain).split()) or any(unit not in _SECONDS for _, unit in parts):
        parts = []
    if len(parts) > 1 and any(unit == "" for _, unit in parts):
        parts = []  # "1 30" is ambiguous
    seconds = sum(float(number) * _SECONDS[unit] for number, unit in parts)
    if not 0 < seconds <= _MOST_S:
        raise InputError(
            f"{name} {text}",
            "it is longer than 100 days" if seconds > 0 else "it is not a positive time",
            f"Give seconds or minutes, such as {name} 30, 90s, 1.5min or 1m30s.",
        )
    return seconds


def _check_bounds(model: type[BaseModel], key: str, value: Any, what: str, known: str = "") -> None:
    bounds = why_out_of_bounds(model, key, value)
    if bounds is not None:
        unit = {"mm": "millimetres", "px": "pixels"}.get(key.rpartition("_")[2], "a number")
        why = "it is out of bounds"
        if value <= 0 and why_out_of_bounds(model, key, -1e-9) is not None:
            least = why_out_of_bounds(model, key, 0) is None
            why = "it is below 0" if least else "it is not above 0"
        length = _SUCH_MM.get(key, _FAR_MM)
        such = f", such as {what.split()[0]} {length}" if key.endswith("_mm") else ""
        raise InputError(what, why, f"Give {unit} {bounds}{such}{known}.")


def read_whole(said: str, text: str) -> int:
    """Read a whole number of 63 bits.

    Raises:
        InputError: it is none.
    """
    plain = text.strip()
    if not re.fullmatch(r"[+-]?[0-9]+", plain):
        raise InputError(said, "it is no whole number", "Give one such as 3.")
    if len(plain) > 30 or abs(int(plain)) >= 2**63:
        raise InputError(said, "it is too large", "Give one such as 3.")
    return int(plain)


def _read_ink(option: str, text: Any) -> str:
    """Read one of the words of `ink`, or a colour as #rrggbb."""
    plain = str(text).strip().lower()
    words = words_of(View, "ink")
    if plain in words:
        return plain
    from PIL import ImageColor

    try:
        return "#{:02x}{:02x}{:02x}".format(*ImageColor.getrgb(plain)[:3])
    except ValueError as error:
        remedy = f"Use {', '.join(words)}, or a colour such as red or #d02010."
        raise InputError(f"{option} {text}", "it is no colour", remedy) from error


def _pixel_reader(
    count: int, what: str, remedy: str, words: tuple[str, ...] = ()
) -> Callable[..., Any]:
    """Return a reader of `count` whole pixels, all but the first two of them above 0, or of words."""

    def read(option: str, value: Any) -> Any:
        text = as_text(value).strip()
        parts = re.findall(r"[^\s,;]+", text.strip("()[]").lower().replace("px", ""))
        if text.lower() in words:
            return text.lower()
        if len(parts) == count and all(re.fullmatch("[0-9]{1,6}", part) for part in parts):
            numbers = tuple(map(int, parts))
            if min(numbers[2:]) > 0:
                return numbers
        raise InputError(f"{option} {text}", what, f"Use {remedy.format(option)}.")

    return read


_BOX = "left, top, width and height in whole px"


def _read_count(option: str, value: Any) -> int | str:
    if value == "auto":
        return "auto"
    if isinstance(value, bool) or not re.fullmatch(r"0*[0-9]{1,9}", str(value)) or not int(value):
        raise InputError(
            f"{option} {value}",
            "it is neither auto nor a number",
            "Use auto (one knot a piece of the picture), or how many knots its pieces are bridged into.",
        )
    if int(value) > 1000:
        raise InputError(f"{option} {value}", "it is out of bounds", "Give a number up to 1000.")
    return int(value)


def _read_largest(option: str, value: Any) -> int:
    count = read_whole(f"{option} {value}", str(value))
    if count == 0:  # which means all of them in a scene
        raise InputError(f"{option} 0", "it is out of bounds", "Give a whole number from 1.")
    _check_bounds(View, "keep_largest", count, f"{option} {count}")
    return count


def _read_bend(option: str, value: Any) -> float | str:
    """Read "auto", "off", or a share of a picture's height."""
    plain = str(value).strip().lower()
    if plain in ("auto", "off"):
        return plain
    try:
        share = float(plain)
    except ValueError:
        share = math.nan
    if share == 0:
        return "off"
    if not 0 < share <= MOST_BEND:
        raise InputError(
            f"{option} {value}",
            f"it is no share of a picture's height up to {MOST_BEND:g}, beyond which nobody knows it",
            "Use auto, off, or how far a point may move, such as --bend 0.05",
        )
    return share


def _read_share(option: str, value: Any) -> float:
    """Read a number that may be given in percent."""
    text = str(value).strip()
    share = read_number(f"{option} {text}", text.removesuffix("%")) / (100 if "%" in text else 1)
    _check_bounds(View, "threshold", share, f"{option} {text}")
    return share


def _read_accepted(option: str, value: Any) -> tuple[str, ...]:
    words = (value,) if isinstance(value, str) else tuple(value)
    if set(words) - {"unrecognisable"}:
        raise InputError(
            f"{option} {as_text(words)}", "there is no such choice", "Choose from unrecognisable."
        )
    return words


# keys whose options take other words than the keys themselves
_READERS: dict[str, Callable[..., Any]] = {
    "ink": _read_ink,
    "crop_px": _pixel_reader(
        4,
        "it is no part of a picture",
        f"auto, or {_BOX}, such as {{}} 20,40,600,400",
        ("auto", "none", "paper"),
    ),
    "keep_largest": _read_largest,
    "threshold": _read_share,
    "knots": _read_count,
    "bend": _read_bend,
    "accept": _read_accepted,
}
