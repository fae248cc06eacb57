"""Propose where pegs hold a piece, and how flat it needs little support."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from knotfab.design.candidates import most_radius
from knotfab.design.design import Design
from knotfab.design.room import least_wall_mm, most_depth_mm
from knotfab.hold.beams import Stiffness
from knotfab.hold.wall import sag_on_pegs
from knotfab.knots import Knot, Knots
from knotfab.part.assemble import Part, rules_of
from knotfab.part.orient import flatter_depth, keeps_limits
from knotfab.request import Request
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.scene import LIGHT_SHARE, ResolvedView


def may_change(request: Request) -> tuple[bool, bool]:
    """Return whether the depth may be changed, and whether the wall's distance may."""
    scene = request.scene
    free = request.printing and request.time_budget_s is None and not scene.settings.start
    # the frames of a sequence share both
    free = free and not request.sequence
    given = "wall_distance_mm" in scene.views[0].model_fields_set
    # the wall of a piece that stands on it follows from its depth, and a free view finds its own
    stands = scene.mount.on_feet
    wall = not given and not scene.settings.free_view and not stands
    return free and scene.piece.depth is None and not (stands and given), free and wall


def propose_place_for(request: Request, made: Design) -> Place | None:
    shallower, nearer = may_change(request)
    view, asked = made.scene.views[0], request.scene.piece.tube_radius_mm
    return propose_place(
        made.knots,
        view,
        made.scene.piece.clearance_mm,
        Stiffness.from_scene(made.scene, made.knots),
        shallower=shallower,
        nearer=nearer,
        most_radius_mm=most_radius(asked, view, made.scene.printer.min_tube_radius_mm),
        foot="dowel" if made.scene.mount.foot == "dowel" else "plate",
    )


def propose_depth(made: Design, part: Part) -> float | None:
    weighed = part.pose.weighed
    if weighed is None or made.scene.piece.depth == 0:
        return None
    rules = rules_of(made.scene)
    if keeps_limits(weighed.estimate, rules):
        return None
    return flatter_depth(made.knots, depth_mm(made), rules)


def depth_mm(made: Design) -> float:
    return float(np.ptp(made.knots.points @ view_axes(made.scene.views[0])[2]))


def propose_lower(made: Design, sag_mm: float, most_mm: float) -> Place:
    """Propose a place for a standing piece that sags too much: legs bend by the fourth power of height."""
    return _place(depth_mm(made) * (AIM * most_mm / sag_mm) ** 0.25, wall_mm(made))


def tell_depth(asked: float | None, made: Design) -> list[str]:
    """Return a note if the centre lines take 30 % more depth than was asked for."""
    if not asked or len(made.scene.views) > 1:
        return []
    found = depth_mm(made)
    if found <= 1.3 * asked:
        return []
    return [
        f"A depth of {asked:g} mm was asked for, and the centre lines of a tube "
        f"{2 * made.knots.radius_mm:.1f} mm thick take {found:.0f} mm: a thinner one takes less "
        "(--tube-radius)."
    ]


def wall_mm(made: Design) -> float:
    return made.scene.views[0].wall_distance_mm


# estimating a place where pegs hold the piece

SHARES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.42, 0.35, 0.25)  # of the depth, tried in turn
LEAST_PEG_MM = 10.0  # room for fingers and a brush between piece and wall
AIM = 0.9  # share of the sag limit to aim at, since the next search lays the strands differently
_PX = 64  # size of a camera used only for its eye and wall
_ROUND = 10  # places are rounded to a tenth of a mm


@dataclass(frozen=True)
class Place:
    """Depth of the centre lines along the view, and distance of the wall from the scene's middle."""

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
    """Estimate the deepest place where pegs hold a piece, or else propose the nearest wall for its depth.

    The curves are moved along their light rays, so that their shadow stays the same.

    Args:
        knots: in scene coordinates.
        view: the view that they draw.
        shallower, nearer: whether depth and wall may be changed.
        most_radius_mm: the thickest tube for which there must be room.
        foot: what the pegs stand on. On a plate, a knot barred from the wall by others hangs on one of them.

    Returns:
        None if nothing may be changed, or no change helps.
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
        place = _place_wall(deep, knots.radius_mm, view, nearer, most_radius_mm)
        if share == 1.0:
            # less than 1 mm nearer is the same place
            if place.wall_mm > view.wall_distance_mm - 1.0:
                continue
            best = place  # it costs no depth, and struts may do the rest
        moved, there = _move_knots(knots, view, deep / depth, place)
        camera = camera_of(there, _PX, _PX)
        try:
            if sag_on_pegs(moved, camera, clearance_mm, firm, foot) <= firm.max_sag_mm:
                return place
        except ValueError:  # a knot has no peg: flattened strands collide
            continue
    return best


def _place_wall(
    depth: float, radius: float, view: ResolvedView, nearer: bool, most_radius: float
) -> Place:
    """Return the place for a depth, with the wall as near as pegs and the thickest tube allow."""
    wall = view.wall_distance_mm
    if nearer:
        steep = float(np.tan(np.deg2rad(view.wall_tilt_deg)))
        leans = view.frame_up_mm * steep + 0.5 * view.frame_height_mm * abs(steep)
        least = 0.5 * depth + radius + LEAST_PEG_MM + max(leans, 0.0)
        least = max(least, least_wall_mm(0.5 * depth, most_radius))
        wall = min(wall, float(np.ceil(_ROUND * least)) / _ROUND)
    return _place(depth, wall)


def _place(depth: float, wall: float) -> Place:
    """Round a depth down, mm, and pair it with the wall's distance."""
    return Place(max(float(np.floor(_ROUND * depth)), 1.0) / _ROUND, wall)


def _move_knots(
    knots: Knots, view: ResolvedView, share: float, place: Place
) -> tuple[Knots, ResolvedView]:
    """Move the knots along their light rays to `share` of their heights, scaled for the wall there."""
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
