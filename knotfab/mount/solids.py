"""Round solids moved to where they belong, and members between two points, ready to be united."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab.arrays import Array
from knotfab.geometry.meshes import as_manifold
from knotfab.mount.modeller import model
from knotfab_fixtures.peg import peg

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["place_along", "strut_solid"]


def place_along(
    solid: Manifold, axis: Array, point: Array, helper: Array | None = None
) -> Manifold:
    """A solid moved to a point (3,), its z turned to the unit vector `axis`.

    Args:
        helper: (3,) not along the axis; the solid's x comes to lie square to both.
    """
    beside = np.eye(3)[np.abs(axis).argmin()] if helper is None else helper
    across = np.cross(beside, axis)
    across /= np.linalg.norm(across)
    return solid.transform(np.column_stack([across, np.cross(axis, across), axis, point]))


def strut_solid(start: Array, end: Array, radius_mm: float) -> Manifold:
    """A round bar between two points (3,) mm."""
    length = float(np.linalg.norm(start - end))
    bar = as_manifold(model(peg, length, radius_mm, radius_mm))
    return place_along(bar, (start - end) / length, end)
