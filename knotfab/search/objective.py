"""The objective of one phase: the picture, and the effects that the scene calls for."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Decision, Limits, State
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.render.frame import Frame
from knotfab.render.tiled import render_tiled, winners

__all__ = ["Objective", "Weights", "iou_of"]

_CUTOFF = 5.0  # sigmoid(-5) = 0.7 %: what is further out pulls on nothing


@dataclass(frozen=True)
class Weights:
    """Weights of the terms; each term is in squared tube radii or a count of radii of curve."""

    image: float = 1.0
    clearance: float = 1.0
    bend: float = 0.1
    region: float = 10.0
    length: float = 1.0


@dataclass
class Objective:
    """Callable loss: (points [N, 3], near, progress) -> scalar.

    `target` is the coverage image [H, W] of `frame`; tau grows geometrically from `tau[0]` to `tau[1]`,
    in units of one over the projected tube radius.
    """

    frame: Frame
    target: Tensor
    rings: Rings
    limits: Limits
    effects: dict[str, Decision]
    weights: Weights
    tau: tuple[float, float]
    radius_px: float  # projected tube radius
    winners_every: int
    calls: int = 0
    won: tuple[Tensor, Tensor] | None = None
    following: Tensor = field(init=False)

    def __post_init__(self) -> None:
        self.following = torch.as_tensor(self.rings.next, device=self.target.device)

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor:
        loss = self.weights.image * self.image_term(points, progress)
        edge = points[self.following] - points
        state = State(
            points,
            edge,
            edge[self.following],
            self.following,
            self.rings,
            near,
            float(edge.detach().norm(dim=-1).mean()),
        )
        for name, decision in self.effects.items():
            if decision.simulated and decision.effect.term is not None:
                begun = time.perf_counter()
                term = decision.effect.term(state, self.limits)
                loss = loss + getattr(self.weights, name) * term
                decision.seconds += time.perf_counter() - begun
        return loss

    def image_term(self, points: Tensor, progress: float) -> Tensor:
        """Squared difference of the images, integrated, in squared projected tube radii."""
        tau = self.tau[0] * (self.tau[1] / self.tau[0]) ** progress / self.radius_px
        p = points.to(self.target.dtype)
        q, radius = p[self.following], self.limits.radius
        if self.calls % self.winners_every == 0:
            a, b = self.frame.local(p.detach()), self.frame.local(q.detach())
            self.won = winners(a, b, self.frame, radius, _CUTOFF / tau)
        self.calls += 1
        image = render_tiled(p, q, self.frame, radius, tau, _CUTOFF, self.won)
        return (((image - self.target) ** 2).sum() / self.radius_px**2).to(points.dtype)

    def iou(self, points: NDArray[np.float64]) -> float:
        """IoU of the hard silhouette of the tube about these points (N, 3) with the target's."""
        return iou_of(points, self.rings, self.frame, self.target, self.limits.radius)


def iou_of(
    points: NDArray[np.float64], rings: Rings, frame: Frame, target: Tensor, radius: float
) -> float:
    """IoU of the tube's hard silhouette with the target's, both at half coverage."""
    p = torch.as_tensor(points, dtype=target.dtype, device=target.device)
    q = p[torch.as_tensor(rings.next, device=target.device)]
    with torch.no_grad():
        seen = render_tiled(p, q, frame, radius, 10.0, 5.0) > 0.5
    wanted = target > 0.5
    union = (seen | wanted).sum()
    return float((seen & wanted).sum() / union) if union > 0 else 1.0
