"""Fonts of symbols and of colours, and styles by name."""

from pathlib import Path

import numpy as np
import pytest
from fontTools.feaLib.builder import addOpenTypeFeaturesFromString
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTFont

from knotfab.picture.fonts import find_family, load_font
from knotfab.picture.read import read_target
from knotfab.picture.text import outline_text, tell_other_fonts
from knotfab_formats.errors import InputError


def write_font(
    folder: Path, *, symbols: bool = False, coloured: bool = False, letters: str = "A"
) -> str:
    """A font whose letters are squares of a thousand units, its A at U+F041 or in a layer of its own."""
    pen = TTGlyphPen(None)
    for k, place in enumerate([(0, 0), (0, 1000), (1000, 1000), (1000, 0)]):
        (pen.lineTo if k else pen.moveTo)(place)
    pen.closePath()
    square, empty = pen.glyph(), TTGlyphPen(None).glyph()
    build = FontBuilder(1000)
    names = [".notdef", *letters, "layer"]
    build.setupGlyphOrder(names)
    build.setupCharacterMap({0xF041: "A"} if symbols else {ord(c): c for c in letters})
    build.setupGlyf(
        {".notdef": empty, **dict.fromkeys(letters, empty if coloured else square), "layer": square}
    )
    build.setupHorizontalMetrics(dict.fromkeys(names, (1100, 0)))
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


# words in a font of square letters 1000 wide, whose A and B overlap and whose f join: left and right of each
KERNED = {
    "AB": [(0, 1000), (500, 1500)],
    "BA": [(0, 1000), (1100, 2100)],
    "ff": [(0, 500), (500, 1000)],  # one glyph
    "ABA": [(0, 1000), (500, 1500), (1600, 2600)],
}


@pytest.mark.parametrize("word", KERNED)
def test_letters_are_kerned_and_joined_as_the_font_says(tmp_path: Path, word: str) -> None:
    path = write_font(tmp_path, letters="ABf")
    with TTFont(path) as font:
        rules = "feature kern {pos A B -600;} kern; feature liga {sub f f by layer;} liga;"
        addOpenTypeFeaturesFromString(font, rules)
        font.save(path)
    found = [(left, right) for _, left, right in outline_text(word, path).letters]
    np.testing.assert_allclose(found, KERNED[word], atol=2.0)


def test_letters_of_another_font_are_told(tmp_path: Path) -> None:
    font = write_font(tmp_path)
    assert tell_other_fonts("A é\u200dé", font) == ("Bells has no é: drawn in DejaVu Sans",)
    assert tell_other_fonts("A", font) == tell_other_fonts("é", None) == ()
    assert read_target("text:Aé", font=font).notes == ("Bells has no é: drawn in DejaVu Sans",)


def test_letters_in_colours_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its A is drawn in colours, which are not read"):
        outline_text("A", write_font(tmp_path, coloured=True))


@pytest.mark.parametrize(
    ("asked", "style"),
    [
        ("DejaVu Sans Bold", "Bold"), ("DejaVu Sans:style=Bold", "Bold"), ("DejaVuSans-Bold", "Bold"),
        ("DejaVu Sans:style=Bold Oblique", "Bold Oblique"), ("DejaVu Serif:style=Italic", "Italic"),
        ("DejaVu Sans:style=Nothing", None), ("Nonsense Sans Bold", None),
    ],
)  # fmt: skip
def test_a_style_is_found_by_its_name(asked: str, style: str | None) -> None:
    found = find_family(asked)
    assert (found is None) == (style is None)
    if found is not None:
        assert load_font(found[0]).style_name == style
