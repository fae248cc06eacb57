"""Fonts of symbols and of colours, and styles by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen

from knotfab.picture.fonts import find_family, load_font
from knotfab.picture.text import outline_text
from knotfab_formats.errors import InputError


def write_font(folder: Path, *, symbols: bool = False, coloured: bool = False) -> str:
    """A font whose A is a square of a thousand units, under U+F041 or in a layer of its own."""
    pen = TTGlyphPen(None)
    for k, place in enumerate([(0, 0), (0, 1000), (1000, 1000), (1000, 0)]):
        (pen.lineTo if k else pen.moveTo)(place)
    pen.closePath()
    square, empty = pen.glyph(), TTGlyphPen(None).glyph()
    build = FontBuilder(1000)
    build.setupGlyphOrder([".notdef", "A", "layer"])
    build.setupCharacterMap({0xF041 if symbols else 0x41: "A"})
    build.setupGlyf({".notdef": empty, "A": empty if coloured else square, "layer": square})
    build.setupHorizontalMetrics(dict.fromkeys((".notdef", "A", "layer"), (1100, 0)))
    build.setupHorizontalHeader(ascent=1000, descent=0)
    build.setupNameTable({"familyName": "Bells", "styleName": "Regular"})
    build.setupPost()
    if symbols:
        (*_, table) = build.font["cmap"].tables
        table.platformID, table.platEncID = 3, 0
        build.font["cmap"].tables = [table]
    if coloured:
        build.setupCOLR({"A": [("layer", 0)]})
        build.setupCPAL([[(1.0, 0.0, 0.0, 1.0)]])
    path = folder / "bells.ttf"
    build.save(path)
    return str(path)


def test_a_font_of_symbols_draws_its_own(tmp_path: Path) -> None:
    font = write_font(tmp_path, symbols=True)
    drawn = outline_text("A", font)
    left, top, right, bottom = drawn.bounds
    assert drawn.fonts == (font,) and (right - left, bottom - top) == pytest.approx(
        (1000, 1000), rel=0.02
    )


def test_letters_in_colours_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its A is drawn in colours, which are not read"):
        outline_text("A", write_font(tmp_path, coloured=True))


@pytest.mark.parametrize(
    ("asked", "style"),
    [
        ("DejaVu Sans Bold", "Bold"),
        ("DejaVu Sans:style=Bold", "Bold"),
        ("DejaVuSans-Bold", "Bold"),
        ("DejaVu Sans:style=Bold Oblique", "Bold Oblique"),
        ("DejaVu Serif:style=Italic", "Italic"),
        ("DejaVu Sans:style=Nothing", None),
        ("Nonsense Sans Bold", None),
    ],
)
def test_a_style_is_found_by_its_name(asked: str, style: str | None) -> None:
    found = find_family(asked)
    assert (found is None) == (style is None)
    if found is not None:
        assert load_font(found[0]).style_name == style
