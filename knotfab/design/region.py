"""Room: the region with its size settled, and how much depth there is in it for a piece of one view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import MultiPolygon

from knotfab.design.candidates import DEPTH_RATIO
from knotfab.design.hull import HullBound
from knotfab.errors import SceneError
from knotfab.limits.region_mesh import region_mesh
from knotfab.scene.camera import view_axes
from knotfab.scene.model import Region, ResolvedRegion, ResolvedView, Scene

__all__ = ["depth_extent", "resolve_region"]


_WIDER = 1.25  # than the picture


def resolve_region(
    region: Region, views: Sequence[ResolvedView], bounds: Sequence[HullBound], radius: float
) -> ResolvedRegion:
    """The region with its extents: those of the scene, or what the pictures need.

    Of one view, clear of wall and lamp, a quarter wider than the picture and turned as the view is; of
    several, the visual hull's extents about its middle, with a tube radius (mm) of play.

    Raises:
        InputError: a mesh is unfit.
    """
    known = region.model_dump()
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        size = tuple(round(float(s), 4) for s in most - least)
        return ResolvedRegion(**{**known, "size_mm": size})
    if region.size_mm != "auto":
        return ResolvedRegion(**known)
    if bounds:
        low = np.min([b.low for b in bounds], 0)
        high = np.max([b.high for b in bounds], 0)
        x, y, z = 2 * (np.maximum(np.abs(low), np.abs(high)) + radius)
        around = {"cylinder": float(np.hypot(x, z)), "sphere": float(np.linalg.norm([x, y, z]))}
    else:
        (view,) = views
        known |= {"azimuth_deg": view.azimuth_deg, "elevation_deg": view.elevation_deg}
        x, y = (_WIDER / view.magnification * side for side in view.frame_mm)
        z = 2.0 * min(0.9 * view.wall_distance_mm, 0.25 * view.light_distance_mm)
        widest = min(max(x, y, z), 1.9 * view.light_distance_mm)
        around = {"cylinder": widest, "sphere": widest}
    size = {
        "box": (x, y, z),
        "cylinder": (around["cylinder"], y, around["cylinder"]),
        "sphere": (around["sphere"],) * 3,
    }[region.kind]
    return ResolvedRegion(**{**known, "size_mm": tuple(round(float(s), 4) for s in size)})


def depth_extent(
    scene: Scene, polygon: MultiPolygon, region: ResolvedRegion, radius: float
) -> float | None:
    """Extent of the centre lines along the one view's axis in mm, None for a flat piece.

    Raises:
        SceneError: the region has no room for it.
    """
    if scene.piece.depth == "flat":
        return None
    auto = scene.piece.depth == "auto"
    low_x, low_y, high_x, high_y = polygon.bounds
    wanted = (
        DEPTH_RATIO * (max(high_x - low_x, high_y - low_y) + 2 * radius)
        if isinstance(scene.piece.depth, str)
        else scene.piece.depth
    )
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        across = 2 * float(min(most[2], -least[2]))
    else:
        across = region.size_mm[2] - 2 * abs(float(view_axes(region)[2] @ region.center_mm))
    room = across - 4.0 * radius
    if room <= 0:
        raise SceneError(
            "the region",
            f"a tube of {radius:g} mm radius has no room between the light and the wall",
            "Move the wall away (wall_distance_mm), or enlarge the region.",
        )
    if not auto and wanted > room + 1e-3:
        raise SceneError(
            "scene key piece.depth",
            f"{wanted:g} mm do not fit a region that is {room:.1f} mm deep for it",
            "Ask for less depth, or enlarge the region and the distance to the wall",
        )
    # an auto depth is rounded down, so that a rebuild from the number finds the same room
    return float(np.floor(min(wanted, room) * 1e4) / 1e4) if auto else wanted
