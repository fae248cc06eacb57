"""SVG pictures: made safe, drawn by resvg to a canonical PNG; what it cannot draw is noted.

resvg runs in a child process with limits, so that no picture hangs or kills its reader.
"""

from __future__ import annotations

import importlib.util
import json
import signal
import struct
import subprocess
import sys
import unicodedata
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

from knotfab.base.pool import tie
from knotfab.picture.fonts import find_family, find_font, supplied_folder, supply_fonts
from knotfab.picture.raster import LARGEST_SIDE, SMALLEST_SIDE
from knotfab.picture.svg.clean import clean, refuse_symbols
from knotfab.picture.svg.css import CSS_DPI, set_pixel_size
from knotfab.picture.svg.letters import UNDRAWN, Letter, colour_letters, find_boxes
from knotfab.picture.svg.xml import SVG, parse_svg
from knotfab_formats.errors import InputError, shown
from knotfab_formats.libraries import took_part

LONGER_SIDE = 2048  # px of the drawn picture
_LETTERS_SIDE = 1024  # px of the drawing in which letters are looked for

Notes = dict[str, None]  # sentences, in their order

_MOST_NOTES = 8  # notes of the renderer that are passed on
_NESTED = 3  # depth of drawings embedded in each other
_FONTS = {
    "font_family": "DejaVu Sans",
    "sans_serif_family": "DejaVu Sans",
    "serif_family": "DejaVu Serif",
    "monospace_family": "DejaVu Sans Mono",
}


def render_svg(data: bytes, what: str) -> tuple[bytes, tuple[str, ...], tuple[Letter, ...]]:
    """Draw an SVG file as a canonical PNG.

    Args:
        data: the file's bytes, in any XML encoding, compressed (.svgz) or not.
        what: how an error names the picture.

    Returns:
        An RGBA PNG, the longer side 2048 px (more only where the shorter would fall below 16 px),
        the aspect ratio kept, transparent where nothing is drawn; a sentence for each thing left out or
        guessed; and the letters of its text, with their boxes in px.

    Raises:
        InputError: anything but a harmless SVG that can be rendered; it names the element.
    """
    notes: Notes = {}
    letters: list[Letter] = []
    try:
        png = _render(data, what, notes, _NESTED, letters)
    except RecursionError as error:
        raise InputError(
            what, "its style sheet is nested too deep", "Save it as a plain SVG, or as a PNG."
        ) from error
    told = [" ".join(shown(note).split()) for note in notes]
    more = len(told) - _MOST_NOTES
    notes_told = (*told[:_MOST_NOTES], *([f"and {more} more of these"] if more > 0 else []))
    return png, notes_told, tuple(letters)


def _render(
    data: bytes, what: str, notes: Notes, nested: int, letters: list[Letter] | None = None
) -> bytes:
    """Draw an SVG file; `notes` and, unless they are None, `letters` are added to."""

    def draw(inner: bytes, name: str) -> bytes:
        if nested == 0:
            raise InputError(
                name,
                f"pictures in pictures are read {_NESTED} deep",
                "Ungroup it in an SVG editor.",
            )
        return _render(inner, name, notes, nested - 1)

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
    png = render(tostring(root, encoding="unicode"), what, files=files, background=styles.page)
    if files is not None and letters is not None:
        letters += _find_letters(root, png, what, files)
    return png


def _find_letters(
    root: Element, png: bytes, what: str, files: tuple[str, ...]
) -> tuple[Letter, ...]:
    """Find the letters of a drawing's text, in px of its picture."""
    coloured, names = colour_letters(root)
    drawn = draw_svg(
        tostring(coloured, encoding="unicode"),
        what,
        width=_LETTERS_SIDE,
        height=_LETTERS_SIDE,
        dpi=CSS_DPI,
        text_rendering="optimize_speed",  # no mixed colours
        **_fonts_of(files),
    )
    return find_boxes(drawn, names, max(_sides_px(png)) / max(_sides_px(drawn)))


def _sides_px(png: bytes) -> tuple[int, int]:
    """Read the width and height from a PNG's header."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def _fonts_of(files: tuple[str, ...]) -> dict[str, Any]:
    """Return the renderer's options for text in these fonts and the bundled ones."""
    fonts = {"font_dirs": [supplied_folder()], "font_files": list(files)}
    return {"skip_system_fonts": True} | _FONTS | fonts


def render(
    svg: str, what: str, *, files: tuple[str, ...] | None = None, background: str | None = None
) -> bytes:
    """Draw trusted SVG text as an RGBA PNG, as `render_svg` describes.

    Args:
        files: fonts for its <text>, beside the bundled ones; None: it has no text.
        background: a hexadecimal colour to draw on.
    """
    options: dict[str, Any] = {"skip_system_fonts": True, "background": background}
    if files is not None:
        options |= _fonts_of(files)
    for side in (LONGER_SIDE, LARGEST_SIDE):
        # without a resolution resvg takes every length in mm, pt, in, ... for nothing; given both sides, it
        # keeps the aspect ratio
        png = draw_svg(svg, what, width=side, height=side, dpi=CSS_DPI, **options)
        if min(_sides_px(png)) >= SMALLEST_SIDE:
            break
    return png


# The child process that draws.

_PYTHON = sys.executable
_SECONDS = 20  # of processor time
_BYTES = 2**30
# The process loads only the drawing library (20 ms).
_CHILD = f"""
import json, sys
try:
    import resource as r
    for what, most in ((r.RLIMIT_CPU, {_SECONDS}), (r.RLIMIT_AS, {_BYTES}), (r.RLIMIT_CORE, 0)):
        least, hard = r.getrlimit(what)
        r.setrlimit(what, (most if hard < 0 else min(most, hard), hard))
except (ImportError, OSError, ValueError):
    pass
asked = json.load(sys.stdin.buffer)
sys.path.append(asked.pop("folder"))
import resvg_py
try:
    png = resvg_py.svg_to_bytes(**asked)
except ValueError as error:
    sys.exit("refused: " + " ".join(str(error).split()))
sys.stdout.buffer.write(bytes(png))
"""
_SIMPLER = "Simplify it in an SVG editor (fewer points, no filters), or save it as a PNG."


def draw_svg(svg: str, what: str, **options: Any) -> bytes:
    """Draw SVG text to a PNG with resvg; `options` are those of `resvg_py.svg_to_bytes`.

    Raises:
        InputError: it cannot be drawn, or takes more than 20 s or 1 GB (`what` names the picture).
    """
    found = importlib.util.find_spec("resvg_py")
    took_part("resvg-py", "drew the SVG")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("resvg_py")
    folder = str(Path(found.origin).parent.parent)
    asked = json.dumps({"svg_string": svg, "folder": folder, **options}).encode()
    try:
        done = subprocess.run(
            tie([_PYTHON, "-I", "-S", "-c", _CHILD], signal.SIGKILL),
            input=asked,
            capture_output=True,
            timeout=240,  # wall-clock time, generous for a busy machine
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise _too_slow(what) from error
    if done.returncode == 0:
        return done.stdout
    said = done.stderr.decode("utf-8", "replace").strip()
    if done.returncode == -getattr(signal, "SIGXCPU", 0):
        raise _too_slow(what)
    if said.startswith("refused: "):
        raise InputError(
            what,
            f"it cannot be rendered ({said.removeprefix('refused: ')})",
            "Open it in an SVG editor, check its size, and save it as a plain SVG.",
        )
    if "memory" in said.lower():  # an allocation failed, or MemoryError
        raise InputError(what, f"drawing it takes more than {_BYTES // 2**30} GB", _SIMPLER)
    raise InputError(what, "the library that draws SVG files fails on it", _SIMPLER)


def _too_slow(what: str) -> InputError:
    return InputError(what, f"drawing it takes more than {_SECONDS} s", _SIMPLER)


# Fonts of a drawing's text: those that it names if installed, sans serif otherwise.

_SANS, _SERIF, _MONO = "DejaVu Sans", "DejaVu Serif", "DejaVu Sans Mono"
_GENERIC = {
    **dict.fromkeys(("serif", "ui-serif", "math"), _SERIF),
    **dict.fromkeys(("monospace", "ui-monospace"), _MONO),
    **dict.fromkeys(("sans-serif", "ui-sans-serif", "system-ui", "inherit", "initial"), _SANS),
}


class TextFonts:
    """The font families of a drawing's text; `notes` tell which replace missing ones."""

    def __init__(self, root: Element) -> None:
        self.notes: dict[str, None] = {}
        self._files: dict[str, None] = {}
        self._texts = list(root.iter(f"{{{SVG}}}text"))
        parents = {child: parent for parent in root.iter() for child in parent}
        self._asked: set[Element] = set()  # elements whose font family can reach text
        for text in self._texts:
            self._asked.update(text.iter())
            at = parents.get(text)
            while at is not None and at not in self._asked:
                self._asked.add(at)
                at = parents.get(at)
        self._said = "".join("".join(text.itertext()) for text in self._texts)

    @property
    def needed(self) -> bool:
        """Whether the drawing has text."""
        return bool(self._said.strip())

    def choose(self, named: str, element: Element | None) -> str:
        """Return the family drawn for a CSS font list of an element, or of a style sheet (None)."""
        family = _SANS
        if element is None or element in self._asked:
            family, found = _choose(named)
            self._files.update(dict.fromkeys(found))
            first = named.split(",")[0].strip(" \"'")
            if first and family.lower() != first.lower() and first.lower() not in _GENERIC:
                self.notes[
                    f"its text is drawn in {family} instead of {first}, which this machine lacks "
                    "(turn it to paths in the editor to keep its look)"
                ] = None
        return family

    def list_files(self, what: str) -> tuple[str, ...]:
        """Return the font files that the text needs, beside the bundled ones.

        Raises:
            InputError: no font of this machine has a character of the text; `what` names the picture.
        """
        for text in self._texts:
            for element in text.iter():
                style = element.get("style", "").replace(" ", "")
                rtl = element.get("direction") == "rtl" or "direction:rtl" in style
                if rtl and element.text and not len(element):
                    # resvg starts every line at the left
                    element.text = f"\u2067{element.text}\u2069"
        supplied = (*self._files, *supply_fonts(None))
        for character in dict.fromkeys(self._said):
            if unicodedata.category(character) not in UNDRAWN:
                path = find_font(character, supplied, what)
                if path not in supplied:
                    self._files[path] = None
        return tuple(self._files)


def _choose(named: str) -> tuple[str, tuple[str, ...]]:
    """Return the first installed family of a CSS font list, with its font files unless it is bundled."""
    for part in named.split(","):
        family = part.strip(" \"'")
        if family.lower() in _GENERIC:
            return _GENERIC[family.lower()], ()
        found = find_family(family)
        if found is not None:
            return family, found
    return _SANS, ()
