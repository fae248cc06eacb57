"""Where PrusaSlicer is, and how to get it."""

from __future__ import annotations

import shutil

__all__ = ["REMEDY", "find_slicer"]

NAMES = ("prusa-slicer", "PrusaSlicer", "prusaslicer", "prusa-slicer-console")
REMEDY = "apt-get install --no-install-recommends prusa-slicer"


def find_slicer() -> str | None:
    """The program's path, where it is installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)
