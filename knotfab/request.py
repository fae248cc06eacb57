"""What `knotfab build` was asked, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab.errors import MachineError
from knotfab.scene.model import Scene
from knotfab.target.read import Target

__all__ = ["Outcome", "Request", "require_device"]

_RESERVE_S = 5.0  # of a time budget, for what follows the search


@dataclass(frozen=True)
class Request:
    """The scene as a person wrote it, its pictures, and how to build it.

    `pictures`: one for each view of the scene, each a file, an SVG or `text:…`; of a sequence its frames:
    a folder of numbered pictures, an animation, or several pictures in order. Where they are relative,
    they lie in `base`, the working folder by default.
    """

    scene: Scene
    pictures: tuple[str, ...]
    out: Path
    base: Path | None = None
    printing: bool = False
    device: str = "cpu"
    skip: frozenset[str] = frozenset()
    time_budget_s: float | None = None
    command: str = ""
    colours: bool = False  # whether part-colours.3mf is written
    sequence: bool = False  # the pictures are frames of one moving knot
    targets: tuple[Target, ...] = ()  # the pictures, where they have been read already
    preview: tuple[str, ...] = ()  # what was said of them before the build

    def search_budget_s(self, spent_s: float) -> float | None:
        """Seconds that are left for the search after `spent_s`; None without a time budget."""
        if self.time_budget_s is None:
            return None
        return max(1.0, self.time_budget_s - spent_s - _RESERVE_S)


@dataclass(frozen=True)
class Outcome:
    """Exit code by the contract, the report, and the folder that was written."""

    exit_code: int
    report: dict[str, Any]
    folder: Path


def require_device(name: str) -> None:
    """Refuse a device that this machine has not.

    Raises:
        MachineError: torch finds none of that kind.
    """
    if name == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise MachineError(
            f"--device {name}",
            "torch finds no CUDA device here",
            "Use --device cpu, or install a torch with CUDA (knotfab doctor says what is here).",
        )
