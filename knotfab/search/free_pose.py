"""Search for unknowns of the views along with the knots.

For one view they are its rotation, light and wall distances, and the tube's radius, which the paper
leaves as future work (section 7). The certified flow moves the vertices, and Adam the view's numbers, by
the same objective; bounds keep the light in front of the piece and the wall behind it.

For several views they are the azimuths and elevations. Neural Shadow Art (Wang and Deng 2024) turns
lights and screens along with its volume by back-propagation. A view that turns sees the same as if the
knots turned the other way. So the derivative of its image term by an angle is a torque of the gradient by
the vertices, which the flow computes anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.geometry.measures import Neighbours
from knotfab.limits.terms import Felt
from knotfab.problem import Problem, TargetView, ViewNumbers
from knotfab.render.capsules import posed_frame, turn_matrix
from knotfab.render.device import known, squared_error
from knotfab.render.image import CUTOFF, frame_at
from knotfab.render.silhouette import Frame, Sheet
from knotfab.scene.camera import least_apart, view_axes
from knotfab.search.flow import SETTLE
from knotfab.search.objective import Objective
from knotfab.search.optimizer import Adam, one_thread
from knotfab_formats.errors import InputError
from knotfab_formats.scene import LIGHT_SHARE, WALL_SHARE
from knotfab_formats.search import SearchSettings
from knotfab_formats.views import View

Name = Literal["azimuth", "elevation", "roll", "light", "wall", "radius"]

ALL: tuple[Name, ...] = ("azimuth", "elevation", "roll", "light", "wall", "radius")
_TURN_RATE = 0.4  # first step of an angle, degrees
_LENGTH_RATE = 0.008  # first step of a length, relative
_LAST = 0.05  # last step over the first
_SHARP = 12.0  # sharpness of the picture that the pose is fitted to: tau times the projected radius
_CHANGE = 1e-4  # relative change of the radius for the finite difference of the limits

MOST_TURN_DEG = 12.0  # largest turn of a view from where it starts, to each side
NEAREST = 0.7  # least angle between lines of sight, over the least one at the start
_EVERY = 4  # iterations of the flow per step of the directions
_DIRECTION_RATE = 0.5  # first step of an azimuth or elevation, degrees
_KEPT, _SQUARES = 0.8, 0.95  # Adam's betas


@dataclass(frozen=True)
class Bounds:
    """Bounds of the pose, and the names of its free numbers."""

    free: tuple[Name, ...] = ALL
    turn_deg: float = 45.0  # largest change of an angle, to each side
    light: tuple[float, float] = (0.5, 2.0)  # as shares of the start's
    wall: tuple[float, float] = (0.5, 1.5)
    least_radius_mm: float = 0.8  # the printer's thinnest
    most_radius_mm: float = float("inf")

    def __post_init__(self) -> None:
        for name in self.free:
            if name not in ALL:
                raise InputError(
                    f"the free number {name!r}",
                    "a view has no such number",
                    f"Use: {', '.join(ALL)}.",
                )
        if self.least_radius_mm > self.most_radius_mm:
            raise InputError(
                "the bounds of the tube radius",
                f"{self.least_radius_mm:g} mm is above {self.most_radius_mm:g} mm",
                "Exchange them.",
            )


def turn_of(numbers: ViewNumbers) -> Array:
    """Return the rotation (3, 3) whose columns are the view's axes, so `points @ turn` are in view axes."""
    turn = torch.tensor([numbers.azimuth_deg, numbers.elevation_deg, numbers.roll_deg]).double()
    return np.asarray(turn_matrix(turn).numpy())


class FreePose:
    """The numbers of a view that Adam moves: angles in degrees, and logarithms of relative lengths."""

    def __init__(
        self, start: ViewNumbers, bounds: Bounds, dtype: torch.dtype = torch.float64
    ) -> None:
        if not bounds.least_radius_mm <= start.radius_mm <= bounds.most_radius_mm:
            raise InputError(
                "the tube radius",
                f"{start.radius_mm:g} mm is outside its bounds, {bounds.least_radius_mm:g} to "
                f"{bounds.most_radius_mm:g} mm",
                "Start between them.",
            )
        self.start, self.bounds = start, bounds
        turn = [start.azimuth_deg, start.elevation_deg, start.roll_deg]
        self.turn_deg = torch.tensor(turn, dtype=dtype, requires_grad=True)
        # of light, wall and radius
        self.logs = torch.zeros(3, dtype=dtype, requires_grad=True)
        lengths = [start.light_distance_mm, start.wall_distance_mm, start.radius_mm]
        self._first_mm = torch.tensor(lengths, dtype=dtype)
        self._first_turn = self.turn_deg.detach().clone()
        self._mask = [torch.tensor([n in bounds.free for n in part]) for part in (ALL[:3], ALL[3:])]
        self._adam = Adam(self.tensors, betas=(0.8, 0.95))
        self._of: object = None  # the picture that `_target` was made from

    @property
    def tensors(self) -> tuple[Tensor, Tensor]:
        """The tensors to differentiate by."""
        return self.turn_deg, self.logs

    @property
    def lengths(self) -> Tensor:
        """Light distance, wall distance and radius, [3] mm, with gradient.

        A free wall moves along with the light, which keeps the shadow's size. So size and perspective have
        one unknown each.
        """
        light, wall, radius = self.logs
        along = light + wall if "wall" in self.bounds.free else wall
        return self._first_mm * torch.stack([light, along, radius]).exp()

    @property
    def radius_mm(self) -> float:
        """The present radius of the tube."""
        return float(self.lengths[2].detach())

    def frame(self, sheet: Sheet, dtype: torch.dtype) -> Frame:
        """Return the sheet's frame for the present numbers, with gradient."""
        light, wall, _ = self.lengths.to(dtype)
        return posed_frame(sheet, self.turn_deg.to(dtype), light, wall)

    def numbers(self) -> ViewNumbers:
        """Return the present numbers."""
        light, wall, radius = self.lengths.detach().tolist()
        return ViewNumbers(light, wall, radius, *self.turn_deg.detach().tolist())

    def move(self, gradients: tuple[Tensor, Tensor], points: Array, progress: float) -> None:
        """Take one step of Adam by the `gradients` of `tensors`, and return into the bounds."""
        share = _LAST**progress
        for tensor, mask, gradient in zip(self.tensors, self._mask, gradients, strict=True):
            tensor.grad = torch.where(mask, gradient, 0.0)
        self._adam.step((_TURN_RATE * share, _LENGTH_RATE * share))
        self.keep(points)

    def keep(self, points: Array) -> None:
        """Clamp the numbers: the light before the points (N, 3), the wall behind, the radius printable."""
        b, s = self.bounds, self.start
        with torch.no_grad():
            self.turn_deg.clamp_(self._first_turn - b.turn_deg, self._first_turn + b.turn_deg)
            radius = float(np.clip(self.radius_mm, b.least_radius_mm, b.most_radius_mm))
            depth = points @ turn_of(self.numbers())[:, 2]
            front, back = float(depth.max()) + radius, radius - float(depth.min())
            light, wall, _ = self.lengths.tolist()
            near, far = (share * s.light_distance_mm for share in b.light)
            light = float(np.clip(light, near, far))
            near, far = (share * s.wall_distance_mm for share in b.wall)
            wall = float(np.clip(wall, near, far))
            # a number that is not free stays where the scene has it
            light = max(light, front / LIGHT_SHARE) if "light" in b.free else s.light_distance_mm
            wall = max(wall, back / WALL_SHARE) if "wall" in b.free else s.wall_distance_mm
            kept = self.logs.new_tensor([light, wall, radius]) / self._first_mm
            self.logs.copy_(kept.log())
            if "wall" in b.free:
                self.logs[1] -= self.logs[0]

    @one_thread()
    def descend(
        self,
        objective: Objective,
        problem: Problem,
        points: Array,
        near: Neighbours,
        progress: float,
    ) -> None:
        """Take one step down the objective at vertices (N, 3), and show the objective the new pose.

        A soft picture shows touching strands as a dark seam and so rewards a thicker tube. So the pose is
        fitted to a sharp picture, and to the limits with the weights of the last phase.
        """
        seen, radius = self.picture_term(objective, points), self.radius_mm
        turn_of = turn_matrix(self.turn_deg)
        turn = turn_of.detach().cpu().numpy()

        def limits_at(radius: float) -> Felt:
            limits = problem.limits(radius)
            return objective.limit_terms(points, near, limits, SETTLE, turn)

        value, slope = limits_at(radius)
        limits = known(value, (turn_of, points.T @ (slope @ turn)))
        turned, logs = torch.autograd.grad(seen + limits, self.tensors)
        change = limits_at(radius * (1 + _CHANGE))[0] - limits_at(radius * (1 - _CHANGE))[0]
        steeper = logs.new_tensor([0.0, 0.0, change / (2 * _CHANGE)])
        self.move((turned, logs + steeper), points, progress)
        self.show(objective, problem)

    def picture_term(self, objective: Objective, points: Array) -> Tensor:
        """Return the sharp image term of the one view at vertices (N, 3), differentiable by `tensors`."""
        image = objective.images[0]
        if self._of is not image.target:
            target = torch.as_tensor(image.target)
            target = target if image.renderer == "ray" else target.double()
            self._of, self._target = image.target, target
        target = self._target
        won = objective.won[0]
        p = torch.as_tensor(points, dtype=target.dtype)
        if won is not None:
            won = tuple(torch.as_tensor(x).long() for x in won)
        error = squared_error(
            p,
            p[torch.as_tensor(objective.rings.next)],
            self.frame(image.sheet, target.dtype),
            self.lengths[2].to(target.dtype),
            _SHARP / image.radius_px,
            target,
            CUTOFF,
            won,
        )
        return (error / image.radius_px**2).to(self.logs.dtype)

    def show(self, objective: Objective, problem: Problem) -> None:
        """Show the objective the image of its view from the present pose."""
        image = objective.images[0]
        frame = self.frame(image.sheet, torch.float32).arrays()
        turn = turn_matrix(self.turn_deg.detach()).cpu().numpy()
        objective.look_from(frame, problem.limits(self.radius_mm), turn)

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers]:
        """Enter the pose in the problem's view, its lengths rounded as in a scene file.

        The points (N, 3) are turned into the view's axes, since a scene with one view looks along z.
        """
        n = self.numbers()
        numbers = ViewNumbers(
            round(n.light_distance_mm, 2),
            round(n.wall_distance_mm, 2),
            round(n.radius_mm, 4),
            n.azimuth_deg,
            n.elevation_deg,
            n.roll_deg,
        )
        lengths = {
            "light_distance_mm": numbers.light_distance_mm,
            "wall_distance_mm": numbers.wall_distance_mm,
        }
        one = problem.views[0]
        view = replace(one, view=one.view.but(**lengths))
        return replace(problem, views=(view,)), points @ turn_of(numbers), numbers


class FreeDirections:
    """The directions of all views but the first, which Adam moves to reduce the pictures' errors.

    `places_deg` (n, 2) are azimuths and elevations. Elevations stay where the settings give no starts.
    """

    def __init__(
        self, views: Sequence[TargetView], radius: float, settings: SearchSettings
    ) -> None:
        self.radius_mm = radius
        self.first_deg = np.array([(v.view.azimuth_deg, v.view.elevation_deg) for v in views])
        self.places_deg = self.first_deg.copy()
        self._settings, self._asked = settings, 0
        self._free = np.array([1.0, 1.0 if settings.free_elevations_deg else 0.0])
        self._turned = torch.zeros(self.first_deg.shape, dtype=torch.float64, requires_grad=True)
        self._adam = Adam([self._turned], betas=(_KEPT, _SQUARES))
        self._apart = NEAREST * least_apart([v.view for v in views])

    def keep(self, points: Array) -> None:
        """Do nothing, since the bounds on directions do not depend on the points."""

    def show(self, objective: Objective, problem: Problem) -> None:
        """Show the objective the images of the views from the present directions."""
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
        slopes = np.zeros(self.places_deg.shape)
        for number in range(1, len(slopes)):
            view = self._views(problem)[number].view
            slopes[number] = self._free * self.slope(objective, number, view, points, progress)
        self._turned.grad = torch.from_numpy(slopes)
        self._adam.step(_DIRECTION_RATE * _LAST**progress)
        moved = self.first_deg + self._turned.detach().numpy()
        moved = np.clip(moved, self.first_deg - MOST_TURN_DEG, self.first_deg + MOST_TURN_DEG)
        moved[:, 1] = np.clip(moved[:, 1], -90.0, 90.0)
        before, self.places_deg = self.places_deg, moved
        if least_apart([v.view for v in self._views(problem)]) >= self._apart:
            self.show(objective, problem)
        else:
            self.places_deg = before
        with torch.no_grad():
            self._turned.copy_(torch.from_numpy(self.places_deg - self.first_deg))

    def slope(
        self, objective: Objective, number: int, view: View, points: Array, progress: float
    ) -> Array:
        """Return the derivatives of a view's image term by its azimuth and elevation, per degree, (2,)."""
        tau = objective.tau_px(number, progress)
        pull = objective.image_term(number, points, tau)[1]
        torque = np.cross(points, pull).sum(axis=0)
        # turning a view about the vertical, or raising it, turns the knots the other way for it
        by = -torque[1], torque @ view_axes(view)[0]
        return np.asarray(np.radians(by), dtype=np.float64)

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers | None]:
        """Turn the problem's views to the directions found, rounded as in a scene file."""
        self.places_deg = np.round(self.places_deg, 3)
        return replace(problem, views=self._views(problem)), points, None

    def _views(self, problem: Problem) -> tuple[TargetView, ...]:
        return tuple(
            replace(v, view=v.view.but(azimuth_deg=float(a), elevation_deg=float(e)))
            for v, (a, e) in zip(problem.views, self.places_deg, strict=True)
        )
