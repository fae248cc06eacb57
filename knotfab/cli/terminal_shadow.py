"""The shadow so far in a terminal: dots of Braille, two by four in a character."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Mask
from knotfab_formats.scene import ResolvedView

if TYPE_CHECKING:
    from knotfab.knots import Knots

__all__ = ["draw_shadow"]

_ACROSS, _DOWN = 2, 4  # dots of a character
# Unicode 2800 gives each dot of a character its bit, row by row.
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_GAP = 2  # columns between views


def draw_shadow(views: Sequence[ResolvedView], knots: Knots, columns: int, rows: int) -> str:
    """Draw the shadow of `knots` (in the scene) in each view's frame, side by side while there is room.

    Args:
        columns, rows: characters that there are.

    Returns:
        Lines of Braille, `rows` at most.
    """
    # loops load scipy, and calls that are refused draw nothing
    from knotfab.render.frame import Sheet
    from knotfab.render.picture import frame_at
    from knotfab.render.silhouette import cast

    points = knots.points
    drawn: list[list[str]] = []
    left = columns
    for view in views:
        high = _DOWN * rows
        wide = round(high * view.frame_width_mm / view.frame_height_mm)
        if wide > _ACROSS * columns:
            wide, high = _ACROSS * columns, round(high * _ACROSS * columns / wide)
        if -(-wide // _ACROSS) > left:
            break
        dot_mm = max(view.frame_width_mm / max(1, wide), view.frame_height_mm / max(1, high))
        frame = frame_at(view, Sheet(max(1, wide), max(1, high), dot_mm, view.wall_tilt_deg))
        # a strand thinner than a dot is drawn as thick as one, so that it has no gaps
        thick = max(knots.radius_mm, 0.5 * dot_mm / view.magnification)
        drawn.append(_to_braille(cast(points, points[knots.rings.next], frame, thick)))
        left -= len(drawn[-1][0]) + _GAP
    height = max((len(lines) for lines in drawn), default=0)
    filled = [lines + [" " * len(lines[0])] * (height - len(lines)) for lines in drawn]
    return "\n".join((" " * _GAP).join(parts).rstrip() for parts in zip(*filled, strict=True))


def _to_braille(dark: Mask) -> list[str]:
    height, width = dark.shape
    whole: NDArray[np.bool_] = np.zeros(
        (-(-height // _DOWN) * _DOWN, -(-width // _ACROSS) * _ACROSS), dtype=bool
    )
    whole[:height, :width] = dark
    cells = whole.reshape(len(whole) // _DOWN, _DOWN, -1, _ACROSS)
    codes = np.einsum("rdca,da->rc", cells.astype(np.int64), _BITS)
    return ["".join(chr(0x2800 + int(code)) for code in row) for row in codes]
