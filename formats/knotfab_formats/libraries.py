"""Record which libraries take part in a run, where they are called, for a report's `settings.parts`.

Maker, validators and fixtures do so alike; records of their processes come back with each answer.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

Deeds = dict[str, list[str]]
# what pyvista loads for its charts, cadquery for its viewer, torch for its compiler: .1, .4 and .5 s
_IDLE = ("matplotlib.pyplot", "vtk", "torch.export", "torch._meta_registrations")
_told: ContextVar[Deeds | None] = ContextVar("libraries", default=None)


def leave_out_settings_of_matplotlib() -> None:
    """Keep a person's own backend and settings from matplotlib in this process and in its children.

    A backend of a notebook's may not be here, and a matplotlibrc that cannot be read ends the import. That of
    the current folder comes before all others.
    """
    os.environ |= {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    if not os.path.exists("matplotlibrc"):
        return
    here = os.getcwd()
    os.chdir(os.path.dirname(__file__))
    try:
        import matplotlib  # noqa: F401
    finally:
        os.chdir(here)


class _Deferred(ModuleType):
    """A module that is loaded when something of it is asked for."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__spec__ = ModuleSpec(name, None)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name not in ("__path__", "__all__"):
            raise AttributeError(name)  # what looks through all modules asks for nothing
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(importlib.import_module(self.__name__), name)


def defer_idle_modules() -> None:
    """Have modules that libraries load, and no worker needs, wait until something of them is asked for."""
    for name in _IDLE:
        sys.modules.setdefault(name, _Deferred(name))


def took_part(library: str, *deeds: str) -> None:
    """Record what a library does, for whoever is `recording`.

    Args:
        library: its distribution, as `pip` installs it. deeds: in the past tense, as in "swept the
        tubes".
    """
    if (told := _told.get()) is not None:
        known = told.setdefault(library, [])
        known += [deed for deed in deeds if deed not in known]


@contextmanager
def recording() -> Iterator[Deeds]:
    """Record what libraries do in this block; a nested block adds to the outer record.

    Threads record too, if they run in a copy of this context.
    """
    told = _told.get()
    told = Deeds() if told is None else told
    before = _told.set(told)
    try:
        yield told
    finally:
        _told.reset(before)


def add_parts(parts: Mapping[str, list[str]]) -> None:
    """Add what another process recorded."""
    for library, deeds in parts.items():
        took_part(library, *deeds)


def list_parts() -> dict[str, str]:
    """List what each library has done so far, sorted by name."""
    return {library: ", ".join(deeds) for library, deeds in sorted((_told.get() or {}).items())}
