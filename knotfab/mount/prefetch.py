"""Loads the solid modeller that mounts are made with while the search runs."""

from __future__ import annotations

import threading
from contextlib import suppress
from importlib import import_module

__all__ = ["prefetch_modeller"]


def prefetch_modeller() -> threading.Thread:
    """Import cadquery in a thread of its own: seconds that a search, mostly compiled, need not wait for.

    What goes wrong there is met again, and told, where a fixture is made. The thread is waited for
    when the program ends, since OpenCascade must not be torn down half-loaded.
    """

    def load() -> None:
        with suppress(Exception):
            import_module("cadquery")

    thread = threading.Thread(target=load, name="cadquery")
    thread.start()
    return thread
