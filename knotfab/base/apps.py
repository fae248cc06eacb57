"""The version, and the apps: what people start beside a build.

Apps are found by their entry points, so that the core imports none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

from knotfab.base.errors import MachineError

VERSION = "2.0.0"


def list_commands() -> Iterator[Callable[..., int]]:
    """Yield the commands that installed apps add to the command line."""
    from importlib.metadata import entry_points

    for entry in sorted(entry_points(group="knotfab.commands"), key=lambda e: e.name):
        with suppress(ModuleNotFoundError, AttributeError):  # an older installation named it
            command: Callable[..., int] = entry.load()
            yield command


def load_app(app: str) -> Any:
    """Import the module that starts an app.

    Raises:
        MachineError: it is not installed.
    """
    from importlib.metadata import entry_points  # slow to load, and seldom asked

    for entry in entry_points(group="knotfab.apps", name=app):
        return import_module(entry.module)
    raise MachineError(app, "this installation lacks it", "Install knotfab again, whole.")
