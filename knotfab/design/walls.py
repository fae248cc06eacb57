"""Map pictures for round walls to the flat wall behind or before them, so that all else sees flat walls."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.picture.read import Target
from knotfab.scene.camera import CurvedWall, require_wall
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene, ResolvedView


def flatten_targets(
    scene: ResolvedScene, views: Sequence[ResolvedView], targets: Sequence[Target]
) -> tuple[Target, ...]:
    """Map the targets from round walls to flat ones, if the walls are round enough to matter.

    Light is straight, so each dark point on a round wall has one dark point on the flat wall. Targets that
    have been mapped already stay as they are.

    Raises:
        InputError: a wall is too narrow, does not hold the light, or moves a picture out of its frame.
    """
    # imported here, for these load numba, which refused calls do not need
    from knotfab.effects.base import EffectContext, decide
    from knotfab.effects.shifts import WALL

    for view in views:
        require_wall(view)
    tolerance = scene.settings.tolerance_px
    context = EffectContext(tuple(views), np.zeros((0, 3)), 0.0, tolerance)
    if not decide(WALL, context, dict(scene.effects)).simulated:
        return tuple(targets)
    return tuple(_flatten(v, t) for v, t in zip(views, targets, strict=True))


def _flatten(view: ResolvedView, target: Target) -> Target:
    # imported here, for refused calls do not need it
    from scipy.ndimage import map_coordinates

    wall = CurvedWall.from_view(view)
    if wall is None or target.flattened_s is not None:
        return target
    begun = time.perf_counter()
    _require_inside(view, wall, target)
    columns, rows = (
        np.arange(target.width, dtype=float),
        np.arange(target.height, dtype=float)[:, None],
    )
    top, bottom = (
        to_pixels(view, target, wall.unroll(_to_wall(view, target, ends)))
        for ends in (np.column_stack([columns, np.full_like(columns, row)]) for row in (0.0, 1.0))
    )
    # each column maps linearly, so two of its places suffice
    down = top[:, 1] + rows * (bottom - top)[:, 1]
    at = np.nan_to_num(np.stack([down, np.broadcast_to(top[:, 0], down.shape)]), nan=-9.0)

    def look_up(mask: Mask) -> Mask:
        shares = map_coordinates(mask.astype(np.float32), at, order=1)
        return np.asarray(shares >= 0.5)

    mask = look_up(target.mask)
    if not mask.any():
        raise InputError(
            f"picture {target.shown}", "nothing of it is left on the wall", "Use a bolder picture"
        )
    return replace(
        target,
        mask=mask,
        original=None if target.original is None else look_up(target.original),
        widened=None if target.widened is None else look_up(target.widened),
        drawing=target.mask,
        rule=f"{target.rule}; as the flat wall has it that touches the round one",
        flattened_s=time.perf_counter() - begun,
    )


def _require_inside(view: ResolvedView, wall: CurvedWall, target: Target) -> None:
    """Refuse a picture that leaves its frame on the flat wall, as one for a hollow wall may."""
    rows, columns = (np.flatnonzero(target.mask.any(axis=axis)) for axis in (1, 0))
    mask = target.mask[rows]
    first, last = mask.argmax(axis=1), target.width - 1 - mask[:, ::-1].argmax(axis=1)
    mask = target.mask[:, columns]
    top, bottom = mask.argmax(axis=0), target.height - 1 - mask[::-1].argmax(axis=0)
    # the ends of every row and column suffice: what is between them stays between them
    pairs = ((first, rows), (last, rows), (columns, top), (columns, bottom))
    drawn = np.concatenate([np.column_stack(pair) for pair in pairs]).astype(np.float64)
    flat = _to_flat(view, wall, target, drawn)
    size = np.array([target.width, target.height])
    over = np.abs(flat - (size - 1) / 2) - size / 2
    most = over.max(axis=0)
    if (most > 0).any():
        margin = np.ceil(np.maximum(most, 0)).astype(int) + 1
        raise InputError(
            f"picture {target.shown}",
            f"light that draws its edge on the hollow wall passes {most.max():.0f} px outside its frame on "
            "the flat wall behind",
            f"Leave {margin[0]} px free at both sides and {margin[1]} px above and below, or make "
            "wall_radius_mm larger",
        )


def _to_flat(view: ResolvedView, wall: CurvedWall, target: Target, pixels: Array) -> Array:
    """Map pixels (n, 2) of the round wall's picture to the flat wall's."""
    return to_pixels(view, target, wall.flatten(_to_wall(view, target, pixels)))


def _to_wall(view: ResolvedView, target: Target, pixels: Array) -> Array:
    """Map pixels (n, 2) to mm right of and above the point where the view's axis meets its wall, (n, 2)."""
    wide, high = view.frame_mm
    right = (pixels[:, 0] - (target.width - 1) / 2) * wide / target.width
    down = (pixels[:, 1] - (target.height - 1) / 2) * high / target.height
    return np.column_stack([right, view.frame_up_mm - down])


def to_pixels(view: ResolvedView, target: Target, places: Array) -> Array:
    """Map places (n, 2) on the wall, mm right of and above its middle, to pixels; inverts `_to_wall`."""
    wide, high = view.frame_mm
    across = places[:, 0] * target.width / wide + (target.width - 1) / 2
    down = (view.frame_up_mm - places[:, 1]) * target.height / high + (target.height - 1) / 2
    return np.column_stack([across, down])
