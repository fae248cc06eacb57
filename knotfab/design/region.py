"""Room: the region with its size settled, and how much depth there is in it for a piece of one view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.candidates import DEPTH_RATIO
from knotfab.design.hull import HullBound
from knotfab.limits.region_mesh import region_mesh
from knotfab.scene.camera import view_axes
from knotfab_formats.bounds import MOST_MM
from knotfab_formats.scene import WALL_SHARE, Region, ResolvedView, SettledRegion

__all__ = ["depth_extent", "least_wall_mm", "most_depth_mm", "resolve_region"]


_WIDER = 1.25  # the region's width over the picture's
_BESIDE_RADII = 2.0  # before and behind the centre lines


def resolve_region(
    region: Region, views: Sequence[ResolvedView], bounds: Sequence[HullBound], radius: float
) -> SettledRegion:
    """Return the region with its extents: those of the scene, or what the pictures need.

    Of one view, clear of wall and lamp, a quarter wider than the picture and turned as the view is; of
    several, the visual hull's extents about its middle, with a tube radius (mm) of play.

    Raises:
        InputError: a mesh is unfit. SceneError: it would be larger than any region.
    """
    known = region.model_dump()
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        size = tuple(round(float(s), 4) for s in most - least)
        return SettledRegion(**{**known, "size_mm": size})
    if region.size_mm is not None:
        return SettledRegion(**known)
    if bounds:
        known |= {"azimuth_deg": 0.0, "elevation_deg": 0.0}  # the hull's extents are the scene's
        low = np.min([b.low for b in bounds], 0)
        high = np.max([b.high for b in bounds], 0)
        x, y, z = 2 * (np.maximum(np.abs(low), np.abs(high)) + radius)
        around = {"cylinder": float(np.hypot(x, z)), "sphere": float(np.linalg.norm([x, y, z]))}
    else:
        (view,) = views
        known |= {"azimuth_deg": view.azimuth_deg, "elevation_deg": view.elevation_deg}
        x, y = (_WIDER / view.magnification * side for side in view.frame_mm)
        z = 2.0 * view.reach_mm
        widest = min(max(x, y, z), 1.9 * view.light_distance_mm)
        around = {"cylinder": widest, "sphere": widest}
    size = {
        "box": (x, y, z),
        "cylinder": (around["cylinder"], y, around["cylinder"]),
        "sphere": (around["sphere"],) * 3,
    }[region.kind]
    if max(size) > MOST_MM:
        raise SceneError(
            "the region",
            f"it would be {max(size):.6g} mm large, and the largest is {MOST_MM:g} mm",
            "Make the picture smaller (--size), or give another lamp (--lamp-distance).",
        )
    return SettledRegion(**{**known, "size_mm": tuple(round(float(s), 4) for s in size)})


def depth_extent(
    asked: float | None,
    polygon: MultiPolygon,
    region: SettledRegion,
    radius: float,
    ahead: Sequence[float] = (0.0, 0.0, 1.0),
) -> float | None:
    """Return the extent of the centre lines along the one view's axis in mm, None for a flat piece.

    Args:
        asked: the scene's depth, mm; 0: a flat piece; None: as the pictures need it.
        ahead: that axis, towards the light.

    Raises:
        SceneError: the region has no room for it.
    """
    if asked == 0:
        return None
    low_x, low_y, high_x, high_y = polygon.bounds
    usual = DEPTH_RATIO * (max(high_x - low_x, high_y - low_y) + 2 * radius)
    wanted = asked or usual
    room = most_depth_mm(0.5 * _across(region, np.asarray(ahead)), radius)
    if room <= 0:
        raise SceneError(
            "the region",
            f"a tube {2 * radius:.1f} mm thick has no room between the light and the wall",
            "Move the wall away (--wall-distance, wall_distance_mm), make the picture smaller (--size), or "
            "enlarge the region.",
        )
    if asked is not None and wanted > room + 1e-3:
        raise SceneError(
            "scene key piece.depth",
            f"{wanted:g} mm do not fit a region that is {room:.1f} mm deep for it",
            "Ask for less depth, or enlarge the region and the distance to the wall",
        )
    # an auto depth is rounded down, so that a rebuild from the number finds the same room
    return float(np.floor(min(wanted, room) * 1e4) / 1e4) if asked is None else wanted


def most_depth_mm(reach_mm: float, radius: float) -> float:
    """Return the extent of the centre lines in a region that reaches so far to either side, mm."""
    return 2.0 * (reach_mm - _BESIDE_RADII * radius)


def least_wall_mm(back_mm: float, radius: float) -> float:
    """Return how near a flat wall may be for a region of open size, mm; the light stands far enough.

    Args:
        back_mm: how far the centre lines reach behind the middle, or half of the depth that is asked for.
    """
    return (back_mm + _BESIDE_RADII * radius) / WALL_SHARE


def _across(region: SettledRegion, ahead: Array) -> float:
    """Measure how far a region reaches along a direction (3,), alike to both sides of the middle, mm."""
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        return 2.0 * _chord(np.minimum(most, -least), ahead)
    axes = view_axes(region)
    aside = 2.0 * abs(float(ahead @ region.center_mm))
    if region.kind == "sphere":
        return min(region.size_mm) - aside
    half = np.array(region.size_mm) / 2.0
    along = axes @ ahead
    if region.kind == "cylinder":  # about its own upright axis
        half, along = half[:2], np.array([np.hypot(along[0], along[2]), along[1]])
    return 2.0 * _chord(half, along) - aside


def _chord(half: Array, ahead: Array) -> float:
    """Give half of the line through a box's middle; `half` (n,): of its sides, `ahead` (n,) a unit vector."""
    steep = np.abs(ahead) > 1e-9
    return float((half[steep] / np.abs(ahead[steep])).min())
