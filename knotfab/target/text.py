"""Text as a picture: `text:♞` becomes glyph outlines, then a PNG whose frame hugs them."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.errors import InputError
from knotfab.target.fonts import find_font, load_font, supply_fonts
from knotfab.target.raster import MARGIN
from knotfab.target.svg.render import LONGER_SIDE, render

__all__ = ["Outline", "outline_text", "render_text"]

_LONGEST = 200  # characters; more than this is no picture


@dataclass(frozen=True)
class Outline:
    """Glyphs of one line of text as SVG path data (thousandths of an em, y down, nonzero winding).

    `bounds` are those of the ink's control points: (left, top, right, bottom). `fonts` are the files
    that were drawn from, in the order of their first characters.
    """

    path: str
    bounds: tuple[float, float, float, float]
    fonts: tuple[str, ...]


def outline_text(text: str, font: str | None = None) -> Outline:
    """Glyph outlines of one line of text.

    Args:
        text: characters in the order they are drawn, left to right; no shaping of scripts.
        font: a family's name or a font file; characters that it lacks come from other fonts.

    Raises:
        InputError: no ink, too long, no such font, or a character that no font has.
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
    fonts = supply_fonts(font)
    used: dict[str, None] = {}
    parts: list[str] = []
    corners: list[NDArray[np.float64]] = []
    pen = 0.0
    previous: tuple[str, Any] = ("", 0)
    for character in drawn:
        name = find_font(character, fonts, what)
        face = load_font(name)
        used[name] = None
        index = face.get_char_index(ord(character))
        if previous[0] == name:
            pen += face.get_kerning(previous[1], index, Kerning.UNFITTED) / 64.0
        glyph = face.load_char(ord(character), flags=flags)
        vertices, codes = face.get_path()
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
    bounds = (float(left), float(top), float(right), float(bottom))
    return Outline(" ".join(parts), bounds, tuple(used))


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


def render_text(text: str, font: str | None = None) -> bytes:
    """Draw text, black on white, as a canonical PNG.

    Args:
        text: what stands after `text:`.
        font: a family's name or a font file; None: the first of those that come along that serves.

    Returns:
        A PNG, 2048 px on the longer side; the frame hugs the ink with a margin of 6 % of that. Its
        text entry `Font` names the files of the fonts that were drawn from.

    Raises:
        InputError: no ink, no such font, or a character that no font has.
    """
    drawn = outline_text(text, font)
    left, top, right, bottom = drawn.bounds
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
        f'<rect x="{x}" y="{y}" width="{w}" height="{h}" fill="white"/><path d="{drawn.path}"/></svg>'
    )
    return _with_note(render(svg, "text:"), "Font", ", ".join(Path(f).name for f in drawn.fonts))


def _with_note(png: bytes, key: str, value: str) -> bytes:
    """The PNG with a tEXt entry behind its header (PNG specification, 11.3.4.3)."""
    entry = b"tEXt" + f"{key}\0{value}".encode("latin-1", "replace")
    chunk = struct.pack(">I", len(entry) - 4) + entry + struct.pack(">I", zlib.crc32(entry))
    end = 8 + 25  # the signature and the header, which comes first
    return png[:end] + chunk + png[end:]
