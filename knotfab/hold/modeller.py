"""A separate process that models the solids of mounts during a build."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any, ParamSpec

import numpy as np

from knotfab.base.errors import MachineError
from knotfab.base.pool import Crash, Workers
from knotfab.geometry.tube import Mesh

_In = ParamSpec("_In")
_MODULE = "knotfab_fixtures.service"


_kept: ContextVar[Workers | None] = ContextVar("modeller", default=None)


@contextlib.contextmanager
def keep_modeller(early: bool) -> Iterator[None]:
    """Let one process model all fixtures during the block, and end it afterwards.

    OpenCascade takes two seconds to load and 300 MB to keep. Beside a search the loading costs no
    time, and the memory is free again when the part is verified.

    Args:
        early: start it now, since it will be needed; otherwise at the first request.
    """
    with Workers(_MODULE, early=early) as modeller:
        before = _kept.set(modeller)
        try:
            yield
        finally:
            _kept.reset(before)


def model_fixture(fixture: Callable[_In, Mesh], *sizes: _In.args, **named: _In.kwargs) -> Mesh:
    """Make the mesh of a fixture, a function of `knotfab_fixtures`, in the kept process or here.

    Raises:
        MachineError: the process ended instead.
        ValueError: no such fixture has these sizes.
    """
    modeller = _kept.get()
    if modeller is None:
        return fixture(*sizes, **named)
    request: dict[str, Any] = {
        "module": fixture.__module__,
        "fixture": fixture.__name__,
        "sizes": sizes,
        "named": named,
    }
    try:
        answer = modeller.answer(request)
    except Crash as crash:
        raise MachineError(
            "the solid modeller (cadquery)",
            f"its process ended with exit code {crash.code}: {crash.said.rstrip('.')}",
            "Leave the mount out (--mount none), or install cadquery anew; knotfab doctor says what "
            "this machine lacks",
        ) from None
    if "error" in answer:
        raise ValueError(answer["error"])
    vertices, faces = answer["answer"]
    return np.array(vertices), np.array(faces, dtype=np.int32)


def rest_modeller() -> None:
    """End the kept process to free its memory; the next request starts it again."""
    if (modeller := _kept.get()) is not None:
        modeller.interrupt()
