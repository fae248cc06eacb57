"""Loops compiled by numba, once per machine: the machine code is cached on disk where possible."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event

from knotfab.base.progress import say_everywhere
from knotfab_formats.collector import look_as_usual, look_rarely

_In = ParamSpec("_In")
_Out = TypeVar("_Out")
_ROOM_BYTES = 16_000_000  # free disk space required; all loops together take a third of it
_LOOPS: list[Any] = []  # numba's dispatchers


class _Compiling(event.Listener):
    """Says that loops are compiled; meanwhile the garbage collector looks on more rarely."""

    def on_start(self, _: object) -> None:
        look_rarely()
        say_everywhere("Loops that this machine has not run yet are compiled, once.")

    def on_end(self, _: object) -> None:
        look_as_usual()


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call]


def compiled(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Compile a function of arrays and numbers on its first call; it runs on the caller's thread.

    Floating point follows IEEE in the order written, and a division by zero gives what numpy
    gives. The machine code is kept beside the source, else in NUMBA_CACHE_DIR or the user's cache.
    If none of these can be written, or the disk is full, each process compiles again.
    """
    try:
        loop = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
        if not _has_room(loop):
            raise RuntimeError("the disk is full")
    except RuntimeError:  # no place for the cache
        loop = numba.njit(nogil=True, error_model="numpy")(function)
    _LOOPS.append(loop)
    return loop


def _has_room(loop: Any) -> bool:
    """Return whether a loop's machine code is cached already, or the disk has room for it."""
    stats = getattr(loop, "stats", None)  # NUMBA_DISABLE_JIT leaves the function as it is
    if stats is None or shutil.disk_usage(stats.cache_path).free >= _ROOM_BYTES:
        return True
    return any(Path(stats.cache_path).glob(f"*{loop.__qualname__}-*.nbi"))


def count_loops() -> tuple[int, int, str]:
    """Count the loops that ran and those compiled here; return the cache's folder, too, or ""."""
    ran = [loop for loop in _LOOPS if loop.signatures]
    missed = sum(sum(loop.stats.cache_misses.values()) > 0 for loop in ran)
    kept = {str(loop.stats.cache_path) for loop in ran if loop.stats.cache_path}
    return len(ran), missed, os.path.commonpath(kept) if kept else ""
