"""The view that knots which are known were seen from: the pose alone is unknown (the paper, section 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import Polylines
from knotfab.picture.silhouette import signed_distance
from knotfab.problem import ViewNumbers
from knotfab.render.device import render
from knotfab.render.image import CUTOFF
from knotfab.render.silhouette import Sheet
from knotfab.search.free_pose import ALL, Bounds, FreePose

__all__ = ["Fit", "fit_view"]


@dataclass(frozen=True)
class Fit:
    """The view found for knots that are known: its numbers, and the loss at each iteration."""

    numbers: ViewNumbers
    losses: tuple[float, ...]


def fit_view(
    points: Array,
    rings: Polylines,
    sheet: Sheet,
    target: Tensor,
    start: ViewNumbers,
    bounds: Bounds,
    iterations: int = 120,
    tau: tuple[float, float] = (0.3, 12.0),
) -> Fit:
    """Return the view from which knots at `points` (N, 3), mm, look like `target` [height, width].

    Squared difference of sigmoid(tau * signed distance) of tube and target. tau grows from its first
    value to its second, in units of one over the projected tube radius: soft at first, so that a pose
    far off still feels the picture.
    """
    pose = FreePose(start, bounds)
    pose.keep(points)
    p = torch.as_tensor(points, dtype=target.dtype)
    q = p[torch.as_tensor(rings.next)]
    distance = torch.as_tensor(signed_distance(target.numpy() > 0.5), dtype=target.dtype)
    losses = []
    for iteration in range(iterations):
        progress = iteration / max(1, iterations - 1)
        sharpness = tau[0] * (tau[1] / tau[0]) ** progress / _projected_radius(start, sheet)
        image = _render(pose, sheet, p, q, sharpness)
        loss = ((image - torch.sigmoid(sharpness * distance)) ** 2).mean()
        turn, logs = torch.autograd.grad(loss, pose.tensors)
        losses.append(float(loss.detach()))
        pose.move((turn, logs), points, progress)
    losses.append(_polish(pose, points, rings, sheet, distance.double(), sharpness))
    return Fit(pose.numbers(), tuple(losses))


def _render(pose: FreePose, sheet: Sheet, starts: Tensor, ends: Tensor, tau: float) -> Tensor:
    """Render [height, width] the tube about segments [n, 3] at the present pose, with gradient."""
    frame, radius = pose.frame(sheet, starts.dtype), pose.lengths[2].to(starts.dtype)
    return render(starts, ends, frame, radius, tau, CUTOFF)


def _polish(
    pose: FreePose,
    points: Array,
    rings: Polylines,
    sheet: Sheet,
    distance: Tensor,
    sharpness: float,
) -> float:
    """Fit by least squares from where Adam ended, in double precision; return the loss.

    Distance and size of a piece that is not deep change its shadow in nearly the same way: along
    that valley first-order steps hardly move.
    """
    free = [number for number, name in enumerate(ALL) if name in pose.bounds.free]
    p = torch.as_tensor(points)
    q = p[torch.as_tensor(rings.next)]
    target = torch.sigmoid(sharpness * distance)
    scale = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])  # degrees, and shares of lengths
    both = torch.cat(pose.tensors).detach()

    def residual(x: Array) -> Array:
        moved = both.clone()
        moved[free] += torch.as_tensor(x * scale[free])
        with torch.no_grad():
            pose.turn_deg.copy_(moved[:3])
            pose.logs.copy_(moved[3:])
            image = _render(pose, sheet, p, q, sharpness)
        return np.asarray((image - target).numpy().ravel())

    found = least_squares(
        residual, np.zeros(len(free)), method="lm", diff_step=1e-4, x_scale=1.0, max_nfev=150
    )
    residual(found.x)
    pose.keep(points)
    return float(2 * found.cost / target.numel())


def _projected_radius(numbers: ViewNumbers, sheet: Sheet) -> float:
    """Return the tube's radius at the middle of the piece, in pixels on the receiver."""
    share = 1.0 + numbers.wall_distance_mm / numbers.light_distance_mm
    return numbers.radius_mm * share / sheet.pixel_mm
