"""Knots: the only thing the search hands on. One or more polylines with one radius."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Knot", "Knots"]


@dataclass(frozen=True)
class Knot:
    """A polyline: `points` is (n, 3) float64 in mm; where it is closed the last joins the first.

    An open one has no type: `type` is then "open".
    """

    points: NDArray[np.float64]
    type: str = "unknot"
    closed: bool = True

    @property
    def length_mm(self) -> float:
        """Length of the polyline, the closing edge included where it is closed."""
        edges = np.roll(self.points, -1, axis=0) - self.points
        edges = edges if self.closed else edges[:-1]
        return float(np.linalg.norm(edges, axis=1).sum())


@dataclass(frozen=True)
class Knots:
    """All knots of a piece, which share one tube radius (mm)."""

    knots: tuple[Knot, ...]
    radius_mm: float

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) all vertices of all knots, in order."""
        return np.concatenate([k.points for k in self.knots])

    def moved(self, matrix: NDArray[np.float64]) -> Knots:
        """The same knots under a rigid 4x4 `matrix`."""
        turn, shift = matrix[:3, :3], matrix[:3, 3]
        return Knots(
            tuple(Knot(k.points @ turn.T + shift, k.type, k.closed) for k in self.knots),
            self.radius_mm,
        )

    def to_dict(self) -> dict[str, Any]:
        """The content of knots.json (contract: schema 1)."""
        return {
            "schema": 1,
            "unit": "mm",
            "radius_mm": self.radius_mm,
            "knots": [
                {"closed": k.closed, "type": k.type, "points": k.points.tolist()}
                for k in self.knots
            ],
        }

    def write(self, path: Path) -> None:
        """Write knots.json."""
        path.write_text(json.dumps(self.to_dict()))
