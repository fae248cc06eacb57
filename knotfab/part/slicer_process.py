"""Run one command with limits on its time and output, and leave nothing of it behind."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from knotfab.base.pool import tie
from knotfab_formats.print_figures import SlicerCheck, SlicerWarning

MOST_SAID = 4_000_000  # bytes on standard output or error
MOST_WRITTEN = 1_000_000_000  # bytes in the working folder
GRACE_S = 5.0  # until a killed process must be gone
OUT_OF_TIME = "no answer in time"


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (negative: a signal), or why it was stopped."""

    code: int
    out: str
    err: str
    stopped: str = ""


def run_limited(
    command: Sequence[str],
    folder: Path,
    timeout_s: float,
    stop: threading.Event | None = None,
    hear: Callable[[str], None] | None = None,
) -> Ended:
    """Run `command` with `folder` as its home, in a process group that is killed to stop it.

    It is stopped when `timeout_s` have passed, when it prints or writes too much, or when `stop` is
    set. On Linux it ends with this process, too. Its output goes to files in the folder, so that
    it never waits for a reader.

    Args:
        hear: called with what it has printed so far, while it runs.

    Raises:
        OSError: the command cannot be started.
    """
    if shutil.which(command[0]) is None:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), command[0])
    out, err = folder / "said.out", folder / "said.err"
    with out.open("wb") as to_out, err.open("wb") as to_err:
        child = subprocess.Popen(
            tie(command, signal.SIGKILL),
            cwd=folder,
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=to_out,
            stderr=to_err,
            start_new_session=True,
        )
        stopped = ""
        try:
            deadline = time.monotonic() + timeout_s
            while child.poll() is None and not stopped:
                if stop is not None and stop.is_set():
                    stopped = "the build ended"
                elif time.monotonic() > deadline:
                    stopped = OUT_OF_TIME
                elif max(out.stat().st_size, err.stat().st_size) > MOST_SAID:
                    stopped = f"it said more than {MOST_SAID // 10**6} MB"
                elif _size(folder) > MOST_WRITTEN:
                    stopped = f"it wrote more than {MOST_WRITTEN // 10**9} GB"
                else:
                    with suppress(subprocess.TimeoutExpired):
                        child.wait(0.05)
                    if hear is not None:
                        hear(_text(out))
        finally:
            _kill_group(child)
    return Ended(child.returncode, _text(out), _text(err), stopped)


def _environment(folder: Path) -> dict[str, str]:
    """Copy this process's environment, with another home, no display and the language "C"."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("LC_", "XDG_")) and key not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    return {**kept, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "LANG": "C.UTF-8"}


def _kill_group(child: subprocess.Popen[bytes]) -> None:
    """End the command and all that it started: the group outlives its first process."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
    else:  # Windows, which knows who started whom
        call = ["taskkill", "/F", "/T", "/PID", str(child.pid)]
        with suppress(OSError, subprocess.TimeoutExpired):
            subprocess.run(call, capture_output=True, timeout=GRACE_S, check=False)
        child.kill()
    with suppress(subprocess.TimeoutExpired):
        child.wait(GRACE_S)


def _size(folder: Path) -> int:
    total = 0
    for path in folder.iterdir():
        with suppress(OSError):  # gone in between
            total += path.stat().st_size
    return total


def _text(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(MOST_SAID).decode("utf-8", "replace")


# Find PrusaSlicer, or say how to get it.

NAMES = ("prusa-slicer", "PrusaSlicer", "prusaslicer", "prusa-slicer-console")
# where its installers put it, which is not on the path
PLACES = ("/Applications/PrusaSlicer.app/Contents/MacOS", r"C:\Program Files\Prusa3D\PrusaSlicer")
REMEDY = "apt-get install --no-install-recommends prusa-slicer"


def find_slicer() -> str | None:
    """Return PrusaSlicer's path; None if it is not installed."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *PLACES])
    return next(filter(None, (shutil.which(name, path=path) for name in NAMES)), None)


@cache
def ask_help(program: str) -> Ended:
    """Return the program's help text, which begins with its version."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        try:
            return run_limited([program, "--help"], Path(home), 20.0)
        except OSError as error:
            return Ended(1, "", str(error))


def read_version(program: str) -> tuple[int, int] | None:
    """Return the program's major and minor version; None if its help text names none."""
    found = re.search(r"PrusaSlicer-(\d+)\.(\d+)", ask_help(program).out)
    return None if found is None else (int(found[1]), int(found[2]))


# The result of slicing a part: PrusaSlicer's figures, or why there are none.


@dataclass(frozen=True)
class Sliced:
    """PrusaSlicer's figures for the part, its warnings, and what knotfab found in its G-code."""

    program: str
    version: str
    time_s: float
    filament_m: float
    filament_g: float
    support_m: float  # filament that goes into supports
    layers: int
    objects: int  # objects counted in the 3MF
    warnings: tuple[SlicerWarning, ...]
    checks: tuple[SlicerCheck, ...]
    command: str
    profile: dict[str, str] = field(hash=False)
    seconds: float  # seconds of slicing
    retractions: int = 0
    starts_per_layer: float = 0.0  # lines that begin after a travel

    @property
    def support_share(self) -> float:
        """The share of the filament that supports take, 0 to 1."""
        return self.support_m / self.filament_m if self.filament_m > 0 else 0.0

    @property
    def problems(self) -> list[str]:
        """Faults that speak against the part; empty for a good one."""
        said = [
            f"PrusaSlicer warns: {' '.join(w.text.split())}"
            + (f" ({w.explanation})" if w.explanation else " (nobody explains it)")
            for w in self.warnings
            if not w.settled
        ]
        return said + [c.detail for c in self.checks if not c.passed]


@dataclass(frozen=True)
class NotSliced:
    """Why there are no figures.

    - `missing`: the program is not installed; `process`: the piece is not made of filament; `stopped`: time
      ran out. Nothing is known of the part.
    - `refused`: PrusaSlicer would not slice the part; `crashed`: it crashed, or wrote nothing useful. That
      speaks against the part.
    """

    kind: Literal["missing", "process", "stopped", "refused", "crashed"]
    reason: str
    remedy: str = ""
    said: str = ""  # PrusaSlicer's words


def sum_slicings(files: Mapping[str, Sliced | NotSliced]) -> Sliced | NotSliced:
    """Sum the figures of several files; if one could not be sliced, return the first such answer.

    Checks and warnings name their file, and the command is that of part-N.3mf.
    """
    for name, one in files.items():
        if isinstance(one, NotSliced):
            known = one.kind in ("refused", "crashed")
            return replace(one, reason=f"{name}: {one.reason}") if known else one
    all_ = {name: one for name, one in files.items() if isinstance(one, Sliced)}
    first, *others = all_.values()
    if not others:
        return first
    starts = sum(one.starts_per_layer * one.layers for one in all_.values())
    figures: dict[str, Any] = {
        key: sum(getattr(one, key) for one in all_.values())
        for key, value in vars(first).items()
        if isinstance(value, int | float)
    }
    return replace(
        first,
        **figures | {"starts_per_layer": starts / max(figures["layers"], 1)},
        command=re.sub(r"-\d+\.(3mf|gcode)\b", r"-N.\1", first.command),
        warnings=tuple(
            replace(w, text=f"{name}: {w.text}") for name, one in all_.items() for w in one.warnings
        ),
        checks=tuple(
            replace(c, detail=f"{name}: {c.detail}")
            for name, one in all_.items()
            for c in one.checks
        ),
    )
