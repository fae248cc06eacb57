"""The room for a piece: its region with a size, and the depth that this leaves in a single view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.candidates import DEPTH_RATIO
from knotfab.design.hull import HullBound
from knotfab.limits.region import region_mesh
from knotfab.scene.camera import view_axes
from knotfab_formats.bounds import MOST_MM
from knotfab_formats.piece import Mount, Region
from knotfab_formats.scene import LIGHT_SHARE, WALL_SHARE, ResolvedView, SettledRegion

_FOOT_SHARE = 0.5  # depth by which a valley is sunk into its plate, in radii
_BACK_MM = 0.7  # thickness of the plate that stays below a valley
_PLATE_SHARE = 0.3  # distance from a piece on a plate to the wall, over the frame's longer side
_WIDER = 1.25  # width of the region over that of the picture
_BESIDE_RADII = 2.0  # room before and behind the centre lines, in radii


def resolve_region(
    region: Region,
    views: Sequence[ResolvedView],
    bounds: Sequence[HullBound],
    radius: float,
    mount: Mount | None = None,
) -> SettledRegion:
    """Return the region with its size: the scene's or, if open, the size that the pictures need.

    For one view it is turned like the view, a quarter wider than the picture, and clear of wall and lamp. For
    several views it holds the visual hull, with a tube radius (mm) of play. On a `mount` whose plate holds
    the piece's valleys it includes part of the plate.

    Raises:
        InputError: a mesh is unfit. SceneError: the region would be larger than allowed.
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
        reach = view.reach_mm
        if mount is not None and mount.on_feet:
            reach = view.wall_distance_mm - mount.before_wall_mm
            reach += mount.thickness_mm - _BACK_MM / 2
        z = 2.0 * reach
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
            "Make the picture smaller (--size).",
        )
    return SettledRegion(**{**known, "size_mm": tuple(round(float(s), 4) for s in size)})


def depth_extent(
    asked: float | None,
    polygon: MultiPolygon,
    region: SettledRegion,
    radius: float,
    ahead: Sequence[float] = (0.0, 0.0, 1.0),
) -> float | None:
    """Return the depth of the centre lines along a single view's axis, mm; None for a flat piece.

    Args:
        asked: the scene's depth, mm; 0 is a flat piece, None leaves it open.
        ahead: the view's axis, towards the light.

    Raises:
        SceneError: the region has no room for it.
    """
    if asked == 0:
        return None
    low_x, low_y, high_x, high_y = polygon.bounds
    usual = DEPTH_RATIO * (max(high_x - low_x, high_y - low_y) + 2 * radius)
    wanted = asked or usual
    room = most_depth_mm(0.5 * _length_along(region, np.asarray(ahead)), radius)
    if room <= 0:
        raise SceneError(
            "the region",
            f"a tube {2 * radius:.1f} mm thick has no room between the light and the wall",
            "Move the wall away (--wall-distance), or use a thinner tube (--tube-radius) or a larger region",
        )
    if asked is not None and wanted > room + 1e-3:
        raise SceneError(
            f"--depth {wanted:g}",
            f"the region is {room:.1f} mm deep for it",
            "Leave it out, and what fits is taken, or use a larger [region] in the scene",
        )
    # an auto depth is rounded down, so that a rebuild from the number finds the same room
    return float(np.floor(min(wanted, room) * 1e4) / 1e4) if asked is None else wanted


def foot_sink_mm(mount: Mount, radius: float) -> float:
    """Return how deep a tube's valleys are sunk into their plate, mm."""
    return min(_FOOT_SHARE * radius, mount.thickness_mm - _BACK_MM)


def plate_wall_mm(
    mount: Mount, view: ResolvedView, depth: float | None, thinnest: float, tallest: float
) -> float:
    """Return the distance from the middle of a piece to the wall plate that its valleys stand in, mm.

    Args:
        depth: the depth asked for, mm. thinnest: radius of the thinnest tube, mm. tallest: height of what
            the printer prints, mm.
    """
    asked = None if depth is None else 0.5 * depth + thinnest - foot_sink_mm(mount, thinnest)
    usual = min(_PLATE_SHARE * view.longer_mm, 0.5 * tallest - mount.thickness_mm)
    asked = (asked or usual) + mount.before_wall_mm
    return round(min(asked, LIGHT_SHARE * view.light_distance_mm), 2)


def plate_depth_mm(mount: Mount, view: ResolvedView, radius: float) -> float:
    """Return the depth of the centre lines of a tube whose valleys stand in the plate, mm.

    Raises:
        SceneError: the wall is too near, or the plate too thin to hold a foot.
    """
    if mount.thickness_mm < _BACK_MM:
        raise SceneError(
            f"scene key mount.plate_thickness_mm = {mount.thickness_mm:g}",
            f"a piece stands in its plate, of which {_BACK_MM:g} mm stay below its feet",
            f"Use at least {_BACK_MM + 0.1:g}, or leave it out",
        )
    face = view.wall_distance_mm - mount.before_wall_mm
    depth = 2.0 * (face + foot_sink_mm(mount, radius) - radius)
    if depth < 8.0 * radius:  # less than an arch over a neighbour
        raise SceneError(
            f"--wall-distance {view.wall_distance_mm:g}",
            f"it leaves a tube {2 * radius:.1f} mm thick that stands on the wall's plate a depth of "
            f"{max(depth, 0.0):.1f} mm",
            "Leave it out",
        )
    return float(np.floor(depth * 1e4) / 1e4)


def most_depth_mm(reach_mm: float, radius: float) -> float:
    """Return the most depth of the centre lines in a region that extends `reach_mm` to each side, mm."""
    return 2.0 * (reach_mm - _BESIDE_RADII * radius)


def least_wall_mm(back_mm: float, radius: float) -> float:
    """Return the least distance of a flat wall behind a region of open size, mm.

    Args:
        back_mm: extent of the centre lines behind the middle, or half the depth asked for.
    """
    return (back_mm + _BESIDE_RADII * radius) / WALL_SHARE


def _length_along(region: SettledRegion, ahead: Array) -> float:
    """Return the length of a region along a direction (3,), symmetric about the origin, mm."""
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
    """Return half the chord through the centre of a box with half sides `half` (n,), along `ahead` (n,)."""
    steep = np.abs(ahead) > 1e-9
    return float((half[steep] / np.abs(ahead[steep])).min())
