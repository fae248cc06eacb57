"""Colours of CSS Color 4 and 5 as the eight hexadecimal digits that every SVG library reads."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import tinycss2

_KEPT = ("inherit", "context-fill", "context-stroke", "none")
_SPACES = {"xyz": "xyz-d65"}
_PLAIN = re.compile(r"#(?:[0-9a-f]{3}|[0-9a-f]{6})", re.I)
_SYSTEM = {  # CSS Color 4, section 6.2, in a light scheme
    "canvas": "#ffffff", "canvastext": "#000000", "field": "#ffffff", "fieldtext": "#000000",
    "linktext": "#0000ee", "visitedtext": "#551a8b", "activetext": "#ff0000", "buttonface": "#efefef",
    "buttontext": "#000000", "buttonborder": "#000000", "highlight": "#b5d5ff", "highlighttext": "#000000",
    "graytext": "#808080", "mark": "#ffff00", "marktext": "#000000", "accentcolor": "#0078d4",
    "window": "#ffffff", "windowtext": "#000000", "infobackground": "#ffffff", "infotext": "#000000",
}  # fmt: skip


@lru_cache(4096)
def to_hex(text: str) -> str | None:
    """Return a colour as `#rrggbb` or `#rrggbbaa`, clipped to sRGB; the words that name none, as they are.

    A scheme of light and dark counts as light. None where it is no colour.
    """
    text = re.sub(r"\bicc-color\(.*", "", text.strip(), flags=re.S | re.I).strip()
    word = text.lower()
    if word == "currentcolor":
        return "currentColor"  # the library spells it so
    if word in _KEPT or _PLAIN.fullmatch(word):
        return word
    if word in _SYSTEM:
        return _SYSTEM[word]
    mixed = _mix(word)
    found = mixed if mixed is not None else _parse(word)
    if found is None:
        return None
    return str(found.convert("srgb").fit(method="clip").to_string(hex=True, alpha=None))


def _parse(text: str) -> Any:
    """Return a colour of coloraide's, or None."""
    from coloraide import Color

    try:
        return Color(text)
    except (ValueError, ArithmeticError, TypeError):
        return None


def _mix(text: str) -> Any:
    """Compute light-dark() and color-mix(), or None."""
    name = text.partition("(")[0]
    if name not in ("light-dark", "color-mix") or not text.endswith(")"):
        return None
    parts = [part.strip() for part in _split(text[len(name) + 1 : -1])]
    if name == "light-dark":
        found = to_hex(parts[0])
        return None if found is None else _parse(found)
    space = re.fullmatch(r"in ([a-z0-9-]+)(?: \w+ hue)?", parts[0])
    colours: list[Any] = []
    shares: list[float | None] = []
    for part in parts[1:]:
        share = re.search(r"(?:^|\s)([\d.]+)%(?=\s|$)", part)
        shares.append(None if share is None else float(share[1]) / 100)
        bare = part if share is None else part.replace(share[0], " ", 1)
        hexed = to_hex(bare)
        colours.append(None if hexed is None else _parse(hexed))
    if space is None or len(colours) != 2 or None in colours:
        return None
    one, other = shares
    if one is None and other is None:
        one = 0.5
    first = one if one is not None else 1 - (other or 0)
    second = other if other is not None else 1 - first
    if first + second <= 0:
        return None
    try:
        mixed = colours[0].mix(
            colours[1], second / (first + second), space=_SPACES.get(*space.groups() * 2)
        )
    except (ValueError, KeyError):  # a space that there is not
        return None
    return mixed.set("alpha", mixed.alpha() * min(1.0, first + second))


def _split(text: str) -> list[str]:
    """Return the arguments of a function, parted by the commas outside its brackets."""
    parts: list[list[Any]] = [[]]
    for token in tinycss2.parse_component_value_list(text):
        if token.type == "literal" and token.value == ",":
            parts.append([])
        else:
            parts[-1].append(token)
    return [tinycss2.serialize(part) for part in parts]
