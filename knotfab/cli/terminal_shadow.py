"""The shadow so far in a terminal: dots of Braille, two by four in a character."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.geometry.sampling import arc_lengths
from knotfab.knots import Knots
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.scene import ResolvedView

__all__ = ["draw_shadow"]

_ACROSS, _DOWN = 2, 4  # dots of a character
# of the dots of a character, row by row (Unicode 2800)
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_GAP = 2  # columns between views


def draw_shadow(views: Sequence[ResolvedView], knots: Knots, columns: int, rows: int) -> str:
    """The shadow of `knots` (in the scene) in each view's frame, side by side while there is room.

    Args:
        columns, rows: characters that there are.

    Returns:
        Lines of Braille, `rows` at most.
    """
    drawn: list[list[str]] = []
    left = columns
    for view in views:
        high = _DOWN * rows
        wide = round(high * view.frame_width_mm / view.frame_height_mm)
        if wide > _ACROSS * columns:
            wide, high = _ACROSS * columns, round(high * _ACROSS * columns / wide)
        if -(-wide // _ACROSS) > left:
            break
        camera = camera_of(view, max(1, wide), max(1, high))
        drawn.append(_to_braille(_stamp(knots, camera)))
        left -= len(drawn[-1][0]) + _GAP
    height = max((len(lines) for lines in drawn), default=0)
    filled = [lines + [" " * len(lines[0])] * (height - len(lines)) for lines in drawn]
    return "\n".join((" " * _GAP).join(parts).rstrip() for parts in zip(*filled, strict=True))


def _stamp(knots: Knots, camera: Camera) -> Mask:
    """(H, W) what discs along the centre lines cover: the tube's shadow, to a dot."""
    dark = np.zeros((camera.height, camera.width), dtype=bool)
    for knot in knots.knots:
        at = camera.project(knot.points)
        radius = knots.radius_mm * camera.magnify(knot.points) / float(np.linalg.norm(camera.du))
        radius = np.minimum(radius, float(np.hypot(*dark.shape)))
        dots, wide = _resample(at, radius)
        reach = int(np.ceil(wide.max(initial=0.0)))
        shifts = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
        middle = np.round(dots).astype(np.int64)
        # (points, shifts): whether that dot's middle lies under the tube
        u, v = (middle[:, None, k] + shifts[None, :, k] for k in (0, 1))
        under = np.hypot(u - dots[:, :1], v - dots[:, 1:]) <= np.maximum(wide, 0.5)[:, None]
        under &= (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        dark[v[under], u[under]] = True
    return dark


def _resample(at: Array, radius: Array) -> tuple[Array, Array]:
    """Points (n, 2) along a closed line, two thirds of a dot apart, and their radii."""
    rows = np.column_stack([at, radius])
    rows = np.concatenate([rows, rows[:1]])
    along = arc_lengths(at)
    wanted = np.arange(0.0, along[-1], 2 / 3) if along[-1] else np.zeros(1)
    x, y, wide = (np.interp(wanted, along, column) for column in rows.T)
    return np.column_stack([x, y]), wide


def _to_braille(dark: Mask) -> list[str]:
    height, width = dark.shape
    whole: NDArray[np.bool_] = np.zeros(
        (-(-height // _DOWN) * _DOWN, -(-width // _ACROSS) * _ACROSS), dtype=bool
    )
    whole[:height, :width] = dark
    cells = whole.reshape(len(whole) // _DOWN, _DOWN, -1, _ACROSS)
    codes = np.einsum("rdca,da->rc", cells.astype(np.int64), _BITS)
    return ["".join(chr(0x2800 + int(code)) for code in row) for row in codes]
