"""A tube seen from the side, as a small shaded picture for the films: spheres along it in a z-buffer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array

_FINER = 2  # pixels a side of one in the picture
_APART = 0.12  # tube radii between spheres
_LIGHT = np.array([-0.42, 0.55, 0.72])  # from above to the left, in the viewer's axes
_COLOR = np.array([206.0, 124.0, 82.0])
_PAPER = 255.0
_HAZE = 0.45  # the share of the paper's colour on the furthest parts


def beside(left: Image.Image, right: Image.Image) -> Image.Image:
    """Return two pictures as one, on white, as high as the left one."""
    both = Image.new("RGB", (left.width + right.width, left.height), "white")
    both.paste(left, (0, 0))
    both.paste(right, (left.width, 0))
    return both


def side_view(
    curves: Sequence[Array], radius: float, reach: float, size: int, turn_deg: float
) -> Image.Image:
    """Return the tube about closed curves, turned about the vertical axis and seen without perspective.

    Args:
        curves: vertices [(n, 3)] mm, scene coordinates.
        reach: half the side of the square that is shown, mm.
        size: of the picture, px.
        turn_deg: 0 looks from the light.
    """
    large, a = _FINER * size, np.deg2rad(turn_deg)
    scale = 0.5 * large / reach
    middles = np.concatenate([_dense(curve, _APART * radius) for curve in curves])
    x = middles[:, 0] * np.cos(a) - middles[:, 2] * np.sin(a)
    z = middles[:, 0] * np.sin(a) + middles[:, 2] * np.cos(a)
    column = 0.5 * large + scale * x
    row = 0.5 * large - scale * middles[:, 1]
    side = int(np.ceil(scale * radius)) + 1
    u, v = np.meshgrid(np.arange(-side, side + 1), np.arange(-side, side + 1))
    # each sphere about the pixel that holds its middle; the rest of the way is taken off the offsets
    du = u.ravel()[None] + (np.round(column) - column)[:, None]
    dv = v.ravel()[None] + (np.round(row) - row)[:, None]
    rest = 1.0 - (du**2 + dv**2) / (scale * radius) ** 2
    columns = np.round(column).astype(int)[:, None] + u.ravel()[None]
    rows = np.round(row).astype(int)[:, None] + v.ravel()[None]
    inside = (rest > 0) & (columns >= 0) & (columns < large) & (rows >= 0) & (rows < large)
    front = np.sqrt(np.where(inside, rest, 0.0))
    near = z[:, None] + radius * front
    shade = (du * _LIGHT[0] - dv * _LIGHT[1]) / (scale * radius) + front * _LIGHT[2]
    shade = 0.35 + 0.65 * np.clip(shade / np.linalg.norm(_LIGHT), 0.0, 1.0)
    haze = _HAZE * np.clip(0.5 - 0.5 * near / reach, 0.0, 1.0)
    ink = (shade * (1 - haze))[..., None] * _COLOR + (haze * _PAPER)[..., None]
    order = np.argsort(near[inside], kind="stable")  # the nearest is written last
    sheet = np.full((large, large, 3), _PAPER)
    sheet[rows[inside][order], columns[inside][order]] = ink[inside][order]
    picture = Image.fromarray(sheet.astype(np.uint8))
    return picture.resize((size, size), Image.Resampling.BOX)


def _dense(curve: Array, spacing: float) -> Array:
    """Return points along a closed polyline, none further apart than `spacing`."""
    ahead = np.roll(curve, -1, axis=0)
    most = float(np.linalg.norm(ahead - curve, axis=1).max())
    share = np.arange(max(1, int(np.ceil(most / spacing))))[:, None, None]
    return np.asarray((curve + (ahead - curve) * share / len(share)).reshape(-1, 3))


def write_gif(path: Path, images: Sequence[Image.Image], frame_ms: int) -> None:
    """Write `images` (all of one size) as an endless GIF, each shown for `frame_ms`."""
    palette = [image.convert("P", palette=Image.Palette.ADAPTIVE) for image in images]
    palette[0].save(
        path, format="GIF", save_all=True, append_images=palette[1:], duration=frame_ms, loop=0
    )
