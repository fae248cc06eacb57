"""Loops compiled by numba: once on a machine, kept on disk where there is a place to write."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

__all__ = ["compiled"]

_In = ParamSpec("_In")
_Out = TypeVar("_Out")


def compiled(function: Callable[_In, _Out]) -> Callable[_In, _Out]:
    """Compile a function of arrays and numbers when it is first called.

    Floating point is that of IEEE, in the order that is written, and a division by zero gives what it gives
    in numpy. What is compiled is kept beside the source, or else in NUMBA_CACHE_DIR or the user's
    cache; where none of these can be written, it is compiled anew in each process.
    """
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        return numba.njit(nogil=True, error_model="numpy")(function)
