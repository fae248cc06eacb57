"""Estimate from a piece's curves how near to its wall, and how flat, it must be for pegs to hold it.

A peg is bent by its own weight as the fourth power of its length: half as far from the wall it sags a
sixteenth. So a piece that is too heavy for its pegs is moved to the wall as it is, and flattened only as far
as that is not enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from knotfab.design.region import least_wall_mm, most_depth_mm
from knotfab.knots import Knot, Knots
from knotfab.mount.piece_frame import Stiffness
from knotfab.mount.wall import sag_on_pegs
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.scene import LIGHT_SHARE, ResolvedView

__all__ = ["Place", "propose_place"]

SHARES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.42, 0.35, 0.25)  # shares of the depth
LEAST_PEG_MM = 10.0  # room for fingers and a brush between the wall and what is nearest to it
AIM = 0.9  # a share of the limit: the search that follows lays the strands anew
_PX = 64  # pixels of a camera that is asked for eye and wall alone
_ROUND = 10  # parts of a mm


@dataclass(frozen=True)
class Place:
    """Depth of the centre lines along the view, and distance of the wall from the scene's middle: mm."""

    depth_mm: float
    wall_mm: float


def propose_place(
    knots: Knots,
    view: ResolvedView,
    clearance_mm: float,
    stiffness: Stiffness,
    *,
    shallower: bool,
    nearer: bool,
    most_radius_mm: float,
    foot: Literal["plate", "dowel"] = "plate",
) -> Place | None:
    """Find the deepest place at which pegs may hold a piece, by an estimate; else the nearest for its depth.

    The curves are moved along their light rays, so that their shadow stays; a new search at that place lays
    them anew.

    Args:
        knots: in scene coordinates. view: the one that they draw.
        shallower, nearer: whether depth and wall may be changed.
        most_radius_mm: the thickest tube that may be taken there, for which there is to be room.
        foot: what pegs stand on; on a plate a knot that others bar from the wall hangs on one of them.

    Returns:
        None: nothing may be changed, or it is of no use.
    """
    best: Place | None = None
    firm = replace(stiffness, max_sag_mm=AIM * stiffness.max_sag_mm)
    depth = float(np.ptp(knots.points @ view_axes(view)[2]))
    deepest = depth
    if shallower and nearer:
        room = most_depth_mm(LIGHT_SHARE * view.light_distance_mm, most_radius_mm)
        deepest = min(depth, max(room, SHARES[-1] * depth))
    for share in SHARES if shallower else SHARES[:1]:
        deep = min(share * depth, deepest)
        place = _at(deep, knots.radius_mm, view, nearer, most_radius_mm)
        if share == 1.0:
            # a search lays the strands anew: so much nearer is no other place
            if place.wall_mm > view.wall_distance_mm - 1.0:
                continue  # it is there
            best = place  # nothing is given up for it, and struts may do the rest
        moved, there = _move(knots, view, deep / depth, place)
        camera = camera_of(there, _PX, _PX)
        try:
            if sag_on_pegs(moved, camera, clearance_mm, firm, foot) <= firm.max_sag_mm:
                return place
        except ValueError:  # a knot has no peg: strands that are only pressed flat meet
            continue
    return best


def _at(depth: float, radius: float, view: ResolvedView, nearer: bool, most_radius: float) -> Place:
    """Give the place of a piece so deep; a wall that leans comes nearer if the frame is highest or lowest."""
    wall = view.wall_distance_mm
    if nearer:
        steep = float(np.tan(np.deg2rad(view.wall_tilt_deg)))
        leans = view.frame_up_mm * steep + 0.5 * view.frame_height_mm * abs(steep)
        least = 0.5 * depth + radius + LEAST_PEG_MM + max(leans, 0.0)
        least = max(least, least_wall_mm(0.5 * depth, most_radius))
        wall = min(wall, float(np.ceil(_ROUND * least)) / _ROUND)
    return Place(max(float(np.floor(_ROUND * depth)), 1.0) / _ROUND, wall)


def _move(
    knots: Knots, view: ResolvedView, share: float, place: Place
) -> tuple[Knots, ResolvedView]:
    """Move the knots along their light rays to `share` of their heights, as large as the view asks there."""
    axes, light = view_axes(view), view.light_distance_mm
    there = view.but(wall_distance_mm=place.wall_mm)
    scale = view.magnification / there.magnification
    moved = []
    for knot in knots.knots:
        across, height = np.split(knot.points @ axes.T, [2], axis=1)
        plane = across / (1 - height / light)
        across = scale * plane * (1 - share * height / light)
        moved.append(Knot(np.hstack([across, share * height]) @ axes, closed=True))
    return Knots(tuple(moved), knots.radius_mm), there
