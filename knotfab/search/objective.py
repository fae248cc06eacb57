"""The objective of a search: the pictures of all views, the limits that can be felt, more terms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Felt, Guard, Limits, State, weigh
from knotfab.render.frame import Frame
from knotfab.render.picture import ViewImage

__all__ = ["SHARPEST", "Objective", "Term", "Weights", "add_limits"]

# tau per px: beyond, a pixel's middle sees too little of the outline that crosses it
SHARPEST = 5.0


@dataclass(frozen=True)
class Weights:
    """Weights of the terms; each term is in squared tube radii or a count of radii of curve."""

    image: float = 1.0
    clearance: float = 1.0
    bend: float = 0.1
    region: float = 10.0
    length: float = 1.0
    hold: float = 4.0  # the weight of an anchor to another frame of a sequence
    grace: float = 1.0  # times the setting of that name


class Term:
    """One more part of an objective. A subclass may also be a hard limit: `kept` is then asked at the end."""

    def __call__(self, state: State, weights: Weights) -> Felt:
        """Return a number, in the units of the other terms, and its gradient (N, 3) in the vertices.

        `state` holds the walk's own arrays, which are not to be changed.
        """
        raise NotImplementedError

    def kept(self, points: Array) -> bool:
        """Tell whether vertices (N, 3), mm, keep it."""
        return True


@dataclass
class Objective:
    """Callable loss: (points (N, 3), near, progress) -> (number, gradient (N, 3)), without side effects.

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
    # for each view, as `ViewImage` finds it: which capsule colours which pixel
    won: list[Any] = field(init=False)
    _turn: Array | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.shares = np.ones(len(self.images))
        self.won = [None] * len(self.images)

    def __call__(self, points: Array, near: Neighbours, progress: float) -> Felt:
        felt: list[tuple[float, Felt]] = []
        if self.weights.image > 0:
            for number, share in enumerate(self.shares.tolist()):
                seen = self.image_term(number, points, self.tau_px(number, progress))
                felt.append((self.weights.image * share, seen))
        state = State.at(points, self.rings, near)
        if self._turn is None:
            held = add_limits(state, self.limits, self.guards, self.weights)
        else:
            held = self.limit_terms(points, near, self.limits, self.weights, self._turn)
        felt += [(1.0, held), *((1.0, term(state, self.weights)) for term in self.terms)]
        total, slope = weigh(felt, points)
        if self.loose is not None:
            slope[~self.loose] = 0.0
        return total, slope

    def tau_px(self, number: int, progress: float) -> float:
        """Return sharpness of a view's image, per px, where a share `progress` of the phase is done."""
        start, end = self.tau
        sharp = start * (end / start) ** progress / self.images[number].radius_px
        return float(min(sharp, SHARPEST))

    def image_term(self, number: int, points: Array, tau: float) -> Felt:
        """Integrate the squared difference of a view's images, in squared projected radii; tau per px."""
        image = self.images[number]
        error, slope = image.squared_error(
            points, self.rings, self.limits.radius, tau, self.won[number]
        )
        scale = 1.0 / image.radius_px**2
        return scale * error, scale * slope

    def limit_terms(
        self,
        points: Array,
        near: Neighbours,
        limits: Limits,
        weights: Weights,
        turn: Array,
    ) -> Felt:
        """Return the weighted terms of all limits that can be felt, in the axes of `turn` (3, 3)."""
        state = State.at(points @ turn, self.rings, near)
        total, slope = add_limits(state, limits, self.guards, weights)
        return total, slope @ turn.T

    def find_winners(self, points: Array, progress: float) -> None:
        """Find each pixel's winning capsule anew; until the next call others do not colour it."""
        if self.weights.image == 0:
            return
        for number, image in enumerate(self.images):
            tau = self.tau_px(number, progress)
            self.won[number] = image.find_winners(points, self.rings, self.limits.radius, tau)

    def look_from(self, frame: Frame, limits: Limits, turn: Array) -> None:
        """See the one view from another pose: its frame, the limits there, and its axes (3, 3) as columns."""
        self.images = (self.images[0].from_frame(frame),)
        self.limits, self._turn = limits, turn

    def ious(self, points: Array) -> tuple[float, ...]:
        """Return the hard silhouettes' IoU with the target, view by view."""
        return tuple(i.iou(points, self.rings, self.limits.radius) for i in self.images)


def add_limits(state: State, limits: Limits, guards: dict[str, Guard], weights: Weights) -> Felt:
    """Return the weighted sum of the terms of all limits that can be felt; calls and seconds are counted."""
    found = ((getattr(weights, name), guard.term(state, limits)) for name, guard in guards.items())
    return weigh(((weight, felt) for weight, felt in found if felt is not None), state.points)
