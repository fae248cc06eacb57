"""Loops compiled by numba: once on a machine, kept on disk where there is a place to write."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core.runtime.nrt import rtsys

__all__ = ["compiled"]

_In = ParamSpec("_In")
_Out = TypeVar("_Out")


def compiled(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Compile a function of arrays and numbers when it is first called.

    Floating point is that of IEEE, in the order that is written, and a division by zero gives what it gives
    in numpy. What is compiled is kept beside the source, or else in NUMBA_CACHE_DIR or the user's
    cache; where none of these can be written, or the disk is full, it is compiled anew in each process.
    """
    try:
        loop = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        loop = numba.njit(nogil=True, error_model="numpy")(function)
    _keep_lightly(loop)
    return cast("Callable[_In, _Out]", loop)


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
