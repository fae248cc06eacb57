"""Text as a picture: `text:♞` becomes glyph outlines, then a PNG whose frame hugs them."""

from __future__ import annotations

import unicodedata
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab.errors import InputError
from knotfab.target.svg import LONGER_SIDE, render

if TYPE_CHECKING:
    from matplotlib.ft2font import FT2Font

__all__ = ["MARGIN", "render_text", "text_outline"]

MARGIN = 0.06  # clear space around the ink, in parts of the frame's longer side
_LONGEST = 200  # characters; more than this is no picture

# All of them come with matplotlib; the first that has a glyph draws it.
_FONTS = (
    "DejaVuSans",
    "DejaVuSansMono",
    "DejaVuSerif",
    "DejaVuSansDisplay",
    "STIXGeneral",
    "STIXNonUni",
    "STIXSizOneSymReg",
)
_SIZE = 1000  # points at 72 dpi, so outlines come in thousandths of an em


@cache
def _font(name: str) -> FT2Font:
    import matplotlib
    from matplotlib.ft2font import FT2Font

    font = FT2Font(f"{matplotlib.get_data_path()}/fonts/ttf/{name}.ttf")
    font.set_size(_SIZE, 72)
    return font


def _font_for(character: str, what: str) -> str:
    for name in _FONTS:
        if _font(name).get_char_index(ord(character)):
            return name
    known = unicodedata.name(character, "a control or unassigned character").lower()
    raise InputError(
        what,
        f"no font of this program has the character {character!r} "
        f"(U+{ord(character):04X}, {known})",
        "Use another character, or draw it as a PNG or SVG.",
    )


def text_outline(text: str) -> tuple[str, tuple[float, float, float, float]]:
    """Glyph outlines of one line of text as SVG path data.

    Args:
        text: characters in the order they are drawn, left to right; no shaping of scripts.

    Returns:
        Path data (thousandths of an em, y down, nonzero winding), and the bounds of the ink's
        control points: (left, top, right, bottom).

    Raises:
        InputError: no ink, too long, or a character that no font has.
    """
    what = "text:" + "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    # Variation selectors and joiners choose between styles of a glyph; these fonts have one.
    drawn = [c for c in text if c not in "\ufe0e\ufe0f\u200d"]
    if len(drawn) > _LONGEST:
        raise InputError(
            f"{what[:20]}...", f"it has {len(drawn)} characters", f"Use at most {_LONGEST}."
        )
    from matplotlib.ft2font import Kerning, LoadFlags

    flags = LoadFlags.NO_HINTING | LoadFlags.NO_BITMAP
    parts: list[str] = []
    corners: list[NDArray[np.float64]] = []
    pen = 0.0
    previous: tuple[str, Any] = ("", 0)
    for character in drawn:
        name = _font_for(character, what)
        font = _font(name)
        index = font.get_char_index(ord(character))
        if previous[0] == name:
            pen += font.get_kerning(previous[1], index, Kerning.UNFITTED) / 64.0
        glyph = font.load_char(ord(character), flags=flags)
        vertices, codes = font.get_path()
        if len(vertices):
            placed = np.asarray(vertices) * (1.0, -1.0) + (pen, 0.0)
            corners.append(placed[np.asarray(codes) != 79])
            parts.append(_path_data(placed, codes))
        pen += glyph.linearHoriAdvance / 65536.0
        previous = (name, index)
    if not corners:
        raise InputError(
            "text:", "there is no visible character after it", "Write, for example, text:R."
        )
    ink = np.concatenate(corners)
    (left, top), (right, bottom) = ink.min(axis=0), ink.max(axis=0)
    return " ".join(parts), (float(left), float(top), float(right), float(bottom))


def _path_data(vertices: NDArray[np.float64], codes: Any) -> str:
    """SVG path data from vertices and codes (1 move, 2 line, 3 and 4 curves, 79 end)."""
    data: list[str] = []
    i = 0
    while i < len(codes):
        code = int(codes[i])
        if code == 79:
            data.append("Z")
            i += 1
            continue
        letter, points = {1: ("M", 1), 2: ("L", 1), 3: ("Q", 2), 4: ("C", 3)}[code]
        data.append(letter + " ".join(f"{x:.6f},{y:.6f}" for x, y in vertices[i : i + points]))
        i += points
    return " ".join(data)


def render_text(text: str) -> bytes:
    """Draw text, black on white, as a canonical PNG.

    Args:
        text: what stands after `text:`.

    Returns:
        A PNG, 2048 px on the longer side; the frame hugs the ink with a margin of 6 % of that.

    Raises:
        InputError: no ink, or a character that no font has.
    """
    data, (left, top, right, bottom) = text_outline(text)
    width, height = right - left, bottom - top
    margin = max(width, height) * MARGIN / (1.0 - 2.0 * MARGIN)
    box = (left - margin, top - margin, width + 2 * margin, height + 2 * margin)
    # Whole pixels: the frame's shorter side is rounded outwards, never the ink cut or squeezed.
    step = max(box[2], box[3]) / LONGER_SIDE
    columns, rows = (max(1, round(side / step)) for side in box[2:])
    view = (
        box[0] - 0.5 * (columns * step - box[2]),
        box[1] - 0.5 * (rows * step - box[3]),
        columns * step,
        rows * step,
    )
    x, y, w, h = (f"{v:.9f}" for v in view)
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{columns}" height="{rows}" '
        f'viewBox="{x} {y} {w} {h}" preserveAspectRatio="none">'
        f'<rect x="{x}" y="{y}" width="{w}" height="{h}" fill="white"/><path d="{data}"/></svg>'
    )
    return render(svg, "text:")
