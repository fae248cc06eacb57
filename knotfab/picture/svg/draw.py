"""Draw an SVG text in a process of its own, which can be ended: no picture hangs or kills its reader."""

from __future__ import annotations

import importlib.util
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from knotfab.base.pool import tie
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part

_PYTHON = sys.executable
_SECONDS = 20  # processor time
_BYTES = 2**30
# The process loads nothing but the library that draws (20 ms).
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
    """Draw the PNG of an SVG text, by resvg; `options` are those of `resvg_py.svg_to_bytes`.

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
            timeout=240,  # wall-clock time, on a machine that is busy
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
