"""Loops compiled by numba: once on a machine, kept on disk where there is a place to write."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

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
    _save_if_possible(loop)
    return cast("Callable[_In, _Out]", loop)


def _save_if_possible(loop: Any) -> None:
    """A disk that is full keeps nobody from running what is compiled already; numba's own cache raises."""
    # none where NUMBA_DISABLE_JIT leaves the function as it is
    cache = getattr(loop, "_cache", None)
    if cache is None:
        return
    save = cache.save_overload

    def try_to_save(*overload: Any) -> None:
        with contextlib.suppress(OSError):
            save(*overload)

    cache.save_overload = try_to_save
