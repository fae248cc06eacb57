"""Errors that a user can act on: each names the thing, the reason and the remedy.

KnotfabError                    (exit code 2 unless a subclass says otherwise)
 ├── InputError            2    the picture, scene or call is wrong
 ├── SceneError            1    the scene cannot be met (infeasible), or a required check failed
 └── MachineError          3    this machine lacks something a required check needs
"""

from __future__ import annotations

__all__ = ["InputError", "KnotfabError", "MachineError", "SceneError"]


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
