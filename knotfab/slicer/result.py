"""What came of slicing a part: PrusaSlicer's figures, or why there are none."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from knotfab.slicer.known_warnings import SlicerWarning

__all__ = ["CrossCheck", "NotSliced", "Sliced"]


@dataclass(frozen=True)
class CrossCheck:
    """One of knotfab's own looks at what PrusaSlicer made of the file."""

    name: str
    passed: bool
    measured: float
    limit: float
    unit: str
    detail: str


@dataclass(frozen=True)
class Sliced:
    """PrusaSlicer's figures for the part, its warnings, and what knotfab found in its G-code."""

    program: str
    version: str
    time_s: float
    filament_m: float
    filament_g: float
    support_m: float  # of the filament, what goes into supports
    layers: int
    objects: int  # that it counts in the 3MF
    warnings: tuple[SlicerWarning, ...]
    checks: tuple[CrossCheck, ...]
    command: str
    profile: dict[str, str] = field(hash=False)
    seconds: float  # that slicing took

    @property
    def problems(self) -> list[str]:
        """What speaks against the part; empty for a good one."""
        said = [
            f"PrusaSlicer warns: {' '.join(w.text.split())}"
            + (f" ({w.explanation})" if w.explanation else " (nobody explains it)")
            for w in self.warnings
            if not w.settled
        ]
        return said + [c.detail for c in self.checks if not c.passed]


@dataclass(frozen=True)
class NotSliced:
    """Why there are no figures.

    - `missing`: the program is not installed; `process`: the piece is not of filament; `stopped`:
      no answer in the time it had. Nothing is known of the part.
    - `refused`: PrusaSlicer would not slice the part; `crashed`: it died of it, or wrote nothing of
      use. That speaks against the part.
    """

    kind: Literal["missing", "process", "stopped", "refused", "crashed"]
    reason: str
    remedy: str = ""
    said: str = ""  # by PrusaSlicer
