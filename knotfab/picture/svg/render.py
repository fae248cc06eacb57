"""SVG pictures: made safe, and drawn by resvg to a canonical PNG; what it cannot draw is told."""

from __future__ import annotations

import struct
from typing import Any
from xml.etree.ElementTree import tostring

from knotfab.picture.fonts import supplied_folder
from knotfab.picture.raster import LARGEST_SIDE, SMALLEST_SIDE
from knotfab.picture.svg.clean import clean, refuse_symbols
from knotfab.picture.svg.draw import draw_svg
from knotfab.picture.svg.size import CSS_DPI, set_pixel_size
from knotfab.picture.svg.xml import parse_svg
from knotfab_formats.errors import InputError, shown

LONGER_SIDE = 2048  # px of what is drawn

Notes = dict[str, None]  # sentences, in their order

_MOST_NOTES = 8  # notes of the renderer that are passed on
_NESTED = 3  # drawings in each other, as pictures
_FONTS = {
    "font_family": "DejaVu Sans",
    "sans_serif_family": "DejaVu Sans",
    "serif_family": "DejaVu Serif",
    "monospace_family": "DejaVu Sans Mono",
}


def render_svg(data: bytes, what: str) -> tuple[bytes, tuple[str, ...]]:
    """Draw an SVG file as a canonical PNG.

    Args:
        data: the file's bytes, in any XML encoding, compressed (.svgz) or not.
        what: how an error names the picture.

    Returns:
        An RGBA PNG, the longer side 2048 px (more only where the shorter would fall below 16 px),
        the aspect ratio kept, transparent where nothing is drawn; and, a sentence each, what was left out
        or guessed.

    Raises:
        InputError: anything but a harmless SVG that can be rendered; it names the element.
    """
    notes: Notes = {}
    try:
        png = _render(data, what, notes, _NESTED)
    except RecursionError as error:
        raise InputError(
            what, "its style sheet is nested too deep", "Save it as a plain SVG, or as a PNG."
        ) from error
    told = [" ".join(shown(note).split()) for note in notes]
    more = len(told) - _MOST_NOTES
    return png, (*told[:_MOST_NOTES], *([f"and {more} more of these"] if more > 0 else []))


def _render(data: bytes, what: str, notes: Notes, nested: int) -> bytes:
    def draw(inner: bytes, name: str) -> bytes:
        if nested == 0:
            raise InputError(
                name,
                f"pictures in pictures are read {_NESTED} deep",
                "Ungroup it in an SVG editor.",
            )
        return _render(inner, name, notes, nested - 1)

    from knotfab.picture.svg.fonts import TextFonts
    from knotfab.picture.svg.style import Styles

    root = parse_svg(data, what)
    clean(root, what, notes, draw)
    fonts = TextFonts(root)
    styles = Styles(root, what, fonts.choose if fonts.needed else None)
    refuse_symbols(root, what)
    set_pixel_size(root, LARGEST_SIDE, what)
    files = fonts.list_files(what) if fonts.needed else None
    notes.update(fonts.notes | styles.notes)
    # Rendered from the tree that was checked: no second parser sees the original bytes.
    return render(tostring(root, encoding="unicode"), what, files=files, background=styles.page)


def render(
    svg: str, what: str, *, files: tuple[str, ...] | None = None, background: str | None = None
) -> bytes:
    """Draw trusted SVG text as an RGBA PNG as `render_svg` says.

    Args:
        files: fonts of its <text>, beside those that come along; None: it has none.
        background: a colour in hexadecimal digits, beneath all.
    """
    options: dict[str, Any] = {"skip_system_fonts": True, "background": background}
    if files is not None:
        options |= _FONTS | {"font_dirs": [supplied_folder()], "font_files": list(files)}
    for side in (LONGER_SIDE, LARGEST_SIDE):
        # without a resolution resvg takes every length in mm, pt, in, ... for nothing; given both sides, it
        # keeps the aspect ratio
        png = draw_svg(svg, what, width=side, height=side, dpi=CSS_DPI, **options)
        if min(struct.unpack(">II", png[16:24])) >= SMALLEST_SIDE:  # width and height in the header
            break
    return png
