"""The request to `knotfab build`, and its outcome."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from knotfab.base.errors import MachineError
from knotfab.design.budget import Budget
from knotfab.picture.frames import count_knots
from knotfab.picture.read import Target
from knotfab_formats.errors import InputError, plain
from knotfab_formats.report import Report
from knotfab_formats.scene import ResolvedScene

# usual seconds after a search: always, of a printed piece, of a mounted one, and per vertex
_AFTER_S, _AFTER_PRINTED_S, _AFTER_MOUNT_S, _AFTER_VERTEX_S = 1.2, 3.0, 8.0, 0.55e-3
_FIRST_SHARE = 0.5  # share of a time budget for a build that may have to be repeated another way


@dataclass(frozen=True)
class Promise:
    """What a preview tells of a piece; no hours but of filament. It counts on strands of this length."""

    radius_mm: float
    holder: str
    grams: float
    hours: float | None
    length_mm: float
    told: float | None = None


@dataclass(frozen=True)
class Request:
    """The scene as a person wrote it, its pictures, which are read once, and how to build it.

    `targets`: the pictures as they were read, one for each view of the scene, or a sequence's frames.
    `otherwise`: the scene to build if this one cannot be printed without supports, as it asks.
    `why_supported`: why a build with `supports = "auto"` uses the slicer's.
    """

    scene: ResolvedScene
    targets: tuple[Target, ...]
    out: Path
    printing: bool = False
    device: str = "cpu"
    skip: frozenset[str] = frozenset()
    time_budget_s: float | None = None
    command: str = ""
    colours: bool = False  # whether part-colours.3mf is written
    sequence: bool = False  # the pictures are frames of one moving knot
    preview: tuple[str, ...] = ()  # lines of the preview, before the build
    promise: Promise | None = None  # what they tell, if a search does not decide it
    otherwise: ResolvedScene | None = None
    why_supported: str = ""

    @property
    def chooses_holder(self) -> bool:
        """Whether the build chooses what holds the piece; for a sequence it never does."""
        mount = self.scene.mount
        left_open = mount.kind == "auto" and not mount.asked
        return self.printing and left_open and not self.sequence

    @property
    def mounted(self) -> bool:
        """Whether the piece is printed with a mount."""
        scene = self.scene
        if self.sequence:
            knots = count_knots(self.targets, scene.piece.knots)
        else:
            knots = scene.count_knots(self.targets[0].pieces)
        given = scene.mount.asked or scene.on_wall(knots)
        return self.printing and (given or self.chooses_holder)

    def budget(self, spent_s: float) -> Budget | None:
        """Return what is left of the time budget after `spent_s`; None without a budget."""
        if self.time_budget_s is None:
            return None
        after = _AFTER_S
        if self.printing:
            after += _AFTER_PRINTED_S + _AFTER_MOUNT_S * self.mounted
        began = time.perf_counter() - spent_s
        left = self.time_budget_s * (1.0 if self.otherwise is None else _FIRST_SHARE)
        return Budget(began + left, after, _AFTER_VERTEX_S * len(self.scene.views), began)


@dataclass(frozen=True)
class Outcome:
    """The result of a build: exit code, report, and the folder written."""

    exit_code: int
    found: Report = field(repr=False)
    folder: Path

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json."""
        return dict(plain(self.found))


def require_device(request: Request) -> None:
    """Refuse a device that nothing of the build runs on, or that this machine lacks.

    Raises:
        InputError: only the flow searches, which compiled loops do on the CPU. MachineError: torch finds no
            such device.
    """
    if request.device == "cpu":
        return
    if request.scene.settings.method == "flow":
        raise InputError(
            f"--device {request.device}",
            "only the paper's network runs there",
            "Leave it out, or search with the network (--search inn or --search inn+flow).",
        )
    import torch

    if not torch.cuda.is_available():
        raise MachineError(
            f"--device {request.device}",
            "torch finds no CUDA device here",
            "Use --device cpu, or install a torch with CUDA (knotfab doctor says what is here).",
        )
