"""The 3MF files that lie beside a part's STL: what is printed of the piece that the STL is verified of."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["find_3mf", "is_own"]

PART = re.compile(r"part(-\d+)?")
OWN = re.compile(r"part(-\d+)?|zoetrope")  # names that a build writes as STL and as 3MF


def is_own(part: Path) -> bool:
    """Tell whether a build writes files of that name: then the 3MF beside it is the same part."""
    return OWN.fullmatch(part.stem) is not None


def find_3mf(part: Path) -> list[Path]:
    """The 3MF of the same name as an STL, and of a build's part its coloured one too, those there are.

    `part-03.3mf` and `part-colours-03.3mf` beside `part-03.stl`; none beside other formats.
    """
    if part.suffix.lower() != ".stl":
        return []
    found = [part.with_suffix(".3mf")]
    if own := PART.fullmatch(part.stem):
        found.append(part.with_name(f"part-colours{own[1] or ''}.3mf"))
    return [path for path in found if path.exists()]
