"""The file that a picture is read from: its name, its bytes, and the picture without its ground."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Collection
from itertools import chain
from pathlib import Path
from urllib.parse import unquote

from PIL import Image

from knotfab.base.disk import at_home, read_file
from knotfab.picture import raster
from knotfab.picture.ground import plain_ground
from knotfab.picture.paper import is_photograph, read_paper
from knotfab_formats.errors import InputError, shown
from knotfab_formats.views import Reading

TEXT_PREFIX = "text:"
DRAWN_SUFFIXES = (".svg", ".svgz")
PICTURE_SUFFIXES = frozenset(chain(*raster.SUFFIXES.values(), DRAWN_SUFFIXES))
_MOST_SIGNS, _MOST_BYTES = 60, 180  # longest name: files add prefixes and suffixes to it
SECONDS = 60  # processor time in which a picture is read
_MISSING = "Check the path, or write text:… for a word or a glyph."


def plain_name(raw: str, fallback: str) -> str:
    """Reduce `raw` to letters, digits, signs of any script, "_" and "-"; `fallback` if none is left.

    A longer one ends in a digest of the whole, so that two that begin alike stay different.
    """
    signs = unicodedata.normalize("NFC", raw)
    kept = (
        c if (c.isalnum() if c < "\x80" else c.isprintable()) or c in "_-" else " " for c in signs
    )
    plain = re.sub("-* [- ]*", "-", "".join(kept)).strip("-")
    if len(plain) > _MOST_SIGNS or len(plain.encode()) > _MOST_BYTES:
        which = hashlib.sha256(raw.encode("utf-8", "surrogatepass")).hexdigest()[:7]
        plain = plain[: _MOST_SIGNS - 8].encode()[: _MOST_BYTES - 8].decode("utf-8", "ignore")
        plain += f"-{which}"
    return plain or fallback


def name_picture(source: str) -> str:
    """Return the name that a picture's target will have (`plain_name`)."""
    if source.startswith(TEXT_PREFIX):
        content = source.removeprefix(TEXT_PREFIX)
        return plain_name(content, "-".join(["text", *(f"{ord(c):x}" for c in content[:4])]))
    return plain_name(Path(source).stem, "picture")


def is_picture(path: Path, suffixes: Collection[str] = PICTURE_SUFFIXES) -> bool:
    """Return whether a file is named like a picture; hidden files are not pictures."""
    return path.suffix.lower() in suffixes and not path.name.startswith(".")


def title_of(given: str) -> str:
    """Return a name as given if it is short and can be shown, else ""."""
    return given if given.isprintable() and len(given) <= _MOST_SIGNS else ""


def bare_picture(image: Image.Image, reading: Reading) -> tuple[Image.Image, tuple[str, ...], bool]:
    """Return a picture without its ground, notes on that, and whether it is a photograph on paper."""
    if reading.ink != "auto":
        return image, (), False
    photograph, boxed = is_photograph(image), isinstance(reading.crop_px, tuple)
    drawn = (photograph and read_paper(image)) or (not boxed and plain_ground(image))
    return (drawn[0], (drawn[1],), photograph) if drawn else (image, (), False)


def read_bytes(
    path: Path, what: str, largest: int = raster.LARGEST_SIDE, missing: str = _MISSING
) -> bytes:
    """Read a picture's file, at most `largest` px on a side; errors call it `what`.

    Args:
        missing: the remedy where there is no such file.

    Raises:
        InputError: there is none, it may not be read, it is empty, or too large for a picture.
    """
    most = 9 * largest**2  # a pixel of 16-bit RGBA, and the file's other data
    data = read_file(
        path,
        what,
        "picture file",
        most,
        missing=missing,
        too_large=f"Scale the picture down to at most {largest} pixels on a side.",
    )
    if not data:
        raise InputError(what, "the file is empty", "Copy or export it again.")
    return data


def read_source(source: str | Path, base: Path | None) -> tuple[bytes, Path]:
    """Read a picture's file; return its bytes and path. Arguments as `read_target` takes them."""
    what = shown(source)
    if re.match(r"(?i)file://", str(source)):
        source = unquote(re.sub(r"(?i)^file://(?:localhost)?(?=/)", "", str(source)))
    elif (quoted := str(source).strip()) and quoted[0] in "'\"‘“" and quoted[-1] in "'\"’”":
        bare = quoted[1:-1]
        raise InputError(what, "its path has quotes about it", f"Leave them out: {bare}")
    path = at_home(source)
    if base is not None:
        path = base / path
    if re.match(r"(?i:https?|ftp):/", str(source)):
        raise InputError(
            what, "it is an address on the web", "Download the picture, and name the file."
        )
    missing = _MISSING if base is None else "Lay it beside the scene that names it."
    return read_bytes(path, what, missing=missing), path
