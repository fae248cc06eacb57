"""Four marks about the frame, by which a photograph of the shadow is set straight: cards to be cut out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.pages import RULER_MM, Paper, draw_foot, draw_ruler, make_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CARD_MM", "MARK_RADII_MM", "card_middles", "draw_marks_page"]

CARD_MM = 30.0
# a dot, a light ring and a dark one: of the disc that the dark ring bounds, 4/9 lie in it and 1/9 are dot
MARK_RADII_MM = (4.0, 8.0, 12.0)
_NAMES = ("top left", "top right", "bottom right", "bottom left")
# the corner of each card that is laid on, right and up
_INNER = ((1, -1), (-1, -1), (-1, 1), (1, 1))


def card_middles(frame_mm: tuple[float, float], margin_mm: float) -> Array:
    """Return (4, 2) the marks' middles, mm right and down from the frame's top left corner, clockwise.

    Args:
        margin_mm: margin of the plate about the frame, whose corners the cards touch; 0: they touch the
            frame's.
    """
    (w, h), off = frame_mm, margin_mm + CARD_MM / 2
    return np.array([[-off, -off], [w + off, -off], [w + off, h + off], [-off, h + off]])


def draw_marks_page(paper: Paper, plate: bool) -> Figure:
    """Draw the page of the four cards."""
    from matplotlib.patches import Circle, Rectangle

    figure, axes = make_page(paper)
    left, top = paper.margin + 4, paper.height - paper.margin
    touched = "the plate" if plate else "the frame"
    axes.text(left, top, "Marks for a photograph", size=14, va="top")
    lines = (
        "Not needed to hang the piece: knotfab compare finds the frame by them in a photograph.",
        f"Print this page at 100 %, measure the ruler ({RULER_MM:.0f} mm), and cut the four cards out.",
        f"Tape them flat to the wall about {touched}, upright, the black corner of each on its corner.",
        "Photograph the shadow so that all four are seen, then: knotfab compare PHOTO FOLDER",
    )
    for k, line in enumerate(lines):
        axes.text(left, top - 11 - 5.0 * k, line, size=8, va="top")
    for k, (name, inner) in enumerate(zip(_NAMES, _INNER, strict=True)):
        column, row = (0, 1, 1, 0)[k], (0, 0, 1, 1)[k]
        x = paper.width / 2 + (column - 0.5) * 70.0
        y = paper.height / 2 + 30.0 - row * 70.0
        axes.add_patch(
            Rectangle(
                (x - CARD_MM / 2, y - CARD_MM / 2), CARD_MM, CARD_MM, fill=False, lw=0.3, ec="0.6"
            )
        )
        for radius, ink in zip(reversed(MARK_RADII_MM), ("black", "white", "black"), strict=True):
            axes.add_patch(Circle((x, y), radius, fc=ink, lw=0))
        corner = np.array([x, y]) + np.array(inner) * CARD_MM / 2
        for arm in np.diag(-4.0 * np.array(inner)):
            axes.plot(*np.stack([corner, corner + arm]).T, color="black", lw=1.2)
        axes.text(x, y - CARD_MM / 2 - 2, name, size=8, ha="center", va="top")
    draw_ruler(axes, paper, "cut")
    draw_foot(axes, paper, "last page", "marks for a photograph", "print at 100 %, not fitted")
    return figure
