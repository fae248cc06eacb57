"""Text as a picture: `text:♞` becomes glyph outlines, then a PNG whose frame hugs them."""

from __future__ import annotations

import io
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab.picture.fonts import (
    STYLES,
    find_font,
    glyph_code,
    is_coloured,
    load_font,
    load_shaper,
    needs_shaping,
    supply_fonts,
)
from knotfab.picture.raster import MARGIN
from knotfab.picture.svg.render import LONGER_SIDE, render
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part

_Box = tuple[float, float, float, float]  # left, top, width, height

_EM = 1000  # units to a letter's height
_LONGEST = 200  # most characters


_RIGHT_TO_LEFT, _END = "\u2067", "\u2069"  # an isolate of that direction (Unicode Annex 9)
_UNDRAWN = ("Cc", "Cf", "Zs")


@dataclass(frozen=True)
class Outline:
    """Glyphs of one line of text as SVG path data (thousandths of an em, y down, nonzero winding).

    `bounds` holds the ink's control points: (left, top, right, bottom). `fonts` are the files
    that were drawn from, in the order of their first characters. `letters` says where each character
    with ink begins and ends.
    """

    path: str
    bounds: tuple[float, float, float, float]
    fonts: tuple[str, ...]
    letters: tuple[tuple[str, float, float], ...]


def outline_text(text: str, font: str | None = None) -> Outline:
    """Trace the glyph outlines of one line of text.

    Args:
        text: characters in the order they are drawn, left to right (not `needs_shaping`).
        font: a family's name or a font file; characters that it lacks come from other fonts.

    Raises:
        InputError: no ink, too long, no such font, or a character that no font has.
    """
    what = _name(text)
    # Variation selectors and joiners choose between styles of a glyph; these fonts have one.
    drawn = [c for c in text if c not in f"{STYLES}\u200d"]
    from matplotlib.ft2font import LoadFlags

    flags = LoadFlags.NO_HINTING | LoadFlags.NO_BITMAP
    fonts = supply_fonts(font)
    files = [find_font(character, fonts, what) for character in drawn]
    parts: list[str] = []
    corners: list[NDArray[np.float64]] = []
    letters: list[tuple[str, float, float]] = []
    for name, glyph, place, own in _lay_out(drawn, files):
        face: Any = load_font(name)
        face.load_glyph(glyph, flags=flags)
        vertices, codes = face.get_path()
        if not len(vertices) and not own.isspace() and is_coloured(name):
            raise InputError(
                what,
                f"its {own} is drawn in colours, which are not read",
                "Name a font of plain outlines.",
            )
        if len(vertices):
            placed = np.asarray(vertices) * (1.0, -1.0) + place
            corners.append(placed[np.asarray(codes) != 79])
            low, high = np.quantile(corners[-1][:, 0], (0.0, 1.0)).tolist()
            edges = np.linspace(low, high, len(own) + 1).tolist()  # of a ligature's letters
            letters += zip(own, edges[:-1], edges[1:], strict=True)
            parts.append(_path_data(placed, codes))
    if not corners:
        raise _no_ink()
    ink = np.concatenate(corners)
    (left, top), (right, bottom) = ink.min(axis=0), ink.max(axis=0)
    bounds = (float(left), float(top), float(right), float(bottom))
    return Outline(" ".join(parts), bounds, tuple(dict.fromkeys(files)), tuple(letters))


def _lay_out(
    drawn: Sequence[str], files: Sequence[str]
) -> Iterator[tuple[str, int, tuple[float, float], str]]:
    """Yield the font file, number, place and characters of each glyph, as HarfBuzz kerns and joins them."""
    import uharfbuzz

    took_part("uharfbuzz", "placed the letters")
    pen, at = 0.0, 0
    for name, run in groupby(files):
        own = drawn[at : (at := at + len(list(run)))]
        codes = [glyph_code(name, character) for character in own]
        shaper = load_shaper(name)
        if shaper is None:
            for code, character in zip(codes, own, strict=True):
                glyph = load_font(name).get_char_index(code)
                yield name, glyph, (pen, 0.0), character
                pen += load_font(name).load_glyph(glyph).linearHoriAdvance / 65536.0
            continue
        buffer = uharfbuzz.Buffer()
        buffer.add_codepoints(codes)
        buffer.guess_segment_properties()
        uharfbuzz.shape(shaper, buffer)
        step = _EM / shaper.face.upem
        begins = [info.cluster for info in buffer.glyph_infos] + [len(own)]
        for info, place, end in zip(
            buffer.glyph_infos, buffer.glyph_positions, begins[1:], strict=True
        ):
            offset = (pen + step * place.x_offset, -step * place.y_offset)
            yield name, info.codepoint, offset, "".join(own[info.cluster : end])
            pen += step * place.x_advance


def tell_other_fonts(text: str, font: str | None) -> tuple[str, ...]:
    """Say which characters of a text the font asked for lacks, and in which they are drawn instead."""
    if font is None:
        return ()
    asked, *_ = fonts = supply_fonts(font)
    lacking: dict[str, str] = {}
    for character in dict.fromkeys(text):
        if unicodedata.category(character) not in (*_UNDRAWN, "Zl") and character not in STYLES:
            own = find_font(character, fonts, _name(text))
            if own != asked:
                lacking[own] = lacking.get(own, "") + character
    return tuple(
        f"{load_font(asked).family_name} has no {' '.join(some)}: drawn in {load_font(own).family_name}"
        for own, some in lacking.items()
    )


def find_letters(text: str, font: str | None = None) -> tuple[tuple[str, float, float], ...]:
    """Find where each character of a picture of text begins and ends, as shares of the ink's width.

    None are found where glyphs depend on their neighbours (`needs_shaping`).
    """
    if needs_shaping(text):
        return ()
    drawn = outline_text(text, font)
    left, _, right, _ = drawn.bounds
    return tuple(
        (character, (begin - left) / (right - left), (end - left) / (right - left))
        for character, begin, end in drawn.letters
    )


_PEN = {1: ("M", 1), 2: ("L", 1), 3: ("Q", 2), 4: ("C", 3), 79: ("Z", 0)}  # and points of a step


def _path_data(vertices: NDArray[np.float64], codes: Any) -> str:
    """Convert vertices and codes (1 move, 2 line, 3 and 4 curves, 79 end) to SVG path data."""
    data: list[str] = []
    i = 0
    while i < len(codes):
        letter, points = _PEN[int(codes[i])]
        data.append(letter + " ".join(f"{x:.6f},{y:.6f}" for x, y in vertices[i : i + points]))
        i += points or 1
    return " ".join(data)


def _name(text: str) -> str:
    return "text:" + "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _shape_text(text: str, font: str | None) -> tuple[str, tuple[str, ...], _Box]:
    """Build an SVG <text> that resvg shapes as HarfBuzz does; return it with fonts and ink box.

    Raises:
        InputError: no ink, no such font, or a character that no font has.
    """
    drawn = "".join(c for c in text if c not in STYLES)
    fonts = supply_fonts(font)
    files = [
        find_font(c, fonts, _name(text)) for c in drawn if unicodedata.category(c) not in _UNDRAWN
    ]
    # a joined word is of one font: the font that has most of its characters, the first of equals
    order = sorted(dict.fromkeys(files), key=lambda f: -sum(glyph_code(f, c) > 0 for c in drawn))
    families = ", ".join(f"'{load_font(f).family_name}'" for f in order)
    first = next((d for c in drawn if (d := unicodedata.bidirectional(c)) in ("L", "R", "AL")), "L")
    said = drawn if first == "L" else f"{_RIGHT_TO_LEFT}{drawn}{_END}"
    weight = "bold" if order and "bold" in load_font(order[0]).style_name.lower() else "normal"
    element = (
        f'<text text-anchor="middle" font-size="{_EM}" font-weight="{weight}" '
        f'font-family="{escape(families)}" xml:space="preserve">{escape(said)}</text>'
    )
    half = 2.0 * _EM * (len(drawn) + 2)
    box = (-half, -2.0 * _EM, 2 * half, 4.0 * _EM)
    for _ in range(2):  # the whole line, then its ink alone, ever finer
        png = render(_frame(element, box, 2 * LONGER_SIDE), _name(text), files=tuple(order))
        with Image.open(io.BytesIO(png)) as image:
            ink, step = image.getchannel("A").getbbox(), box[2] / image.width
        if ink is None:
            raise _no_ink()
        left, top = box[0] + (ink[0] - 1) * step, box[1] + (ink[1] - 1) * step
        box = (left, top, (ink[2] - ink[0] + 2) * step, (ink[3] - ink[1] + 2) * step)
    return (
        element,
        tuple(order),
        (box[0] + step, box[1] + step, box[2] - 2 * step, box[3] - 2 * step),
    )


def _frame(body: str, box: _Box, longer: int) -> str:
    """Build an SVG that shows a box of the plane, in whole pixels."""
    step = max(box[2:]) / longer
    columns, rows = (max(1, round(side / step)) for side in box[2:])
    x, y, w, h = (f"{v:.9f}" for v in box)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{columns}" height="{rows}" '
        f'viewBox="{x} {y} {w} {h}" preserveAspectRatio="none">{body}</svg>'
    )


def _no_ink() -> InputError:
    return InputError(
        "text:", "there is no visible character after it", "Write, for example, text:R."
    )


def render_text(text: str, font: str | None = None) -> tuple[bytes, tuple[str, ...]]:
    """Draw text, black on white, as a canonical PNG.

    Args:
        text: what stands after `text:`.
        font: a family's name or a font file; by default the first bundled one that has the
            characters.

    Returns:
        A PNG, 2048 px on the longer side, whose frame hugs the ink with a margin of 6 % of that; and the
        names of the font files that were used.

    Raises:
        InputError: no ink, no such font, or a character that no font has.
    """
    if len(text) > _LONGEST:
        raise InputError(
            f"{_name(text)[:20]}...", f"it has {len(text)} characters", f"Use at most {_LONGEST}."
        )
    text = text.strip("\r\n").replace("\u00ad", "").replace("\t", " ")  # a soft hyphen is not drawn
    if len(text.splitlines()) > 1:
        raise InputError(
            _name(text)[:60], "it has several lines", "Write one line, or draw an SVG."
        )
    if needs_shaping(text):
        body, fonts, (left, top, width, height) = _shape_text(text, font)
        files: tuple[str, ...] | None = fonts
    else:
        drawn = outline_text(text, font)
        body, fonts, files = f'<path d="{drawn.path}"/>', drawn.fonts, None
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
    paper = f'<rect x="{x}" y="{y}" width="{w}" height="{h}" fill="white"/>'
    png = render(_frame(paper + body, view, LONGER_SIDE), "text:", files=files)
    return png, tuple(Path(f).name for f in fonts)
