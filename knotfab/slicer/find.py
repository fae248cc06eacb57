"""Find PrusaSlicer, or say how to get it."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

from knotfab.slicer.process import Ended, run_limited

__all__ = ["REMEDY", "ask_help", "find_slicer", "read_version"]

NAMES = ("prusa-slicer", "PrusaSlicer", "prusaslicer", "prusa-slicer-console")
# the place where its installers put it, which is on nobody's path
PLACES = ("/Applications/PrusaSlicer.app/Contents/MacOS", r"C:\Program Files\Prusa3D\PrusaSlicer")
REMEDY = "apt-get install --no-install-recommends prusa-slicer"


def find_slicer() -> str | None:
    """Find the program's path, where it is installed."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *PLACES])
    return next(filter(None, (shutil.which(name, path=path) for name in NAMES)), None)


@cache
def ask_help(program: str) -> Ended:
    """Ask for its help text, which begins with its version."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        try:
            return run_limited([program, "--help"], Path(home), 20.0)
        except OSError as error:
            return Ended(1, "", str(error))


def read_version(program: str) -> tuple[int, int] | None:
    """Read its version's first two numbers, as it says them itself; None where it does not."""
    found = re.search(r"PrusaSlicer-(\d+)\.(\d+)", ask_help(program).out)
    return None if found is None else (int(found[1]), int(found[2]))
