"""Loops compiled by numba: once on a machine, kept on disk where there is a place to write."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.runtime.nrt import rtsys

__all__ = ["compiled", "count_loops"]

_In = ParamSpec("_In")
_Out = TypeVar("_Out")
_LOOPS: list[Any] = []  # numba's dispatchers


def compiled(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Compile a function of arrays and numbers when it is first called; it runs on the caller's thread.

    Floating point is that of IEEE, in the order that is written, and a division by zero gives what it gives
    in numpy. What is compiled is kept beside the source, or else in NUMBA_CACHE_DIR or the user's
    cache; where none of these can be written, or the disk is full, it is compiled anew in each process.
    """
    try:
        loop = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        loop = numba.njit(nogil=True, error_model="numpy")(function)
    _keep_lightly(loop)
    _LOOPS.append(loop)
    return loop


def _keep_lightly(loop: Any) -> None:
    """Load what is kept without what only compiling needs, and let a full disk keep nobody from running.

    Numba's own cache first loads the tables of all that it can compile, a fifth of a second; its compiler
    loads them itself where it is called. Machine code that is ready needs the runtime alone.
    """
    # none where NUMBA_DISABLE_JIT leaves the function as it is, or where there is no place for it
    cache: Any = getattr(loop, "_cache", None)
    if not hasattr(cache, "_load_overload"):
        return
    load, save = cache._load_overload, cache.save_overload

    def load_alone(signature: Any, target: Any) -> Any:
        rtsys.initialize(target)
        with contextlib.suppress(OSError):
            return load(signature, target)
        return None  # it is compiled anew

    def try_to_save(*overload: Any) -> None:
        with contextlib.suppress(OSError):
            save(*overload)

    cache.load_overload, cache.save_overload = load_alone, try_to_save


def count_loops() -> tuple[int, int, str]:
    """How many loops have run in this process, how many it had to compile, and where they are kept, or ""."""
    ran = [loop for loop in _LOOPS if loop.signatures]
    missed = sum(sum(loop.stats.cache_misses.values()) > 0 for loop in ran)
    kept = {str(loop.stats.cache_path) for loop in ran if loop.stats.cache_path}
    return len(ran), missed, os.path.commonpath(kept) if kept else ""
