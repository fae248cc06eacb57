"""The objective of a search: the pictures of all views, the limits that can be felt, more terms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotfab.arrays import Array
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Guard, Limits, State
from knotfab.render.frame import Frame, Number
from knotfab.render.picture import CUTOFF, ViewImage
from knotfab.render.silhouette import Winners, squared_error, winners

__all__ = ["Objective", "Term", "Weights", "add_limits"]


@dataclass(frozen=True)
class Weights:
    """Weights of the terms; each term is in squared tube radii or a count of radii of curve."""

    image: float = 1.0
    clearance: float = 1.0
    bend: float = 0.1
    region: float = 10.0
    length: float = 1.0
    hold: float = 4.0  # of an anchor to another frame of a sequence
    grace: float = 1.0  # times the setting of that name


class Term:
    """One more part of an objective. A subclass may also be a hard limit: `kept` is then asked at the end."""

    def __call__(self, state: State, weights: Weights) -> Tensor:
        """Scalar, in the units of the other terms."""
        raise NotImplementedError

    def kept(self, points: Array) -> bool:
        """Whether vertices (N, 3), mm, keep it."""
        return True


@dataclass
class Objective:
    """Callable loss: (points [N, 3], near, progress) -> scalar, without side effects.

    It sums the pictures of all views, shared out by `shares` (their mean is 1), the limits that can be
    felt, and `terms`. tau grows geometrically from `tau[0]` to `tau[1]`, in units of one over
    the projected tube radius. What changes while a phase runs is changed between calls, by the loop:
    the winning capsules (`find_winners`), the shares, and the pose (`look_from`).
    """

    images: tuple[ViewImage, ...]
    rings: Polylines
    limits: Limits
    guards: dict[str, Guard]
    weights: Weights
    tau: tuple[float, float]
    terms: tuple[Term, ...] = ()
    loose: NDArray[np.bool_] | None = None  # (N,) vertices that may move; None: all
    shares: Array = field(init=False)
    following: Tensor = field(init=False)

    def __post_init__(self) -> None:
        device = self.images[0].target.device
        self.shares = np.ones(len(self.images))
        self.following = torch.as_tensor(self.rings.next, device=device)
        self._loose = None if self.loose is None else torch.as_tensor(self.loose, device=device)
        self._turn: Tensor | None = None
        self._won: list[Winners | None] = [None] * len(self.images)

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor:
        if self._loose is not None:
            points = torch.where(self._loose[:, None], points, points.detach())
        loss = points.new_zeros(())
        if self.weights.image > 0:
            for number, share in enumerate(self.shares.tolist()):
                image = self.image_term(number, points, self._tau(number, progress))
                loss = loss + self.weights.image * share * image
        state = State.at(points, self.following, self.rings, near)
        if self._turn is None:
            loss = loss + add_limits(state, self.limits, self.guards, self.weights)
        else:
            loss = loss + self.limit_terms(points, near, self.limits, self.weights, self._turn)
        for term in self.terms:
            loss = loss + term(state, self.weights)
        return loss

    def _tau(self, number: int, progress: float) -> float:
        start, end = self.tau
        return float(start * (end / start) ** progress / self.images[number].radius_px)

    def image_term(
        self,
        number: int,
        points: Tensor,
        tau: float,
        frame: Frame | None = None,
        radius: Number | None = None,
    ) -> Tensor:
        """Squared difference of a view's images, integrated, in squared projected tube radii.

        Args:
            tau: per pixel. frame, radius: where not those of the view and the limits.
        """
        image = self.images[number]
        p = points.to(image.target.dtype)
        error = squared_error(
            p,
            p[self.following],
            frame or image.frame,
            self.limits.radius if radius is None else radius,
            tau,
            image.target,
            CUTOFF,
            self._won[number],
        )
        return (error / image.radius_px**2).to(points.dtype)

    def limit_terms(
        self,
        points: Tensor,
        near: Neighbours,
        limits: Limits,
        weights: Weights,
        turn: Tensor | None = None,
    ) -> Tensor:
        """The weighted terms of all limits that can be felt, in the axes of `turn` [3, 3]."""
        turned = points if turn is None else points @ turn
        state = State.at(turned, self.following, self.rings, near)
        return add_limits(state, limits, self.guards, weights)

    def find_winners(self, points: Array, progress: float) -> None:
        """Find each pixel's winning capsule anew; until the next call others do not colour it."""
        if self.weights.image == 0:
            return
        for number, image in enumerate(self.images):
            p = torch.as_tensor(points, dtype=image.target.dtype, device=image.target.device)
            reach = CUTOFF / self._tau(number, progress)
            ends = p[self.following]
            self._won[number] = winners(p, ends, image.frame, self.limits.radius, reach)

    def look_from(self, frame: Frame, limits: Limits, turn: Tensor) -> None:
        """See the one view from another pose: its frame, the limits there, and its axes [3, 3] as columns."""
        self.images = (replace(self.images[0], frame=frame),)
        self.limits, self._turn = limits, turn

    def ious(self, points: Array) -> tuple[float, ...]:
        """The hard silhouettes' IoU with the target, view by view."""
        return tuple(i.iou(points, self.rings, self.limits.radius) for i in self.images)


def add_limits(state: State, limits: Limits, guards: dict[str, Guard], weights: Weights) -> Tensor:
    """The weighted sum of the terms of all limits that can be felt; calls and seconds are counted."""
    total = state.points.new_zeros(())
    for name, guard in guards.items():
        term = guard.term(state, limits)
        if term is not None:
            total = total + getattr(weights, name) * term
    return total
