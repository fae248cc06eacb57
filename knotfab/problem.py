"""What a search is asked, and what it answers: knots, how they stand, and the account of certificates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.effects.base import Decision, Limits
from knotfab.errors import SceneError
from knotfab.knots import Knots
from knotfab.scene.model import Region, View
from knotfab.search.feasibility import Standing
from knotfab.start.depth import DepthChoice

__all__ = ["Account", "Infeasible", "Problem", "Report", "SearchResult"]

Mask = NDArray[np.bool_]
Report = Callable[[float, float | None], None]  # (fraction done, IoU)


@dataclass(frozen=True)
class Problem:
    """What is to be drawn, and what the knots must keep to (mm)."""

    view: View
    mask: Mask
    polygon: MultiPolygon  # the silhouette in the plane z = 0
    clearance: float
    bend_radius: float | None  # None: the tube radius plus half the clearance
    length: float
    region: Region
    depth_mm: float | None  # extent of the centre lines along the axis; None: flat
    knot: str = "unknot"  # tied into the longest curve

    def limits(self, radius: float) -> Limits:
        """The hard limits for a tube of this radius."""
        bend = max(self.bend_radius or 0.0, radius + 0.5 * self.clearance)
        return Limits(radius, self.clearance, bend, self.length, self.region)


@dataclass
class Account:
    """The certificates of a search, for its report."""

    template: str = ""
    types: tuple[str, ...] = ()  # of the knots
    accepted: int = 0
    shortened: int = 0
    refused: int = 0
    resamplings: int = 0
    resamplings_refused: int = 0
    least_margin_mm: float = float("inf")
    repairs: int = 0

    @property
    def certified(self) -> bool:
        """Whether every step from the template to the end is a proved isotopy."""
        return bool(self.template) and self.least_margin_mm > 0


@dataclass
class SearchResult:
    """Knots in scene coordinates, and how they came about."""

    knots: Knots
    standing: Standing
    account: Account
    effects: dict[str, Decision]
    depth: DepthChoice | None
    iou_estimate: float


class Infeasible(SceneError):
    """The search ended with a violated limit; `result` is the best it came to."""

    def __init__(self, result: SearchResult) -> None:
        self.result = result
        super().__init__(
            "the search",
            "; ".join(result.standing.violations),
            "Give the piece more room (a larger frame, a thinner tube, more depth), or loosen that limit.",
        )
