"""Round members between two points, as solids ready to be united."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab.arrays import Array
from knotfab.geometry.meshes import as_manifold

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["frame_along", "strut_solid"]


def frame_along(axis: Array, helper: Array | None = None) -> Array:
    """(3, 3) a rotation whose third column is the unit vector `axis`.

    Args:
        helper: (3,) not along the axis; the first column is square to both.
    """
    beside = np.eye(3)[np.abs(axis).argmin()] if helper is None else helper
    across = np.cross(beside, axis)
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis])


def strut_solid(start: Array, end: Array, radius_mm: float) -> Manifold:
    """A round bar between two points (3,) mm."""
    from knotfab_fixtures.peg import peg

    length = float(np.linalg.norm(start - end))
    turn = frame_along((start - end) / length)
    bar = as_manifold(peg(length, radius_mm, radius_mm))
    return bar.transform(np.column_stack([turn, end]))
