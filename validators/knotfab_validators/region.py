"""Where the part may be: the tube inside the scene's region, the part inside the printer's volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .check import Check, at_most, skipped
from .read_knots import Curves
from .read_mesh import Mesh
from .read_scene import Pose, Region

__all__ = ["check_build_volume", "check_region", "sticks_out"]

Array = NDArray[np.float64]

BED_TOLERANCE_MM = 1e-3
REGION_TOLERANCE_MM = 1e-6  # what rounding may cost on the way from scene to part and back


def sticks_out(points: Array, region: Region, radius_mm: float = 0.0) -> Array:
    """(n,) how far balls of `radius_mm` about `points` (n, 3) stick out of the region, mm.

    Negative inside. For a box the largest excess over its faces; for a cylinder (axis y) the
    larger one of those over its mantle and its ends. The region's size must be known.
    """
    if region.size_mm is None:
        raise ValueError("the region's size is left open")
    p = points - np.array(region.center_mm)
    half = np.array(region.size_mm) / 2
    if region.kind == "sphere":
        excess = np.linalg.norm(p, axis=1) - half[0]
    elif region.kind == "cylinder":
        around = np.hypot(p[:, 0], p[:, 2]) - half[0]
        excess = np.maximum(around, np.abs(p[:, 1]) - half[1])
    else:
        excess = (np.abs(p) - half).max(axis=1)
    result: Array = excess + radius_mm
    return result


def check_region(
    region: Region, pose: Pose | None, curves: Curves | None, mesh: Mesh | None = None
) -> Check:
    """`region`: the tubes around `curves`, or else the whole `mesh`, stay inside.

    The regions are convex, so that the vertices of centre line or mesh decide.

    Args:
        pose: from the coordinates of curves and mesh to the scene's; None: they are the same.
    """
    if region.size_mm is None:
        return skipped("region", "the scene leaves the region's size open")
    if curves is not None and curves.radius_mm is not None:
        points, radius, what = np.concatenate(curves.polygons), curves.radius_mm, "the tube"
    elif mesh is not None:
        points, radius, what = mesh.vertices, 0.0, "the part"
    else:
        return skipped("region", "neither the part nor the tube's radius is given")
    if pose is not None:
        matrix = np.array(pose)
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
    excess = sticks_out(points, region, radius)
    worst = int(excess.argmax()) if not np.isnan(excess).any() else int(np.isnan(excess).argmax())
    x, y, z = points[worst]
    return at_most(
        "region",
        float(excess[worst]),
        0.0,
        "mm",
        f"how far {what} sticks out of the {region.kind} (negative: inside), nearest to its "
        f"boundary at ({x:.2f}, {y:.2f}, {z:.2f}) mm of the scene",
        tolerance=REGION_TOLERANCE_MM,
    )


def check_build_volume(mesh: Mesh, build_volume_mm: tuple[float, float, float]) -> Check:
    """`build_volume`: the part lies on the bed's positive octant and inside the printer's volume."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    excess = np.maximum(high - np.array(build_volume_mm), -low)
    size = " x ".join(f"{s:.2f}" for s in high - low)
    room = " x ".join(f"{s:g}" for s in build_volume_mm)
    axis = "xyz"[int(excess.argmax())]
    return at_most(
        "build_volume",
        float(excess.max()),
        0.0,
        "mm",
        f"how far the part of {size} mm sticks out of the printer's {room} mm, most along {axis}, "
        "where its corner lies at the origin",
        tolerance=BED_TOLERANCE_MM,
    )
