"""Text of CSS taken apart, in time linear in its length."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from PIL import ImageColor

from knotfab.picture.svg.size import read_length

Declarations = list[tuple[str, str]]

_SIGN = re.compile(r"""\\.|"[^"]*"|'[^']*'|[(){};]""", re.S)
_ESCAPE = re.compile(r"\\([0-9a-fA-F]{1,6})\s?")
_DEGREES = {"deg": 1.0, "grad": 0.9, "rad": 180 / 3.141592653589793, "turn": 360.0}


def strip_css(css: str) -> str:
    """Return a style sheet without comments and with escaped letters written out."""
    first, *rest = css.replace("<!--", "").replace("-->", "").split("/*")
    plain = " ".join([first, *(part.partition("*/")[2] for part in rest)])
    return (
        _ESCAPE.sub(lambda m: chr(min(int(m[1], 16), 0x10FFFF)), plain) if "\\" in plain else plain
    )


def split_statements(css: str) -> Iterator[tuple[str, str | None]]:
    """Yield what stands before each block, and the block; or a statement that has none, and None."""
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
    """Yield where each url() begins and ends, and what it refers to."""
    lower = text.lower()
    at = lower.find("url(")
    while at >= 0:
        end = text.find(")", at)
        if end < 0:
            return
        yield at, end + 1, text[at + 4 : end].strip().strip("\"'").strip()
        at = lower.find("url(", end)


def rem_in_px(text: str) -> str:
    """Return lengths with those in rem in px."""
    words = []
    for word in text.split():
        try:
            words.append(f"{16 * float(word[:-3]):.9g}" if word.lower().endswith("rem") else word)
        except ValueError:
            words.append(word)
    return " ".join(words)


def read_functions(text: str) -> list[str]:
    """Return CSS transform functions as SVG's, or nothing where one is not known."""
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
    """Return the parts of the shorthand `font`."""
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
