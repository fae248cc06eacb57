"""Record which libraries take part in a run, where they are called, for a report's `settings.parts`.

Maker, validators and fixtures do so alike; records of their processes come back with each answer.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

Deeds = dict[str, list[str]]
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
