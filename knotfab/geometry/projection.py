"""Project points, and turn gradients in their images into gradients in the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array

__all__ = ["Seen", "project"]


@dataclass(frozen=True)
class Seen:
    """Points seen at `places` (N, 2) through `matrix` (3, 4), w being `depth` (N,)."""

    places: Array
    depth: Array
    matrix: Array

    def pull(self, slope: Array) -> Array:
        """Return a gradient (N, 2) in the places as one (N, 3) in the points."""
        aside = slope / self.depth[:, None]
        along = (aside * self.places).sum(axis=1)
        return np.asarray(aside @ self.matrix[:2, :3] - np.outer(along, self.matrix[2, :3]))


def project(points: Array, matrix: Array) -> Seen:
    """Return points (N, 3) through (u w, v w, w) = matrix (x, y, z, 1)."""
    h = points @ matrix[:, :3].T + matrix[:, 3]
    return Seen(h[:, :2] / h[:, 2:], h[:, 2], matrix)
