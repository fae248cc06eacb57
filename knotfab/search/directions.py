"""Search for the azimuths of several views along with the knots.

Neural Shadow Art (Wang and Deng 2024) turns lights and screens along with its volume by back-propagation. A
view that turns about the vertical sees the same as if the knots turned the other way. So the derivative of
its image term by the azimuth is a torque of the gradient by the vertices, which the flow computes anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from knotfab.base.arrays import Array
from knotfab.geometry.measures import Neighbours
from knotfab.problem import Problem, TargetView, ViewNumbers
from knotfab.render.image import frame_at
from knotfab.scene.camera import least_apart
from knotfab.search.objective import Objective
from knotfab.search.optimizer import Adam
from knotfab_formats.search import SearchSettings

MOST_TURN_DEG = 12.0  # largest turn of a view from where it starts, to each side
NEAREST = 0.7  # least angle between lines of sight, over the least one at the start
_EVERY = 4  # iterations of the flow per step of the directions
_RATE_DEG, _LAST = 0.5, 0.05  # first step, and the last one as a share of it
_KEPT, _SQUARES = 0.8, 0.95  # Adam's betas


class FreeDirections:
    """The azimuths of all views but the first, degrees, which Adam moves to reduce the pictures' errors."""

    def __init__(
        self, views: Sequence[TargetView], radius: float, settings: SearchSettings
    ) -> None:
        self.radius_mm = radius
        self.first_deg = np.array([v.view.azimuth_deg for v in views])
        self.azimuth_deg = self.first_deg.copy()
        self._settings, self._asked = settings, 0
        self._turned = torch.zeros(len(views), dtype=torch.float64, requires_grad=True)
        self._adam = Adam([self._turned], betas=(_KEPT, _SQUARES))
        self._apart = NEAREST * least_apart([v.view for v in views])

    def keep(self, points: Array) -> None:
        """Do nothing, for the bounds on directions do not depend on the points."""

    def show(self, objective: Objective, problem: Problem) -> None:
        """Give the objective the images of the views from the present directions."""
        objective.images = tuple(
            image.from_frame(frame_at(view.view, image.sheet, self._settings.precision))
            for image, view in zip(objective.images, self._views(problem), strict=True)
        )

    def descend(
        self,
        objective: Objective,
        problem: Problem,
        points: Array,
        near: Neighbours,
        progress: float,
    ) -> None:
        """Turn the views one step down the objective at vertices (N, 3), on every few calls."""
        self._asked += 1
        if self._asked % _EVERY:
            return
        slopes = np.zeros(len(self.azimuth_deg))
        for number in range(1, len(slopes)):
            slopes[number] = self.slope(objective, number, points, progress)
        self._turned.grad = torch.from_numpy(slopes)
        self._adam.step(_RATE_DEG * _LAST**progress)
        moved = self.first_deg + self._turned.detach().numpy()
        moved = np.clip(moved, self.first_deg - MOST_TURN_DEG, self.first_deg + MOST_TURN_DEG)
        before, self.azimuth_deg = self.azimuth_deg, moved
        if least_apart([v.view for v in self._views(problem)]) >= self._apart:
            self.show(objective, problem)
        else:
            self.azimuth_deg = before
        with torch.no_grad():
            self._turned.copy_(torch.from_numpy(self.azimuth_deg - self.first_deg))

    def slope(self, objective: Objective, number: int, points: Array, progress: float) -> float:
        """Return the derivative of a view's image term by its azimuth, per degree."""
        tau = objective.tau_px(number, progress)
        pull = objective.image_term(number, points, tau)[1]
        # a rotation about y moves a point by (z, 0, -x); turning the view does the opposite
        torque = float((pull[:, 2] * points[:, 0] - pull[:, 0] * points[:, 2]).sum())
        return float(np.radians(torque))

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers | None]:
        """Turn the problem's views to the directions found, rounded as in a scene file."""
        self.azimuth_deg = np.round(self.azimuth_deg, 3)
        return replace(problem, views=self._views(problem)), points, None

    def _views(self, problem: Problem) -> tuple[TargetView, ...]:
        return tuple(
            replace(v, view=v.view.but(azimuth_deg=float(a)))
            for v, a in zip(problem.views, self.azimuth_deg, strict=True)
        )
