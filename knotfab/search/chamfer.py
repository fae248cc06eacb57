"""A far-sighted pull for curves that are nowhere near their pictures: nearest points, both ways.

Each vertex's shadow is drawn to the silhouette's nearest pixel, and each of the silhouette's
samples draws the nearest shadow of a vertex (the chamfer distance, Barrow et al. 1977, squared).
The rendered image only pulls within a few tube radii; this reaches across the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.geometry.projection import project
from knotfab.limits.base import Felt, State, follow_edges
from knotfab.problem import TargetView
from knotfab.scene.camera import camera_of
from knotfab.search.objective import Term, Weights

__all__ = ["TENSION", "Chamfer"]


_SAMPLES = 700  # samples of each silhouette
TENSION = 3.0


@dataclass(frozen=True)
class _Side:
    """One view: its projection (3, 4) to mm on the receiver, and samples (k, 2) there, with their tree."""

    projection: Array
    samples: Array
    tree: cKDTree


@dataclass(frozen=True)
class Chamfer(Term):
    """Mean squared distances, both ways, of every view, in squared tube radii; and some tension."""

    sides: tuple[_Side, ...]
    radius: float

    @classmethod
    def of(cls, views: Sequence[TargetView], radius: float) -> Chamfer:
        """Return the term of all views, their silhouettes thinned by a tube radius where they can be."""
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
            sides.append(_Side(scale @ camera.projection, samples, cKDTree(samples)))
        return cls(tuple(sides), radius)

    def __call__(self, state: State, weights: Weights) -> Felt:
        points, edge = state.points, state.edge
        # tension: what is pulled from many sides at once would crumple
        taut = TENSION / (state.spacing * self.radius)
        total = taut * float((edge * edge).sum())
        slope = follow_edges(2.0 * taut * edge, state.rings)
        scale = 1.0 / self.radius**2
        for side in self.sides:
            seen = project(points, side.projection)
            _, to = side.tree.query(seen.places)
            _, of = cKDTree(seen.places).query(side.samples)
            here, there = seen.places - side.samples[to], seen.places[of] - side.samples
            more = scale * len(points) / len(side.samples)
            total += scale * float((here * here).sum()) + more * float((there * there).sum())
            pull = 2.0 * scale * here
            np.add.at(pull, of, 2.0 * more * there)
            slope += seen.pull(pull)
        return total, slope
