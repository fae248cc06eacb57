"""Strokes of a mount's drawings: the piece, lamps, walls and notes, in mm of the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.dimensions import length
from knotfab.geometry.sampling import arc_lengths
from knotfab_formats.scene import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "FAINT",
    "INK",
    "LIGHT",
    "PIECE",
    "WORDS",
    "cross",
    "draw_lamp",
    "fill",
    "hatch",
    "lamp_name",
    "note",
]


INK, PIECE, LIGHT, FAINT = "black", "#8a8478", "#e0a400", "0.6"
WORDS = "words"  # the name, in an SVG, of parts beside the drawing that are told with it


def fill(axes: Axes, polygons: Sequence[Array], color: str, above: float | None = None) -> None:
    """Fill polygons and their holes as one path, cut off below a height of the page."""
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    rings = [Outline(np.append(p, p[:1], axis=0), closed=True) for p in polygons]
    if rings:
        patch = PathPatch(Outline.make_compound_path(*rings), fc=color, lw=0)
        axes.add_patch(patch)
        if above is not None:
            patch.set_clip_path(Rectangle((0.0, above), 210.0, 297.0, transform=axes.transData))


def cross(axes: Axes, at: Array, reach: float, width: float) -> None:
    """Draw two strokes through a point (2,) of the page, so many mm to each side and so many points wide."""
    for arm in (np.array([reach, 0.0]), np.array([0.0, reach])):
        axes.plot(*np.stack([at - arm, at + arm]).T, color=INK, lw=width)


def draw_lamp(axes: Axes, at: Array, across: float) -> None:
    """Draw a lamp `across` mm of the page wide, with its axes."""
    from matplotlib.patches import Circle

    axes.add_patch(
        Circle((float(at[0]), float(at[1])), max(0.5 * across, 0.5), fc=LIGHT, lw=0.3, ec=INK)
    )
    cross(axes, at, 2.5, 0.25)


def hatch(axes: Axes, wall: Array) -> None:
    """Draw short strokes behind the wall's line (n, 2)."""
    steps = np.diff(wall, axis=0)
    ends = arc_lengths(wall, closed=False)
    for s in np.arange(1.5, ends[-1], 2.5):
        k = int(np.searchsorted(ends, s)) - 1
        unit = steps[k] / (ends[k + 1] - ends[k])
        at = wall[k] + (s - ends[k]) * unit
        behind = np.array([-unit[1], unit[0]]) - unit
        axes.plot(*np.stack([at, at + behind]).T, color=FAINT, lw=0.3)


def note(axes: Axes, at: Array, text: str, **style: Any) -> None:
    """Write a text at a point (2,) of the page, mm."""
    axes.text(float(at[0]), float(at[1]), text, **style)


def lamp_name(view: View) -> str:
    """Return the lamp and its size, or the eye."""
    if view.kind != "shadow":
        return "eye"
    return f"lamp, {length(view.light_size_mm)} mm" if view.light_size_mm > 0 else "lamp"
