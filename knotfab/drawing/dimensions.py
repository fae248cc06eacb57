"""Dimensions, scales and outlines: what a technical drawing is made of, in mm of the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import atan2, degrees
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.pages import Box

if TYPE_CHECKING:
    from manifold3d import Manifold
    from matplotlib.axes import Axes

__all__ = ["Scaled", "draw_dimension", "fit_scale", "length", "project_outlines"]


_STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_LINE = 0.35  # points
_TEXT = 6.5  # points
_GAP_MM = 1.0  # between a thing and the line that leads away from it
_ARROW_MM = 1.6  # length of an arrow's head


def length(value: float) -> str:
    """Return a length as a person reads it off a ruler: to the tenth of a mm, whole ones without a point."""
    return f"{value:.1f}".removesuffix(".0").replace("-0", "0" if abs(value) < 0.05 else "-0")


@dataclass(frozen=True)
class Scaled:
    """A drawing at 1:`ratio` on the page: `shift` (mm of the page) is where its origin comes to lie."""

    ratio: float
    shift: tuple[float, float]

    def __call__(self, points: Array) -> Array:
        """Map (..., 2) mm of the thing -> mm of the page."""
        page: Array = np.asarray(points, dtype=np.float64) / self.ratio + np.asarray(self.shift)
        return page

    @property
    def name(self) -> str:
        return f"1:{self.ratio:g}"


def fit_scale(points: Array, zone: Box) -> Scaled:
    """Give the largest usual scale at which points (n, 2), mm, fit `zone` (mm of the page): in its middle."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = high - low
    room = np.array([zone[2] - zone[0], zone[3] - zone[1]])
    least = float((size / room).max())
    ratio, power = _STEPS[0], 1.0
    while ratio < least * (1 - 1e-9):
        usual = [s * power for s in _STEPS if s * power >= least * (1 - 1e-9)]
        power *= 10.0
        ratio = usual[0] if usual else power
    middle = (low + high) / 2
    there = np.array([zone[0] + zone[2], zone[1] + zone[3]]) / 2
    x, y = there - middle / ratio
    return Scaled(ratio, (float(x), float(y)))


def draw_dimension(
    axes: Axes,
    start: Sequence[float] | Array,
    end: Sequence[float] | Array,
    away: Sequence[float] | Array,
    text: str,
    *,
    color: str = "#06c",
) -> None:
    """Draw a dimension of two points of the page (mm), its line moved from them by the vector `away`.

    The text stands above the line as one reads it, or beside it where there is no room between.
    """
    a, b, off = (np.asarray(p, dtype=np.float64) for p in (start, end, away))
    along = b - a
    reach = float(np.linalg.norm(along))
    side = np.linalg.norm(off)
    lead = off / side if side > 0 else np.zeros(2)
    for p in (a, b):
        if side > _GAP_MM:
            tips = np.stack([p + _GAP_MM * lead, p + off + _GAP_MM * lead])
            axes.plot(*tips.T, color=color, lw=0.6 * _LINE)
    ends = np.stack([a + off, b + off])
    unit = along / reach if reach > 0 else np.array([1.0, 0.0])
    inside = reach >= 9.0  # room for the text between two arrows
    axes.plot(*ends.T, color=color, lw=_LINE)
    for tip, sign in zip(ends, (1.0, -1.0) if inside else (-1.0, 1.0), strict=True):
        _arrow(axes, tip, sign * unit, color)
    angle = degrees(atan2(unit[1], unit[0]))
    if angle > 90.0 + 1e-6 or angle <= -90.0 + 1e-6:
        angle -= 180.0 if angle > 0 else -180.0
    turn = np.radians(angle)
    above = np.array([-np.sin(turn), np.cos(turn)])
    reading = np.array([np.cos(turn), np.sin(turn)])
    if inside:
        at, align = ends.mean(axis=0) + 0.6 * above, "center"
    else:
        at = max(ends, key=lambda p: float(p @ reading)) + 2.2 * reading - 0.8 * above
        align = "left"
    axes.text(
        float(at[0]),
        float(at[1]),
        text,
        size=_TEXT,
        color=color,
        rotation=angle,
        rotation_mode="anchor",
        ha=align,
        va="baseline",
    )


def _arrow(axes: Axes, tip: Array, into: Array, color: str) -> None:
    """Draw a filled head whose point is at `tip`, its shaft in the direction `into`."""
    side = np.array([-into[1], into[0]])
    back = tip + _ARROW_MM * into
    head = np.stack([tip, back + 0.25 * _ARROW_MM * side, back - 0.25 * _ARROW_MM * side])
    axes.fill(*head.T, color=color, lw=0)


def project_outlines(solids: Iterable[Manifold], axes: Array) -> list[Array]:
    """Return the outlines (n, 2) of solids seen along `axes[2]`, in the coordinates of `axes[:2]` (mm).

    Args:
        axes: (3, 3) orthonormal rows, right-handed; the last one points to the viewer.

    Outer outlines turn counter-clockwise, those of holes clockwise; corners within 0.02 mm of a
    straight line are left out.
    """
    from manifold3d import CrossSection

    flat = CrossSection()
    for solid in solids:
        flat += solid.transform(np.pad(axes, ((0, 0), (0, 1)))).project()
    return [np.asarray(p, dtype=np.float64) for p in flat.simplify(0.02).to_polygons()]
