"""The drawing from above of a piece with several views: where all lamps and walls stand about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.dimensions import Scaled, draw_dimension, fit_scale, length, project_outlines
from knotfab.drawing.pages import PAPERS, Box, make_page
from knotfab.mount.mount import Mounted
from knotfab.mount.placement import Placement
from knotfab.mount.strokes import (
    FAINT,
    INK,
    LIGHT,
    PIECE,
    WORDS,
    cross,
    draw_lamp,
    fill,
    hatch,
    lamp_name,
    note,
)
from knotfab_formats.scene import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plan_sheet"]


ZONE: Box = (22.0, 40.0, 188.0, 250.0)  # the drawing's place on the page
BENDS = 41  # points along a round wall
BESIDE_MM = 12.0  # the wall reaches so far beside its frame


def plan_sheet(mounted: Mounted, places: Sequence[Placement], views: Sequence[View]) -> Figure:
    """Return one page of A4 with everything from above, the first lamp below the piece.

    Args:
        places, views: places and views of the piece, one each in the scene's order.
    """
    paper = PAPERS["a4"]
    figure, axes = make_page(paper)
    right, up, out = places[0].level
    above = np.stack([right, -out, up])  # axes: to the right and up the page, and to the viewer
    piece = project_outlines(mounted.solids, above)
    walls = [_wall(place, above) for place in places]
    lamps = [above[:2] @ place.lamp for place in places]
    every = np.concatenate([*piece, *walls, np.stack(lamps)])
    to = fit_scale(every, ZONE)
    fill(axes, [to(p) for p in piece], PIECE)
    for place, view, wall, lamp in zip(places, views, walls, lamps, strict=True):
        _view(axes, place, view, wall, lamp, above, to)
    cross(axes, to(np.zeros(2)), 2.0, 0.4)
    left, top = 14.0, paper.height - 12
    axes.text(left, top, "Setting up", size=15, va="top", gid=WORDS)
    axes.text(
        left, top - 8.0,
        f"From above, {to.name}. Lengths in mm, from the middle of each lamp and of the piece; what counts "
        "is the figures, not the drawing.",
        size=6.5, va="top", color="0.35", gid=WORDS,
    )  # fmt: skip
    axes.text(
        left, top - 12.0,
        (f"{len(views)} pictures, each on its own wall and by its own light. " if len(views) > 1 else "")
        + ("The front of the base is below in this drawing. " if places[0].base is not None else "")
        + "The pages that follow place one view each.",
        size=6.5, va="top", color="0.35", gid=WORDS,
    )  # fmt: skip
    return figure


def _wall(place: Placement, above: Array, beside: float = BESIDE_MM) -> Array:
    """Return (n, 2) a wall seen from above, so far beside its frame, at the height of the frame's middle."""
    reach = place.frame_mm[0] / 2 + beside
    across = np.linspace(-reach, reach, 2 if place.round is None else BENDS)
    if place.round is None:
        points = place.middle + across[:, None] * place.wall[0]
    else:
        up = np.full(BENDS, float((place.middle - place.round.foot) @ place.round.axes[1]))
        points = place.round.stand(np.column_stack([across, up]))[0]
    return np.asarray(points @ above[:2].T)


def _view(
    axes: Axes,
    place: Placement,
    view: View,
    wall: Array,
    lamp: Array,
    above: Array,
    to: Scaled,
) -> None:
    """Draw one view's lamp, wall, frame and rays, with how far lamp and wall are from the middle."""
    frame = _wall(place, above, 0.0)
    for end in frame[[0, -1]]:
        axes.plot(*to(np.stack([lamp, end])).T, color=LIGHT, lw=0.4)
    axis = to(np.stack([lamp, above[:2] @ place.middle]))
    axes.plot(*axis.T, color=FAINT, lw=0.3, ls="-.")
    axes.plot(*to(wall).T, color=INK, lw=0.8)
    axes.plot(*to(frame).T, color=INK, lw=1.8, solid_capstyle="butt")
    hatch(axes, to(wall))
    draw_lamp(axes, axis[0], view.light_size_mm / to.ratio)
    along = (axis[1] - axis[0]) / np.linalg.norm(axis[1] - axis[0])
    # mm of the page, from a view's axis to its dimensions
    aside = 4.0 * np.array([-along[1], along[0]])
    middle = to(np.zeros(2))
    levelled = float(np.cos(np.deg2rad(view.elevation_deg)))
    draw_dimension(axes, axis[0], middle, aside, length(view.light_distance_mm * levelled))
    draw_dimension(
        axes, middle, axis[1], aside, length(float(np.linalg.norm(axis[1] - middle)) * to.ratio)
    )
    # along the wall, read from below or from the right
    turn = (float(np.degrees(np.arctan2(aside[1], aside[0]))) + 89.9) % 180.0 - 89.9
    style = {"size": 7, "ha": "center", "va": "center", "rotation": turn}
    note(axes, axis[0] - 5.0 * along, f"{lamp_name(view)}: {view.name}", **style)
    note(axes, axis[1] + 5.0 * along, f"wall: {view.name}", **style)
