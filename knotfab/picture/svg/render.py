"""SVG pictures: made safe, drawn by resvg to a canonical PNG; what it cannot draw is noted.

resvg runs in a child process with limits, so that no picture hangs or kills its reader.
"""

from __future__ import annotations

import importlib.util
import io
import json
import re
import signal
import struct
import subprocess
import sys
import unicodedata
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
from PIL import Image

from knotfab.base.pool import tie
from knotfab.picture.fonts import find_family, find_font, supplied_folder, supply_fonts
from knotfab.picture.raster import LARGEST_SIDE, SMALLEST_SIDE
from knotfab.picture.svg.check import Notes, check_drawing, page_colour
from knotfab.picture.svg.size import CSS_DPI, set_pixel_size
from knotfab.picture.svg.xml import SVG, local_name, parse_svg
from knotfab_formats.errors import InputError, shown
from knotfab_formats.libraries import took_part

LONGER_SIDE = 2048  # px of the drawn picture
# Unicode categories without a glyph of their own: controls, separators, marks
UNDRAWN = ("Cc", "Cf", "Mn", "Zl", "Zp", "Zs")

_MOST_NOTES = 8  # notes of the renderer that are passed on
# px of a drawing with a page on each side of it; share of it beside its own page from which on that is told
_GLANCE_PX, _BESIDE = 384, 0.2
_NESTED = 3  # depth of drawings embedded in each other
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
        the aspect ratio kept, transparent where nothing is drawn; and a sentence for each thing left out or
        drawn otherwise than a browser draws it.

    Raises:
        InputError: anything but a harmless SVG that can be rendered; it names the element.
    """
    notes: Notes = {}
    png = _render(data, what, notes, _NESTED)
    told = [" ".join(shown(note).split()) for note in notes]
    more = len(told) - _MOST_NOTES
    notes_told = (*told[:_MOST_NOTES], *([f"and {more} more of these"] if more > 0 else []))
    return png, notes_told


def _render(data: bytes, what: str, notes: Notes, nested: int) -> bytes:
    """Draw an SVG file, and add to `notes`."""

    def draw(inner: bytes, name: str) -> bytes:
        if nested == 0:
            raise InputError(
                name,
                f"pictures in pictures are read {_NESTED} deep",
                "Ungroup it in an SVG editor.",
            )
        return _render(inner, name, notes, nested - 1)

    root = parse_svg(data, what)
    check_drawing(root, what, notes, draw)
    set_pixel_size(root, LARGEST_SIDE, what)
    files = _fonts_of_text(root, what, notes)
    if nested == _NESTED:
        _tell_beside(root, what, notes, files)
    # Rendered from the tree that was checked: no second parser sees the original bytes.
    return render(
        tostring(root, encoding="unicode"), what, files=files, background=page_colour(root)
    )


def _tell_beside(root: Element, what: str, notes: Notes, files: tuple[str, ...] | None) -> None:
    """Note how much of a drawing lies beside its page, up to a page away; refuse it if all of it does."""
    width, height = (int(root.get(side, "0")) for side in ("width", "height"))
    if not (root.get("viewBox") and width and height):
        return
    whole = Element(root.tag, {"viewBox": f"{-width} {-height} {3 * width} {3 * height}"})
    page = Element(root.tag, {**root.attrib, "x": "0", "y": "0", "overflow": "visible"})
    page.extend(list(root))
    whole.append(page)
    options = {"width": _GLANCE_PX, "height": _GLANCE_PX, "dpi": CSS_DPI, **_fonts_of(files or ())}
    png = draw_svg(tostring(whole, encoding="unicode"), what, **options)
    with Image.open(io.BytesIO(png)) as image:
        drawn = np.asarray(image.getchannel("A")) > 0
    rows, columns = (slice(side // 3, side - side // 3) for side in drawn.shape)
    inside, every = int(drawn[rows, columns].sum()), int(drawn.sum())
    where = f"outside its page (viewBox {root.get('viewBox')})"
    if every and not inside:
        raise InputError(
            what, f"everything that it draws lies {where}", "Resize the page to its content."
        )
    if inside < (1 - _BESIDE) * every:
        notes.setdefault(f"{1 - inside / every:.0%} of what it draws lies {where}", None)


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
    options: dict[str, Any] = {
        "skip_system_fonts": True,
        "background": background,
        "languages": ["en"],
    }
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


_FAMILY = re.compile(r"font-family\s{0,9}:\s{0,9}([^;}]+)")
# words, size, line height and families of the shorthand
_FONT = re.compile(
    r"(?<![\w-])font\s{0,9}:([^;}]{0,60}?)(\d[\w.%]{0,9})(?:/[\w.%]{1,9})?\s{1,9}([^;}]+)"
)


def _expand_font(found: re.Match[str]) -> str:
    """Write the shorthand `font` out, so that its families are chosen as well."""
    words = found[1].split()
    bold = next((w for w in words if w in ("bold", "bolder", "lighter")), "normal")
    slant = next((w for w in words if w in ("italic", "oblique")), "normal")
    weight = next((w for w in words if w.isdigit()), bold)
    return f"font-style:{slant};font-weight:{weight};font-size:{found[2]};font-family:{found[3]}"


def _fonts_of_text(root: Element, what: str, notes: Notes) -> tuple[str, ...] | None:
    """Name the families that are drawn, and return their files; None where there is no text.

    Raises:
        InputError: no font of this machine has a character of the text; `what` names the picture.
    """
    texts = list(root.iter(f"{{{SVG}}}text"))
    said = "".join("".join(text.itertext()) for text in texts)
    if not said.strip():
        return None
    files: dict[str, None] = {}

    def choose(named: str) -> str:
        family, found = _choose(named)
        files.update(dict.fromkeys(found))
        first = named.split(",")[0].strip(" \"'")
        if first and family.lower() != first.lower() and first.lower() not in _GENERIC:
            notes[
                f"its text is drawn in {family} instead of {first}, which this machine lacks "
                "(turn it to paths in the editor to keep its look)"
            ] = None
        return family

    for element in root.iter():
        if "font-family" in element.attrib:
            element.set("font-family", choose(element.attrib["font-family"]))
        for place in ("style", "text"):
            css = element.get("style", "") if place == "style" else element.text or ""
            if "font" in css and (place == "style" or local_name(element) == "style"):
                css = _FONT.sub(_expand_font, css)
                css = _FAMILY.sub(lambda found: f"font-family:'{choose(found[1])}'", css)
                element.set("style", css) if place == "style" else setattr(element, "text", css)
    for text in texts:
        for element in text.iter():
            rtl = "rtl" in element.get("direction", "") + element.get("style", "")
            if rtl and element.text and not len(element):  # resvg starts every line at the left
                element.text = f"\u2067{element.text}\u2069"
    supplied = (*files, *supply_fonts(None))
    for character in dict.fromkeys(said):
        if unicodedata.category(character) not in UNDRAWN:
            path = find_font(character, supplied, what)
            if path not in supplied:
                files[path] = None
    return tuple(files)


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
