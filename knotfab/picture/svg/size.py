"""Lengths, and the size of a drawing, in pixels."""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Element

from knotfab_formats.errors import InputError

CSS_DPI = 96.0  # CSS Values 3, section 6.2: 96 px to the inch
_FONT_PX = 16.0  # px of the default font, which defines em and ex
_PIXELS = {
    "": 1.0,
    "px": 1.0,
    "in": CSS_DPI,
    "cm": CSS_DPI / 2.54,
    "mm": CSS_DPI / 25.4,
    "q": CSS_DPI / 101.6,
    "pt": CSS_DPI / 72.0,
    "pc": CSS_DPI / 6.0,
    "em": _FONT_PX,
    "ex": 0.5 * _FONT_PX,
    "rem": _FONT_PX,
}
_LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z]*|%)")
_LONGEST = 64  # most characters of a length


def _match(text: str) -> re.Match[str] | None:
    text = text.strip()
    return _LENGTH.fullmatch(text) if len(text) <= _LONGEST else None


def read_length(text: str, whole: float | None = None) -> float | None:
    """Parse a length into px; None if its unit is unknown. `whole` is what % refers to."""
    found = _match(text)
    if found is None:
        return None
    number, unit = float(found[1]), found[2].lower()
    if unit == "%":
        return None if whole is None else number / 100.0 * whole
    return number * _PIXELS[unit] if unit in _PIXELS else None


def set_pixel_size(root: Element, longer: int, what: str) -> float:
    """Set a drawing's width and height to whole pixels.

    resvg rounds a drawing's own size to whole pixels before it enlarges it: 40 mm x 20 mm, which are
    151.18 x 75.59 px, would come out 0.7 % too high. So the size is enlarged first. A drawing that
    states neither a size nor a viewBox is left alone: resvg takes what is drawn.

    Args:
        root: <svg>; its width, height and (if there is none) viewBox are set in place.
        longer: pixels of the longer side.
        what: how an error names the picture.

    Returns:
        The longer side in CSS px, as the drawing states it; `longer` if it states none.

    Raises:
        InputError: a width, height or viewBox is zero or negative.
    """
    box = _view_box(root, what)
    width = _pixels(root, "width", None if box is None else box[0], what)
    height = _pixels(root, "height", None if box is None else box[1], what)
    # a side that is not given follows from the other by the viewBox (CSS Images 3, 4.4)
    if box is not None:
        if width is None and height is None:
            width, height = box
        elif width is None and height is not None:
            width = height * box[0] / box[1]
        elif height is None and width is not None:
            height = width * box[1] / box[0]
    if width is None or height is None:
        return float(longer)
    if box is None:
        root.set("viewBox", f"0 0 {width!r} {height!r}")
        root.set("preserveAspectRatio", "none")  # the ratio is kept but for the rounding
    scale = longer / max(width, height)
    root.set("width", str(max(1, round(width * scale))))
    root.set("height", str(max(1, round(height * scale))))
    return max(width, height)


def _view_box(root: Element, what: str) -> tuple[float, float] | None:
    """Return the width and height of the viewBox; None where it is missing or unreadable."""
    try:
        numbers = [float(n) for n in root.get("viewBox", "").replace(",", " ").split()]
    except ValueError:
        return None
    if len(numbers) != 4 or not all(map(math.isfinite, numbers)):
        return None
    _require_positive(min(numbers[2:]), f"viewBox = {root.get('viewBox')!r}", what)
    return numbers[2], numbers[3]


def _pixels(root: Element, side: str, whole: float | None, what: str) -> float | None:
    """Return a side in px; None if it is missing, of unknown unit, or a share of something unknown.

    `whole` is what % refers to: that side of the viewBox.
    """
    text = root.get(side, "")
    if found := _match(text):
        _require_positive(float(found[1]), f"{side} = {text!r}", what)
    return read_length(text, whole)


def _require_positive(number: float, text: str, what: str) -> None:
    if not (number > 0 and math.isfinite(number)):
        raise InputError(
            what, f"its size is nothing: {text}", "Set the size of the page in an SVG editor."
        )
