"""Text of CSS taken apart in time linear in its length, and lengths in any unit as pixels."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from xml.etree.ElementTree import Element

from PIL import ImageColor

from knotfab_formats.errors import InputError

Declarations = list[tuple[str, str]]

_SIGN = re.compile(r"""\\.|"[^"]*"|'[^']*'|[(){};]""", re.S)
_ESCAPE = re.compile(r"\\([0-9a-fA-F]{1,6})\s?")
_DEGREES = {"deg": 1.0, "grad": 0.9, "rad": 180 / 3.141592653589793, "turn": 360.0}


def strip_css(css: str) -> str:
    """Remove a style sheet's comments, and decode its escaped letters."""
    first, *rest = css.replace("<!--", "").replace("-->", "").split("/*")
    plain = " ".join([first, *(part.partition("*/")[2] for part in rest)])
    return (
        _ESCAPE.sub(lambda m: chr(min(int(m[1], 16), 0x10FFFF)), plain) if "\\" in plain else plain
    )


def split_statements(css: str) -> Iterator[tuple[str, str | None]]:
    """Yield each statement of a style sheet: the text before its block, and the block or None."""
    start = depth = brackets = 0
    opened = -1
    for match in _SIGN.finditer(css):
        sign = match[0]
        if sign in "()":
            brackets = max(0, brackets + (1 if sign == "(" else -1))
        elif sign == "{" and (depth or not brackets):
            if depth == 0:
                opened = match.start()
            depth += 1
        elif sign == "}":
            depth, brackets = max(0, depth - 1), 0
            if depth == 0:
                if opened >= start:
                    yield css[start:opened].strip(), css[opened + 1 : match.start()]
                start = match.end()
        elif sign == ";" and not depth and not brackets:
            yield css[start : match.start()].strip(), None
            start = match.end()
    if depth:
        yield css[start:opened].strip(), css[opened + 1 :]
    elif rest := css[start:].strip():
        yield rest, None


def read_declarations(body: str, tell_nested: Callable[[str], None] | None = None) -> Declarations:
    found = []
    for text, block in split_statements(strip_css(body)):
        name, colon, value = text.partition(":")
        if block is not None:
            if tell_nested is not None:
                tell_nested(text)
        elif colon and value.strip():
            bare = name.strip()
            found.append((bare if bare.startswith("--") else bare.lower(), value.strip()))
    return found


def write_declarations(body: Declarations) -> str:
    return ";".join(f"{name}:{value}" for name, value in body)


def find_links(text: str) -> Iterator[tuple[int, int, str]]:
    """Yield the start, end and target of each url()."""
    lower = text.lower()
    at = lower.find("url(")
    while at >= 0:
        end = text.find(")", at)
        if end < 0:
            return
        yield at, end + 1, text[at + 4 : end].strip().strip("\"'").strip()
        at = lower.find("url(", end)


def rem_in_px(text: str) -> str:
    """Convert lengths in rem to px; others stay as they are."""
    words = []
    for word in text.split():
        try:
            words.append(f"{16 * float(word[:-3]):.9g}" if word.lower().endswith("rem") else word)
        except ValueError:
            words.append(word)
    return " ".join(words)


def read_functions(text: str) -> list[str]:
    """Convert CSS transform functions to SVG's; return nothing if one is unknown."""
    found = []
    for part in text.split(")")[:-1]:
        name, bracket, inner = part.strip(" ,\t\n").partition("(")
        numbers = []
        for value in inner.replace(",", " ").split():
            unit = value.lstrip("+-.0123456789")
            try:
                if unit in _DEGREES:
                    numbers.append(float(value[: -len(unit)]) * _DEGREES[unit])
                else:
                    length = read_length(value)
                    if length is None:
                        return []
                    numbers.append(length)
            except ValueError:
                return []
        known = {"translate": 2, "scale": 2, "rotate": 1, "matrix": 6, "skewx": 1, "skewy": 1}
        name = {"translatex": "translate", "scalex": "scale"}.get(name, name)
        if name == "translatey" and len(numbers) == 1:
            name, numbers = "translate", [0.0, *numbers]
        elif name in ("scaley", "scale") and len(numbers) == 1:
            name, numbers = "scale", [1.0 if name == "scaley" else numbers[0], *numbers]
        least = 6 if name == "matrix" else 1
        if not bracket or not least <= len(numbers) <= known.get(name, 0):
            return []
        written = {"skewx": "skewX", "skewy": "skewY"}.get(name, name)
        found.append(f"{written}({' '.join(f'{n:.9g}' for n in numbers)})")
    return found


def is_colour(word: str) -> bool:
    if word.startswith("#"):
        return len(word) in (4, 5, 7, 9) and all(c in "0123456789abcdef" for c in word[1:])
    return word in ImageColor.colormap or word.startswith(("rgb(", "rgba(", "hsl(", "hsla("))


def page_colour(word: str) -> str | None:
    try:
        return "#{:02x}{:02x}{:02x}".format(*ImageColor.getrgb(word)[:3])
    except ValueError:
        return None


def expand_font(text: str) -> Declarations:
    """Expand the shorthand `font` into its properties."""
    words = text.replace("/", " / ").split()
    sizes = ("medium", "small", "large", "smaller", "larger", "x-small", "x-large", "xx-large")
    at = next((i for i, w in enumerate(words) if (w[0] in ".0123456789" and not w.isdigit())
               or w.lower() in sizes), None)  # fmt: skip
    if at is None:
        return []
    family = words[at + 1 :]
    if family[:1] == ["/"]:
        family = family[2:]
    parts = [("font-size", words[at]), ("font-family", " ".join(family))]
    for word in map(str.lower, words[:at]):
        if word in ("italic", "oblique"):
            parts.append(("font-style", word))
        elif word == "small-caps":
            parts.append(("font-variant", word))
        elif word in ("bold", "bolder", "lighter") or word.isdigit():
            parts.append(("font-weight", word))
        elif word.endswith(("condensed", "expanded")):
            parts.append(("font-stretch", word))
    return parts


# Lengths, and the size of a drawing, in pixels.

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
    if (
        box is not None
    ):  # a side that is not given follows from the other by the viewBox (CSS Images 3, 4.4)
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
