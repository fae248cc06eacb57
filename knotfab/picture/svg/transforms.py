"""Lists of transform functions and origins, of SVG or CSS, as matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import NamedTuple

from fontTools.misc.transform import Identity, Transform

from knotfab.picture.svg.size import read_length

_FUNCTION = re.compile(r"\s*,?\s*([A-Za-z0-9]+)\s*\(([^()]*)\)")
NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)([a-z%]*)", re.I)
_ANGLES = {"": 180.0, "deg": 180.0, "grad": 200.0, "rad": math.pi, "turn": 0.5}
_SIDES = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}


class Box(NamedTuple):
    """A rectangle, y down."""

    left: float
    top: float
    width: float
    height: float


class UnreadableError(ValueError):
    """A value that is not understood."""


def as_function(name: str, value: str) -> str:
    """Return a property such as `rotate: z 30deg` as the function of the same name."""
    parts = value.replace(",", " ").split()
    if name == "rotate" and len(parts) > 1:
        axis = " ".join(p for p in parts if not p.lower().endswith(tuple(_ANGLES)[1:]))
        angle = [p for p in parts if p not in axis.split()]
        if axis.lower() not in ("z", "0 0 1") or len(angle) != 1:
            raise UnreadableError(f"rotate: {value}")
        parts = angle
    if name == "scale":
        if any(NUMBER.fullmatch(p) is None for p in parts):
            raise UnreadableError(f"scale: {value}")
        parts = [f"{float(p[:-1]) / 100:g}" if p.endswith("%") else p for p in parts]
    return f"{name}({' '.join(parts[:2])})"


def read_list(text: str, box: Box) -> Transform:
    """Read the matrix of a list of transform functions, of SVG or CSS.

    Raises:
        UnreadableError: a function or an argument is not known.
    """
    matrix, at = Identity, 0
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.S).strip().rstrip(",")
    if text.lower() in ("none", "inherit"):
        return matrix
    while at < len(text):
        found = _FUNCTION.match(text, at)
        if found is None:
            raise UnreadableError(text[at:])
        at = found.end()
        matrix = matrix.transform(_read_function(found[1].lower(), found[2], box))
        at += len(text[at:]) - len(text[at:].lstrip())
    return matrix


def _read_function(name: str, arguments: str, box: Box) -> Transform:
    words = arguments.replace(",", " ").split() or spread(arguments)
    if any(NUMBER.fullmatch(w) is None for w in words):  # numbers may follow each other unparted
        words = spread(arguments)
    values = [0.0] * len(words)
    for k, word in enumerate(words):
        number, unit = NUMBER.fullmatch(word).groups()  # type: ignore[union-attr]
        if name.startswith(("rotate", "skew")) and k < (1 if name == "rotate" else 2):
            if unit.lower() not in _ANGLES:
                raise UnreadableError(f"{name}({arguments})")
            values[k] = float(number) / _ANGLES[unit.lower()] * math.pi
        else:
            whole = box[3] if name == "translatey" or k == 1 else box[2]
            length = (
                0.01 * float(number)
                if unit == "%" and "scale" in name
                else read_length(word, whole)
            )
            if length is None:
                raise UnreadableError(f"{name}({arguments})")
            values[k] = length
    try:
        return _KINDS[name](*values)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UnreadableError(f"{name}({arguments})") from error


def spread(text: str) -> list[str]:
    """Return numbers that follow each other unparted, as in 1-2.5.5."""
    if NUMBER.sub("", text).strip(" ,\t\r\n"):
        raise UnreadableError(text)
    return [m[0] for m in NUMBER.finditer(text)]


_KINDS: dict[str, Callable[..., Transform]] = {
    "matrix": lambda a, b, c, d, e, f: Transform(a, b, c, d, e, f),
    "matrix3d": lambda *v: Transform(v[0], v[1], v[4], v[5], v[12], v[13]),
    "translate": lambda x, y=0.0: Identity.translate(x, y),
    "translatex": lambda x: Identity.translate(x, 0),
    "translatey": lambda y: Identity.translate(0, y),
    "translate3d": lambda x, y, z: Identity.translate(x, y),
    "translatez": lambda z: Identity,
    "scale": lambda x, y=None: Identity.scale(x, x if y is None else y),
    "scalex": lambda x: Identity.scale(x, 1),
    "scaley": lambda y: Identity.scale(1, y),
    "scale3d": lambda x, y, z: Identity.scale(x, y),
    "scalez": lambda z: Identity,
    "rotate": lambda a, x=0.0, y=0.0: Identity.translate(x, y).rotate(a).translate(-x, -y),
    "rotatez": lambda a: Identity.rotate(a),
    "rotatex": lambda a: Identity.scale(1, math.cos(a)),
    "rotatey": lambda a: Identity.scale(math.cos(a), 1),
    "skew": lambda a, b=0.0: Transform(1, math.tan(b), math.tan(a), 1, 0, 0),
    "skewx": lambda a: Identity.skew(a, 0),
    "skewy": lambda a: Identity.skew(0, a),
    "perspective": lambda d: Identity,
}


def read_origin(text: str, box: Box) -> tuple[float, float]:
    words = text.lower().split()[:2] or ["0", "0"]
    if len(words) == 1:
        words.append("center")
    if words[0] in ("top", "bottom") or words[1] in ("left", "right"):
        words.reverse()
    x, y = (
        read_length(_SIDES.get(word, word), whole)
        for word, whole in zip(words, box[2:], strict=True)
    )
    if x is None or y is None:
        raise UnreadableError(f"transform-origin: {text}")
    return box[0] + x, box[1] + y
