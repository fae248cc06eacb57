"""What an effect is: a cheap a-priori bound, a threshold, and a term run only above it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from torch import Tensor

from knotfab.arrays import Array
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Polylines
from knotfab.scene.model import ResolvedRegion, ResolvedView

__all__ = ["Decision", "Effect", "EffectContext", "Limits", "State"]


@dataclass(frozen=True)
class Limits:
    """What the finished knots must keep to, in mm, all resolved to numbers."""

    radius: float
    clearance: float
    bend_radius: float
    length: float
    region: ResolvedRegion

    @property
    def separation(self) -> float:
        """Least distance of centre lines: two radii and the clearance."""
        return 2 * self.radius + self.clearance


@dataclass(frozen=True)
class EffectContext:
    """What an effect's magnitude is judged from: views, limits and the curves at the start."""

    views: tuple[ResolvedView, ...]
    limits: Limits
    points: Array  # (N, 3) mm
    rings: Polylines
    tolerance_px: float  # of the accuracy setting


@dataclass
class State:
    """One iteration of the search, as the terms see it."""

    points: Tensor  # [N, 3] mm
    edge: Tensor  # [N, 3] to the next vertex
    after: Tensor  # [N, 3] the next vertex's edge
    following: Tensor  # [N] index of the next vertex
    rings: Polylines
    near: Neighbours
    spacing: float  # mean edge, mm

    @classmethod
    def at(cls, points: Tensor, following: Tensor, rings: Polylines, near: Neighbours) -> State:
        """The state of closed polylines whose vertices are `points` [N, 3]."""
        edge = points[following] - points
        spacing = float(edge.detach().norm(dim=-1).mean())
        return cls(points, edge, edge[following], following, rings, near, spacing)


Term = Callable[[State, Limits], Tensor]


@dataclass(frozen=True)
class Effect:
    """One effect; `term` is its part of the objective, None where it acts otherwise."""

    name: str
    unit: str
    magnitude: Callable[[EffectContext], float]
    threshold: Callable[[EffectContext], float]
    reason: str  # of its being simulated
    term: Term | None = None


@dataclass
class Decision:
    """Whether an effect was simulated, and what that cost."""

    effect: Effect
    magnitude: float
    threshold: float
    simulated: bool
    seconds: float = field(default=0.0)

    def to_dict(self) -> dict[str, str | float | bool]:
        """The effect's line in report.json."""
        name = self.effect.name
        unit = self.effect.unit
        reason = (
            self.effect.reason
            if self.simulated and self.magnitude > self.threshold
            else f"{name}: the search ended beyond the limit, so a repair simulated it"
            if self.simulated
            else f"{name}: {self.magnitude:.3g} {unit} stays below {self.threshold:.3g} {unit}"
        )
        return {
            "name": name,
            "simulated": self.simulated,
            "magnitude": self.magnitude,
            "threshold": self.threshold,
            "unit": unit,
            "seconds": round(self.seconds, 4),
            "reason": reason,
        }
