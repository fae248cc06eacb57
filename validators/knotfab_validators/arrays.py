"""Array types that all modules share, and the compiler of their loops."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numba.core import event
from numpy.typing import NDArray

from knotfab_formats.collector import look_as_usual, look_rarely

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


# Loops compiled by numba: once on a machine, and cached on disk where a place is writable.

_In = ParamSpec("_In")
_Out = TypeVar("_Out")
# free bytes needed to cache; all loops of both packages take a third of it
_ROOM_BYTES = 16_000_000


class _Compiling(event.Listener):
    """Has the garbage collector look on more rarely while a loop, and those that it calls, are compiled."""

    def on_start(self, _: object) -> None:
        look_rarely()

    def on_end(self, _: object) -> None:
        look_as_usual()


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call]


def compiled(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Compile a function of arrays and numbers with numba, on its first call.

    Floating point follows IEEE in the order written; division by zero gives what it gives in numpy. The
    machine code is cached beside the source, in NUMBA_CACHE_DIR or in the user's cache. Where none of these
    can be written, or the disk is full, every process compiles again.
    """
    try:
        loop = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
        if not _has_room(loop):
            raise RuntimeError("the disk is full")
    except RuntimeError:  # no writable place for the cache
        loop = numba.njit(nogil=True, error_model="numpy")(function)
    return cast("Callable[_In, _Out]", loop)


def _has_room(loop: Any) -> bool:
    """Return whether the disk has room for a loop's machine code, or holds it already."""
    stats = getattr(loop, "stats", None)  # NUMBA_DISABLE_JIT leaves the function as it is
    if stats is None or shutil.disk_usage(stats.cache_path).free >= _ROOM_BYTES:
        return True
    return any(Path(stats.cache_path).glob(f"*{loop.__qualname__}-*.nbi"))
