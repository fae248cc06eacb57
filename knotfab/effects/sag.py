"""Sag: the piece bends under its own weight on its mount, and its shadow with it."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array, Mask
from knotfab.effects.base import VERIFIED_PX, Effect, EffectContext, OnWall
from knotfab.geometry.polylines import Polylines
from knotfab.scene.curved_wall import CurvedWall
from knotfab.scene.model import ResolvedView

__all__ = ["SAG", "measure_sag", "shifts_mm"]


def magnitude(context: EffectContext) -> float:
    """The furthest that any strand's shadow is shifted, px; 0 of a piece without a mount."""
    if context.moves is None or len(context.moves) == 0:
        return 0.0
    return max(
        float(shifts_mm(view, context.points, context.moves, context.radius).max())
        / (view.longer_mm / VERIFIED_PX)
        for view in context.views
    )


def shifts_mm(view: ResolvedView, points: Array, moves: Array, radius: float) -> Array:
    """(.., N) bounds of how far shadows of what is within `radius` of points (N, 3) are shifted.

    By moves (.., N, 3), or (.., 1, 3) of all points alike.

    A point at height h under a lamp at height H that moves by u, u_n of it towards the lamp, casts its shadow

        H / (H - h - u_n) |u_t + u_n w|,   w = (x - l) / (H - h) along the wall,

    aside: similar triangles. On the tube's surface h is larger by r, and w by r / (H - h - r) (1 + |w|), at
    most. A round wall is taken for the plane that touches it where the point's shadow falls; where the
    surface's falls, and is shifted to, that leans by as much as they lie aside over the wall's radius.
    """
    wall = OnWall.of(view)
    place, move = wall.place(points), wall.axes @ moves.swapaxes(-1, -2)
    foot, axes, _ = wall.touching(place)
    ray, move = (np.einsum("ijn,...jn->...in", axes, v) for v in (place - wall.lamp[:, None], move))
    along, towards = move[..., :2, :], move[..., 2, :]
    high = np.einsum("jn,jn->n", axes[2], wall.lamp[:, None] - foot)
    below = np.maximum(-ray[2], 1e-9)
    across = ray[:2] / below
    near = np.maximum(below - radius - np.abs(towards), 1e-9)
    shift = np.linalg.norm(along + towards[..., None, :] * across, axis=-2)
    slope = np.linalg.norm(across, axis=0)
    leaning = np.abs(towards) * radius / near * (1 + slope)
    found = high / near * (shift + leaning)
    if wall.round is not None:
        aside = found + high / near * radius * np.hypot(1, slope)
        found = found * (1 + slope * aside / abs(wall.round.radius)) ** 2
    return np.asarray(found)


def measure_sag(
    view: ResolvedView,
    mask: Mask,
    points: Array,
    moves: Array,
    rings: Polylines,
    radius: float,
    wall: CurvedWall | None = None,
) -> dict[str, float]:
    """IoU of the knots' own shadow with a picture's mask (H, W) as they are designed and as they sag.

    `widest_px`: the furthest that a centre line's shadow is shifted. `wall`: the round one that the shadow
    falls on, the mask being its picture as the flat wall that touches it has it; there each place counts by
    the area that it stands for on the round one, as light is straight.
    """
    from knotfab.render.picture import image_at, seen_in

    image = image_at(view, mask, radius, VERIFIED_PX)
    widest = float(shifts_mm(view, points, moves, 0.0).max()) / (view.longer_mm / VERIFIED_PX)
    wanted = np.asarray(image.target) > 0.5
    pixel_mm, columns = image.sheet.pixel_mm, wanted.shape[1]
    areas = np.ones(columns)
    if wall is not None:
        areas = wall.areas((np.arange(columns) - 0.5 * (columns - 1)) * pixel_mm, 0.5 * pixel_mm)

    def iou(points: Array) -> float:
        seen = np.asarray(seen_in(points, rings, image.frame, image.target, radius))
        return float(((seen & wanted) @ areas).sum() / max(((seen | wanted) @ areas).sum(), 1e-12))

    return {"widest_px": widest, "iou": iou(points + moves), "iou_designed": iou(points)}


SAG = Effect(
    "sag",
    "px",
    magnitude,
    2.0,  # half a pixel, at standard accuracy
    "the piece bends under its own weight",
)
