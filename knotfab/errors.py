"""Errors that a user can act on: each names the thing, the reason and the remedy.

KnotfabError                    (exit code 2 unless a subclass says otherwise)
 ├── InputError            2    the picture, scene or call is wrong
 ├── SceneError            1    the scene cannot be met (infeasible), or a required check failed
 └── MachineError          3    this machine lacks something a required check needs
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["InputError", "KnotfabError", "MachineError", "SceneError", "needs_extra"]


class KnotfabError(Exception):
    """Base of every error knotfab raises on purpose; `exit_code` follows the contract."""

    exit_code = 2

    def __init__(self, what: str, why: str, remedy: str) -> None:
        self.what, self.why, self.remedy = what, why, remedy
        super().__init__(f"{what}: {why}. {remedy}")


class InputError(KnotfabError):
    """The picture, the scene file or the call is wrong."""

    exit_code = 2


class SceneError(KnotfabError):
    """The scene cannot be met: the message says which constraint binds, and where."""

    exit_code = 1


class MachineError(KnotfabError):
    """This machine lacks something that a required step needs."""

    exit_code = 3


@contextmanager
def needs_extra(what: str, extra: str) -> Iterator[None]:
    """Around imports of what only `knotfab[extra]` installs, for `what` a person asked for.

    Raises:
        MachineError: one of them is missing.
    """
    try:
        yield
    except ImportError as error:
        why = f"it needs {error.name or extra}, which is not installed"
        raise MachineError(what, why, f"pip install 'knotfab[{extra}]'") from error
