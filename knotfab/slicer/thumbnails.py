"""Small pictures of the part in the comments of G-code, as printers and their servers show them.

PrusaSlicer draws them in its window alone, not from the command line.
"""

from __future__ import annotations

import io
import shutil
from base64 import b64encode
from pathlib import Path
from textwrap import wrap

from PIL import Image, ImageOps

__all__ = ["SIZES", "copy_with_pictures"]

# width, height, format: what the screens of Prusa's printers read (QOI; PNG by older ones), and what
# Klipper's and OctoPrint's pages do (PNG)
SIZES = (
    (16, 16, "QOI"),
    (313, 173, "QOI"),
    (440, 240, "QOI"),
    (32, 32, "PNG"),
    (220, 124, "PNG"),
    (300, 300, "PNG"),
)
_TAGS = {"QOI": "thumbnail_QOI", "PNG": "thumbnail"}
_ROW = 78  # signs of a comment's line


def copy_with_pictures(gcode: Path, target: Path, png: bytes) -> None:
    """Copy a G-code to `target`, with a picture in all `SIZES` behind its first line.

    Args:
        png: the picture, which is fitted into each size on the colour of its first pixel.
    """
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    with gcode.open("rb") as source, target.open("wb") as copy:
        copy.write(source.readline())
        for width, height, kind in SIZES:
            copy.write(_comment(picture, width, height, kind).encode("ascii"))
        shutil.copyfileobj(source, copy)


def _comment(picture: Image.Image, width: int, height: int, kind: str) -> str:
    paper = "#" + picture.crop((0, 0, 1, 1)).tobytes().hex()
    small = ImageOps.pad(picture, (width, height), color=paper)
    packed = io.BytesIO()
    small.save(packed, kind)
    text = b64encode(packed.getvalue()).decode("ascii")
    rows = "\n".join(f"; {row}" for row in wrap(text, _ROW))
    tag = _TAGS[kind]
    return f"\n;\n; {tag} begin {width}x{height} {len(text)}\n{rows}\n; {tag} end\n;\n"
