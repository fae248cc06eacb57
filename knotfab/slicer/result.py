"""The result of slicing a part: PrusaSlicer's figures, or why there are none."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from knotfab_formats.report import SlicerCheck, SlicerWarning

__all__ = ["NotSliced", "Sliced", "sum_slicings"]


@dataclass(frozen=True)
class Sliced:
    """PrusaSlicer's figures for the part, its warnings, and what knotfab found in its G-code."""

    program: str
    version: str
    time_s: float
    filament_m: float
    filament_g: float
    support_m: float  # filament that goes into supports
    layers: int
    objects: int  # objects counted in the 3MF
    warnings: tuple[SlicerWarning, ...]
    checks: tuple[SlicerCheck, ...]
    command: str
    profile: dict[str, str] = field(hash=False)
    seconds: float  # seconds of slicing

    @property
    def support_share(self) -> float:
        """The share of the filament that supports take, 0 to 1."""
        return self.support_m / self.filament_m if self.filament_m > 0 else 0.0

    @property
    def problems(self) -> list[str]:
        """Faults that speak against the part; empty for a good one."""
        said = [
            f"PrusaSlicer warns: {' '.join(w.text.split())}"
            + (f" ({w.explanation})" if w.explanation else " (nobody explains it)")
            for w in self.warnings
            if not w.settled
        ]
        return said + [c.detail for c in self.checks if not c.passed]


@dataclass(frozen=True)
class NotSliced:
    """The reason why there are no figures.

    - `missing`: the program is not installed; `process`: the piece is not of filament; `stopped`:
      no answer in the time it had. Nothing is known of the part.
    - `refused`: PrusaSlicer would not slice the part; `crashed`: it died of it, or wrote nothing of
      use. That speaks against the part.
    """

    kind: Literal["missing", "process", "stopped", "refused", "crashed"]
    reason: str
    remedy: str = ""
    said: str = ""  # PrusaSlicer's words


def sum_slicings(files: Mapping[str, Sliced | NotSliced]) -> Sliced | NotSliced:
    """Sum several files, by their names: the first that could not be sliced decides.

    Times, filament, layers and objects are summed; checks and warnings say of which file they are, and
    the command is that of part-N.3mf.
    """
    for name, one in files.items():
        if isinstance(one, NotSliced):
            known = one.kind in ("refused", "crashed")
            return replace(one, reason=f"{name}: {one.reason}") if known else one
    all_ = {name: one for name, one in files.items() if isinstance(one, Sliced)}
    if len(all_) == 1:
        return next(iter(all_.values()))
    first, each = next(iter(all_.values())), all_.values()
    return replace(
        first,
        time_s=sum(one.time_s for one in each),
        filament_m=sum(one.filament_m for one in each),
        filament_g=sum(one.filament_g for one in each),
        support_m=sum(one.support_m for one in each),
        layers=sum(one.layers for one in each),
        objects=sum(one.objects for one in each),
        seconds=sum(one.seconds for one in each),
        command=re.sub(r"-\d+\.(3mf|gcode)\b", r"-N.\1", first.command),
        warnings=tuple(
            replace(w, text=f"{name}: {w.text}") for name, one in all_.items() for w in one.warnings
        ),
        checks=tuple(
            replace(c, detail=f"{name}: {c.detail}")
            for name, one in all_.items()
            for c in one.checks
        ),
    )
