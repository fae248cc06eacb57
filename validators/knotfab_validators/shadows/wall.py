"""Measure how much it matters to a picture that its wall is round."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import RoundWall
from knotfab_validators.shadows.frame import LONGER_SIDE
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.scene import Switches

__all__ = ["find_wall", "receive"]

# a wall that puts the picture less far from a flat one's place is taken as flat
WALL_TOLERANCES = 1.0
PLACES = 129  # across and up the frame


def find_wall(geometry: ViewGeometry) -> RoundWall | None:
    """Find how far a flat wall would put the picture off its places on the round one; None of a flat one."""
    if geometry.cylinder is None:
        return None
    ends = (np.linspace(-0.5, n - 0.5, PLACES) for n in (geometry.width, geometry.height))
    u, v = np.meshgrid(*ends)
    pixels = np.column_stack([u.ravel(), v.ravel()])
    off = geometry.flat.project(geometry.on_receiver(pixels))[0] - pixels
    share = LONGER_SIDE / max(geometry.width, geometry.height)
    most = share * float(np.linalg.norm(off, axis=1).max())
    return RoundWall(radius_mm=geometry.cylinder.radius, off_px=most, samples=1)


def receive(
    geometry: ViewGeometry, effects: Switches, tolerance_px: float = 0.25
) -> tuple[ViewGeometry, RoundWall | None]:
    """Return the view on the wall that its shadows are cast on, and what `find_wall` says of that.

    A round wall is taken as flat where the scene says so, or a flat one is not off by a tolerance.
    """
    wall = find_wall(geometry)
    if wall is None:
        return geometry, None
    bends = bool(effects.wall)
    if effects.wall is None:
        bends = wall.off_px > WALL_TOLERANCES * tolerance_px
    return (geometry, wall) if bends else (geometry.flat, None)
