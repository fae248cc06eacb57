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
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree
from torch import Tensor

from knotfab.arrays import Array
from knotfab.limits.base import State
from knotfab.problem import TargetView
from knotfab.scene.camera import camera_of
from knotfab.search.objective import Term, Weights

__all__ = ["TENSION", "Chamfer"]


_SAMPLES = 700  # of each silhouette
TENSION = 3.0


@dataclass(frozen=True)
class _Side:
    """One view: its projection (3, 4) to mm on the receiver, and samples (k, 2) there, with their tree."""

    projection: Tensor
    samples: Array
    tree: cKDTree


@dataclass(frozen=True)
class Chamfer(Term):
    """Mean squared distances, both ways, of every view, in squared tube radii; and some tension."""

    sides: tuple[_Side, ...]
    radius: float

    @classmethod
    def of(cls, views: Sequence[TargetView], radius: float, device: str = "cpu") -> Chamfer:
        """The term of all views, their silhouettes thinned by a tube radius where they can be."""
        sides = []
        for target in views:
            height, width = target.mask.shape
            camera = camera_of(target.view, width, height)
            pixel = float(np.linalg.norm(camera.du))
            cells = max(0, round(0.8 * radius * target.view.magnification / pixel))
            inner = binary_erosion(target.mask, iterations=cells) if cells else target.mask
            at = np.argwhere(inner if inner.sum() > 0.02 * target.mask.sum() else target.mask)
            at = at[np.linspace(0, len(at) - 1, min(_SAMPLES, len(at))).astype(int)]
            samples = pixel * at[:, ::-1].astype(np.float64)
            scale = np.diag([pixel, pixel, 1.0])
            projection = torch.as_tensor(scale @ camera.projection, device=device)
            sides.append(_Side(projection, samples, cKDTree(samples)))
        return cls(tuple(sides), radius)

    def __call__(self, state: State, weights: Weights) -> Tensor:
        points = state.points
        # tension: what is pulled from many sides at once would crumple
        square = (state.edge * state.edge).sum()
        loss: Tensor = TENSION * square / (state.spacing * self.radius)
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
