"""Where PrusaSlicer is, and how to get it."""

from __future__ import annotations

import os
import shutil

__all__ = ["REMEDY", "find_slicer"]

NAMES = ("prusa-slicer", "PrusaSlicer", "prusaslicer", "prusa-slicer-console")
# where its installers put it, which is on nobody's path
PLACES = (
    "/Applications/PrusaSlicer.app/Contents/MacOS",
    r"C:\Program Files\Prusa3D\PrusaSlicer",
)
REMEDY = "apt-get install --no-install-recommends prusa-slicer"


def find_slicer() -> str | None:
    """The program's path, where it is installed."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *PLACES])
    return next(filter(None, (shutil.which(name, path=path) for name in NAMES)), None)
