"""Templates at full size: the wire's front and side view on A4 or Letter pages to be laid together."""

from __future__ import annotations

import pathlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.pages import Drawing, Paper, draw_tiled, write_pages

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

__all__ = ["WireDrawing", "draw_views", "write_templates"]


@dataclass(frozen=True)
class WireDrawing:
    """One view of one wire, in its own plane (mm): lines to draw at full size.

    `labels` are written beside the places of the bends (number, and how far that place stands in
    front of the drawing's plane); the first point is the joint.
    """

    title: str
    line: Array  # (k, 2) the centre line, its two ends at the joint
    bends: Array  # (m, 2) where each bend begins
    labels: tuple[str, ...]
    wire_mm: float

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top of the wire, with its thickness and room for labels."""
        low, high = self.line.min(axis=0) - self.wire_mm, self.line.max(axis=0) + self.wire_mm
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def draw(self, axes: Axes, shift: Array, window: Rectangle) -> None:
        """Draw it on a page, moved by `shift` (2,), mm, and clipped to the window."""
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path
        from matplotlib.textpath import TextPath

        line = self.line + shift
        # the wire at its true thickness: a line's width is in points
        point = 72.0 / 25.4
        parts = axes.plot(*line.T, color="0.85", lw=self.wire_mm * point, solid_joinstyle="round")
        parts += axes.plot(*line.T, color="black", lw=0.3)
        parts += axes.plot(*(self.bends + shift).T, "o", ms=1.2, color="#c00", mew=0)
        parts += axes.plot(*line[0], "s", ms=5, mfc="none", mec="#06c", mew=0.6)
        for part in parts:
            part.set_clip_path(window)
        (x0, y0), wide, high = window.get_xy(), window.get_width(), window.get_height()
        # one path for all labels: hundreds of texts are slow
        glyphs = [
            TextPath((x + 0.4, y + 0.3), label, size=1.0)
            for (x, y), label in zip(self.bends + shift, self.labels, strict=True)
            if x0 <= x <= x0 + wide and y0 <= y <= y0 + high
        ]
        if glyphs:
            axes.add_patch(PathPatch(Path.make_compound_path(*glyphs), fc="#a00", lw=0, zorder=5))


def draw_views(
    name: str, line: Array, begins: Array, right: Array, up: Array, diameter: float
) -> tuple[WireDrawing, WireDrawing]:
    """Draw front view (as seen from the light, without perspective) and side view (from the right).

    Args:
        line: (k, 3) the wire, bent again. begins: (m, 3) where its bends begin.
        right, up: (3,) unit axes of someone at the light. In the side view the light is at the left.
    """
    towards = np.cross(right, up)
    base = float((line @ towards).min())
    depth = begins @ towards - base
    front = WireDrawing(
        f"{name}, front",
        np.column_stack([line @ right, line @ up]),
        np.column_stack([begins @ right, begins @ up]),
        tuple(f"{k} ({d:.1f})" for k, d in enumerate(depth, start=1)),
        diameter,
    )
    side = WireDrawing(
        f"{name}, side",
        np.column_stack([-(line @ towards), line @ up]),
        np.column_stack([-(begins @ towards), begins @ up]),
        tuple(str(k) for k in range(1, len(begins) + 1)),
        diameter,
    )
    return front, side


def write_templates(
    path: pathlib.Path, paper: Paper, drawings: list[WireDrawing], facts: list[str]
) -> int:
    """Return one PDF whose pages print at full size (100 %, no fitting to the page).

    Args:
        facts: lines of the first page.

    Returns:
        The number of pages.
    """
    shown = [Drawing(one.title, one.box, one.draw) for one in drawings]
    pages = draw_tiled(paper, "Bending templates, full size", facts, shown, "bend")
    return write_pages(path, "Bending templates at full size", pages)
