"""A far-sighted pull for curves that are nowhere near their pictures: nearest points, both ways.

Each vertex's shadow is drawn to the silhouette's nearest pixel, and each of the silhouette's
samples draws the nearest shadow of a vertex (the chamfer distance, Barrow et al. 1977, squared).
The rendered image only pulls within a few tube radii; this reaches across the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree
from torch import Tensor

from knotfab.geometry.neighbours import Neighbours
from knotfab.scene.camera import camera_of
from knotfab.scene.model import View
from knotfab.search.objective import Objective

__all__ = ["TENSION", "Chamfer", "chamfer_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SAMPLES = 700  # of each silhouette
TENSION = 3.0


@dataclass(frozen=True)
class _Side:
    """One view: its projection (3, 4) to mm on the receiver, and samples (k, 2) there, with their tree."""

    projection: Tensor
    samples: Array
    tree: cKDTree


@dataclass(frozen=True)
class Chamfer:
    """Callable loss for the flow: (points [N, 3], near, progress) -> scalar, in squared tube radii.

    `limits` is an objective whose picture weighs nothing: it adds clearance, bend and region.
    """

    sides: tuple[_Side, ...]
    limits: Objective
    radius: float

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor:
        edge = points[self.limits.following] - points
        spacing = edge.detach().norm(dim=-1).mean()
        # tension: what is pulled from many sides at once would crumple
        loss: Tensor = self.limits(points, near, progress)
        loss = loss + TENSION * (edge * edge).sum() / (spacing * self.radius)
        for side in self.sides:
            h = points @ side.projection[:, :3].T + side.projection[:, 3]
            seen = h[:, :2] / h[:, 2:]
            flat = seen.detach().cpu().numpy()
            _, to = side.tree.query(flat)
            _, of = cKDTree(flat).query(side.samples)
            goal = torch.as_tensor(side.samples[to], device=points.device)
            pull = torch.as_tensor(side.samples, device=points.device)
            loss = loss + ((seen - goal) ** 2).sum(-1).mean() / self.radius**2 * len(points)
            loss = loss + ((seen[of] - pull) ** 2).sum(-1).mean() / self.radius**2 * len(points)
        return loss


def chamfer_of(
    shots: Sequence[tuple[View, Mask]], limits: Objective, radius: float, device: str = "cpu"
) -> Chamfer:
    """The chamfer objective of views with their silhouettes, thinned by a tube radius where they can be."""
    sides = []
    for view, mask in shots:
        height, width = mask.shape
        camera = camera_of(view, width, height)
        pixel = float(np.linalg.norm(camera.du))
        cells = max(0, round(0.8 * radius * view.magnification / pixel))
        inner = binary_erosion(mask, iterations=cells) if cells else mask
        at = np.argwhere(inner if inner.sum() > 0.02 * mask.sum() else mask)
        at = at[np.linspace(0, len(at) - 1, min(_SAMPLES, len(at))).astype(int)]
        samples = pixel * at[:, ::-1].astype(np.float64)
        scale = np.diag([pixel, pixel, 1.0])
        projection = torch.as_tensor(scale @ camera.projection, device=device)
        sides.append(_Side(projection, samples, cKDTree(samples)))
    return Chamfer(tuple(sides), limits, radius)
