"""Where PrusaSlicer is, and how to get it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from functools import cache

__all__ = ["REMEDY", "find_slicer", "read_version"]

NAMES = ("prusa-slicer", "PrusaSlicer", "prusaslicer", "prusa-slicer-console")
# where its installers put it, which is on nobody's path
PLACES = (
    "/Applications/PrusaSlicer.app/Contents/MacOS",
    r"C:\Program Files\Prusa3D\PrusaSlicer",
)
_ANSWERS_IN_S = 20.0
REMEDY = "apt-get install --no-install-recommends prusa-slicer"


def find_slicer() -> str | None:
    """The program's path, where it is installed."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *PLACES])
    return next(filter(None, (shutil.which(name, path=path) for name in NAMES)), None)


@cache
def read_version(program: str) -> tuple[int, int] | None:
    """Its version's first two numbers, as it says them itself; None where it does not."""
    quiet = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    try:
        # where it keeps things
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
            said = subprocess.run(
                [program, "--help"],
                capture_output=True,
                env={**quiet, "HOME": home, "XDG_CONFIG_HOME": home},
                timeout=_ANSWERS_IN_S,
                check=False,
            ).stdout
    except (OSError, subprocess.TimeoutExpired):
        return None
    found = re.search(rb"PrusaSlicer-(\d+)\.(\d+)", said)
    return None if found is None else (int(found[1]), int(found[2]))
