"""Fonts for text pictures: bundled, given by name or file, or installed on this machine."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import unicodedata
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from knotfab.base.disk import at_home, read_file
from knotfab_formats.errors import InputError

if TYPE_CHECKING:
    from matplotlib.ft2font import FT2Font

# All of them come with matplotlib.
_SUPPLIED = (
    "DejaVuSans", "DejaVuSansMono", "DejaVuSerif", "DejaVuSansDisplay", "STIXGeneral",
    "STIXNonUni", "STIXSizOneSymReg",
)  # fmt: skip
_SIZE = 1000  # points at 72 dpi, so outlines come in thousandths of an em
_SYMBOLS = 0xF000  # where fonts of symbols have the characters of a keyboard
_COLOURED = {"COLR", "CBDT", "sbix", "SVG "}  # tables of glyphs in colours
STYLES = "\ufe0e\ufe0f"  # signs that choose between styles of a glyph
# Scripts with joining letters: Brahmic, Thai to Tibetan, Korean, Khmer, Mongolian, further blocks.
_JOINED = re.compile(
    "[\u0900-\u11ff\u1780-\u1cff\ua800-\uabff\U00010a00-\U00011fff\U0001e900-\U0001e95f]"
)
_PLAIN = ("regular", "book", "roman", "normal")


@cache
def load_font(path: str) -> FT2Font:
    """Open a font file at 1000 points and 72 dpi: an em is 1000 units.

    Raises:
        RuntimeError, OSError: it cannot be read, or has no outlines but only bitmaps.
    """
    from matplotlib.ft2font import FT2Font

    font = FT2Font(path)
    font.set_size(_SIZE, 72)
    if font.num_charmaps and not font.get_charmap():  # symbols have no map of Unicode
        font.set_charmap(0)
    return font


@cache
def load_shaper(path: str) -> Any:
    """Open a font for HarfBuzz; None if it does not read the file, as PostScript's or packed ones."""
    import uharfbuzz

    face = uharfbuzz.Face(uharfbuzz.Blob.from_file_path(path))
    return uharfbuzz.Font(face) if face.glyph_count else None


def glyph_code(path: str, character: str) -> int:
    """Return the code under which a font has a character, in a font of symbols from U+F000 on; 0: none."""
    codes = ord(character), _SYMBOLS + ord(character)
    return next((c for c in codes if load_font(path).get_char_index(c)), 0)


def is_coloured(path: str) -> bool:
    """Return whether a font may draw its glyphs in colours instead of outlines."""
    from fontTools.ttLib import TTFont, TTLibError

    try:
        with TTFont(path, fontNumber=0, lazy=True) as font:
            return not _COLOURED.isdisjoint(font.keys())
    except (TTLibError, OSError):
        return False


def supplied_folder() -> str:
    """Return the folder of the bundled fonts."""
    import matplotlib

    return f"{matplotlib.get_data_path()}/fonts/ttf"


def supply_fonts(asked: str | None) -> tuple[str, ...]:
    """Return the font files to draw with: the one asked for, then the bundled ones.

    Args:
        asked: a family's name, such as "DejaVu Serif", or a font file; None for any.

    Raises:
        InputError: there is no such font, or the file is not a font.
    """
    supplied = tuple(f"{supplied_folder()}/{name}.ttf" for name in _SUPPLIED)
    return supplied if asked is None else (_named_font(asked), *supplied)


def find_font(character: str, fonts: tuple[str, ...], what: str) -> str:
    """Return the first font file that has a character, from `fonts` or else this machine's.

    Raises:
        InputError: no font has it; `what` is how the message names the picture.
    """
    for path in fonts:
        if glyph_code(path, character):
            return path
    for path in _system_fonts(f":charset={ord(character):x}"):
        if _has_outline(path, character):
            return path
    known = unicodedata.name(character, "a control or unassigned character").lower()
    raise InputError(
        what,
        f"no font of this program or of this machine has the character {character!r} "
        f"(U+{ord(character):04X}, {known})",
        "Use another character, install a font that has it, or draw it as a PNG or SVG.",
    )


def _has_outline(path: str, character: str) -> bool:
    """Return whether a font is readable and has an outline for a character, not only a bitmap."""
    try:
        font, code = load_font(path), glyph_code(path, character)
        if not code:
            return False
        font.load_char(code)
        return len(font.get_path()[0]) > 0
    except (RuntimeError, OSError):
        return False


def _named_font(asked: str) -> str:
    """Return the file of a font given by name or file; raises InputError if it is missing."""
    what = f"--font {asked}"
    path = at_home(asked)
    if path.suffix.lower() in (".ttf", ".otf", ".ttc", ".otc", ".pfb", ".woff") or os.path.isfile(
        path
    ):
        read_file(path, what, "font file")
        try:
            load_font(str(path))
        except (RuntimeError, OSError) as error:
            raise InputError(
                what, "it is no font file with outlines", "Name a TrueType or OpenType file."
            ) from error
        return str(path)
    found = find_family(asked)
    if found is None:
        raise InputError(
            what,
            "this machine has no font of that name",
            'Name a family, such as --font "DejaVu Serif" (fc-list : family lists them), one of its '
            'styles, such as "DejaVu Serif:style=Bold", or a file.',
        )
    return found[0]


@cache
def find_family(asked: str) -> tuple[str, ...] | None:
    """Return the files of a family, upright and regular first, or of one style; None if it is not installed.

    A style is named as "DejaVu Sans Bold", "DejaVuSans-Bold" or "DejaVu Sans:style=Bold".
    """
    family, _, style = (
        re.sub(r"([\\\\:,-])", r"\\\1", word) for word in asked.partition(":style=")
    )
    patterns = [f"{family}:style={style}"] if style else [family, f":fullname={family}"]
    patterns += [] if style else [f":postscriptname={family}"]
    for pattern in patterns if asked.strip() else ():
        files = []
        for found in _system_fonts(pattern):
            with contextlib.suppress(RuntimeError, OSError):
                load_font(found)
                files.append(found)
        if files:
            return tuple(files)
    # finds matplotlib's own fonts, which fontconfig does not
    from matplotlib.font_manager import findfont

    with contextlib.suppress(ValueError):
        return (str(findfont(asked, fallback_to_default=False)),)
    squeezed = re.sub(r":style=|\W", "", asked).casefold()
    for file in sorted(os.listdir(supplied_folder())):
        if squeezed == re.sub(r"\.ttf$|\W", "", file).casefold():
            return (f"{supplied_folder()}/{file}",)
    return None


def _system_fonts(pattern: str) -> Iterator[str]:
    """Yield installed font files that match a fontconfig pattern, upright and regular first.

    Without fontconfig: all fonts that matplotlib finds, if the pattern asks for a character.
    """
    if shutil.which("fc-list") is None:
        if pattern.startswith(":charset="):
            from matplotlib.font_manager import findSystemFonts

            yield from sorted(findSystemFonts())
        return
    lines = (line.partition("\t") for line in _ask_fontconfig("%{file}\t%{style}\n", pattern))
    plain = {path: style.lower().split(",")[0] not in _PLAIN for path, _, style in lines}
    yield from sorted(plain, key=lambda path: (plain[path], path))


def list_families() -> tuple[str, ...]:
    """Return the names of the families in which a text can be drawn."""
    found = _ask_fontconfig("%{family[0]}\n", ":outline=true")
    return tuple(sorted({*found, "DejaVu Sans", "DejaVu Sans Mono", "DejaVu Serif"}))


def _ask_fontconfig(form: str, pattern: str) -> list[str]:
    """Ask fontconfig for a line in this format about each match; none without it."""
    program = shutil.which("fc-list")
    if program is None:
        return []
    try:
        said = subprocess.run(
            [program, f"--format={form}", pattern],
            capture_output=True, text=True, errors="replace", timeout=20, check=False,
        ).stdout  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return []
    return [line for line in said.splitlines() if line]


def needs_shaping(text: str) -> bool:
    """Return whether glyphs depend on their neighbours, run from right to left, or carry marks."""
    return any(
        _JOINED.match(c)
        or unicodedata.bidirectional(c) in ("R", "AL", "AN")
        or (unicodedata.category(c) in ("Mn", "Mc") and c not in STYLES)
        for c in text
    )
