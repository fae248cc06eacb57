"""Find where the letters of an SVG's text lie: each is drawn in its own colour, and nothing else is drawn."""

from __future__ import annotations

import io
import unicodedata
from copy import deepcopy
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from PIL import Image

from knotfab.picture.fonts import needs_shaping
from knotfab.picture.svg.xml import SVG, local_name

# Unicode categories without a glyph of their own: controls, separators, marks
UNDRAWN = ("Cc", "Cf", "Mn", "Zl", "Zp", "Zs")

_STEP, _BASE = 36, 8  # levels of a channel are so far apart that no opacity mixes them up
_MOST = _BASE**3 - 2  # the first colour is black, the last nearly white: drawings have both
_LEAST_PX = 3  # parts of fewer pixels are where two letters touch
_LONGEST = 20  # signs of a text that is named as a whole
# elements whose content shapes or paints others, and is not drawn where it stands
_OTHERS = ("clipPath", "mask", "pattern", "filter", "marker")


class Letter(NamedTuple):
    """The box of a connected part of a letter, or of a whole text, whose name is then in quotation marks.

    All parts of one letter share its `number`, its place in the drawing.
    """

    number: int
    name: str
    left: float
    top: float
    right: float
    bottom: float


def colour_letters(drawing: Element) -> tuple[Element, list[str]]:
    """Return a copy of a drawing that shows only its text, in a colour for each name, and the names.

    A text whose letters hang together or whose width is given keeps one colour, since its letters cannot be
    drawn separately.
    """
    root = deepcopy(drawing)
    texts = list(root.iter(f"{{{SVG}}}text"))
    _hide(root)
    names: list[str] = []
    for text in texts:
        said = " ".join("".join(text.itertext()).split())
        drawn = sum(unicodedata.category(sign) not in UNDRAWN for sign in said)
        if not drawn:
            continue
        given = any(e.get("textLength") or "textLength" in e.get("style", "") for e in text.iter())
        if len(names) + drawn <= _MOST and not given and not needs_shaping(said):
            _split(text, names)
        elif len(names) < _MOST:
            short = said if len(said) <= _LONGEST else f"{said[: _LONGEST - 1]}…"
            names.append(f"“{short}”")
            for element in text.iter():
                _paint(element, len(names))
    return root, names


def find_boxes(png: bytes, names: list[str], enlarged: float) -> tuple[Letter, ...]:
    """Find the boxes of what `colour_letters` coloured, times `enlarged`, one for each connected part."""
    from scipy.ndimage import find_objects, label  # light calls read no letters

    with Image.open(io.BytesIO(png)) as image:
        drawn = np.asarray(image.convert("RGBA"))
    digits = np.minimum(np.rint(drawn[..., :3] / _STEP).astype(int), _BASE - 1)
    numbers = np.where(drawn[..., 3] > 15, digits @ (_BASE**2, _BASE, 1), 0)
    found = []
    for number, box in enumerate(find_objects(numbers, len(names)), start=1):
        if box is None:
            continue
        rows, columns = box
        parts, _ = label(numbers[box] == number, np.ones((3, 3)))
        for which, (down, across) in enumerate(find_objects(parts), start=1):
            if np.count_nonzero(parts[down, across] == which) >= _LEAST_PX:
                sides = (
                    columns.start + across.start,
                    rows.start + down.start,
                    columns.start + across.stop,
                    rows.start + down.stop,
                )
                found.append(
                    Letter(number, names[number - 1], *(enlarged * side for side in sides))
                )
    return tuple(found)


def _hide(element: Element) -> None:
    """Hide everything but text, except elements that only shape others."""
    name = local_name(element)
    if name in _OTHERS:
        return
    element.set("visibility", "visible" if name == "text" else "hidden")
    for child in element if name != "text" else ():
        _hide(child)


def _split(element: Element, names: list[str]) -> None:
    """Wrap each letter of a text in its own span, and add the letters to `names`."""
    children, spans = list(element), list[Element]()
    element.text = _append(spans, names, element.text)
    for child in children:
        _split(child, names)
        spans.append(child)
        child.tail = _append(spans, names, child.tail)
        element.remove(child)
    element.extend(spans)


def _append(spans: list[Element], names: list[str], said: str | None) -> str:
    """Append a span for each drawn sign; undrawn ones follow it, and those before the first are returned."""
    before, ours = "", len(spans)
    for sign in said or "":
        if unicodedata.category(sign) not in UNDRAWN:
            names.append(sign)
            spans.append(Element(f"{{{SVG}}}tspan"))
            spans[-1].text = sign
            _paint(spans[-1], len(names))
        elif len(spans) > ours:
            spans[-1].tail = (spans[-1].tail or "") + sign
        else:
            before += sign
    return before


def _paint(element: Element, number: int) -> None:
    """Fill an element with the colour of this number."""
    digits = (number // _BASE**2, number // _BASE % _BASE, number % _BASE)
    colour = "".join(f"{_STEP * digit:02x}" for digit in digits)
    style = element.get("style", "").rstrip("; ")
    element.set("style", f"{style};fill:#{colour};fill-opacity:1;stroke-opacity:0".lstrip(";"))
