"""Effects that shift a shadow: sag on the mount, and printed layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.effects.base import Effect, EffectContext, Shadows
from knotfab.effects.penumbra import blurs_mm
from knotfab.geometry.polylines import Polylines
from knotfab.scene.camera import view_axes
from knotfab_formats.scene import VERIFIED_PX, ResolvedView
from knotfab_formats.verdict import Sag

OF_STRAND = 1 / 8  # an invisible shift is this share of a strand's shadow,
OF_BLUR = 1 / 4  # plus this share of its blur
_UNIT_MM = 1e-3  # a move so small that the shift is linear in it


def sag_magnitude(context: EffectContext) -> float:
    """Return the largest shift of any strand's shadow, px; 0 for a piece without a mount."""
    if context.moves is None or len(context.moves) == 0:
        return 0.0
    return max(
        float(shifts_mm(seen, context.moves[None], context.radius).max()) / seen.view.pixel_mm
        for seen in context.shadows
    )


def shifts_mm(shadows: Shadows, moves: Array, radius: float) -> Array:
    """Bound the shifts of shadows within `radius` of places (N, 3), mm, (m, N).

    `moves` are (m, N, 3) in the scene, or (m, 1, 3) where all places move alike. By similar
    triangles, the shadow of a point at height h under a lamp at height H that moves by u, u_n of it
    towards the lamp, shifts by

        H / (H - h - u_n) |u_t + u_n w|,   w = (x - l) / (H - h) along the wall.

    On the tube's surface h is larger by r, and w by at most r / (H - h - r) (1 + |w|).
    """
    lamp, towards = shadows.wall.lamp, moves @ shadows.wall.axes.T
    ray = shadows.places - lamp
    below = np.maximum(-ray[:, 2], 1e-9)
    x, y = ray[:, 0] / below, ray[:, 1] / below
    nearer = np.abs(towards[..., 2])
    near = np.maximum(below - radius - nearer, 1e-9)
    along = np.hypot(towards[..., 0] + towards[..., 2] * x, towards[..., 1] + towards[..., 2] * y)
    leaning = nearer * radius / near * (1 + np.hypot(x, y))
    return np.asarray(lamp[2] / near * (along + leaning))


def measure_sag(
    view: ResolvedView, mask: Mask, points: Array, moves: Array, rings: Polylines, radius: float
) -> Sag:
    """Measure the IoU of the knots' shadow with a mask (H, W), as designed and as sagged.

    `widest_px` of the result: the furthest that a centre line's shadow is shifted.
    """
    from knotfab.render.image import image_at

    image = image_at(view, mask, radius, VERIFIED_PX)
    shift = shifts_mm(Shadows.from_points(view, points), moves[None], 0.0).max()
    widest = float(shift) / view.pixel_mm
    wanted = image.target > 0.5

    def iou(points: Array) -> float:
        seen = image.seen(points, rings, radius)
        return float((seen & wanted).sum() / max((seen | wanted).sum(), 1))

    return Sag(widest_px=widest, iou=iou(points + moves), iou_designed=iou(points))


def allow_sag_mm(views: Sequence[ResolvedView], points: Array, radius: float) -> float:
    """Return how far points (N, 3) of centre lines may move without a visible change of shadow, mm.

    A strand's shadow is at least w = 2 r H / (H - h) wide. Shifted by s, it still covers 1 - s / w of its
    place. While that is 7/8, no gap and no strand of the picture, which are as wide, comes or goes,
    and nobody has another shadow to compare it with. The lamp blurs its edges over b: where such an edge
    is steepest, 4 / (pi b) of a disc, a shift by b / 4 changes the light by less than a third, and the
    eye is no surer of where it lies. So s = w / 8 + b / 4 is allowed, to each place by itself. What moves
    by u shifts its shadow by H / (H - h) sqrt(1 + t²) u at most, t the slope of the lamp's ray to the
    wall's normal: the least quotient, of all places and views, is what any of them may move.
    """
    least = np.inf
    for view in views:
        seen = Shadows.from_points(view, points)
        aside, towards = (
            shifts_mm(seen, _UNIT_MM * seen.wall.axes[k][None, None], 0.0)[0] / _UNIT_MM
            for k in (0, 2)
        )
        seen_mm = OF_STRAND * 2 * radius * aside + OF_BLUR * blurs_mm(seen, radius)
        least = min(least, float((seen_mm / np.hypot(aside, towards)).min()))
    return least


SAG = Effect(
    "sag",
    "px",
    sag_magnitude,
    2.0,  # half a pixel, at standard accuracy
    "the piece bends under its own weight",
)


# Layers: a printed part is a stack of slices whose steps show in its outline.


def layers_magnitude(context: EffectContext) -> float:
    """Return the largest shift of a shadow by half a layer, px; 0 while the print pose is unknown.

    Each slice of thickness h has the part's section at its middle, so each point of the stack lies within
    h / 2 above or below one of the part, and the other way round. Only the rim of a round tube of radius r
    may be missed, by up to r - sqrt(r² - h² / 4), about h² / 8r. So no outline moves further than moving the
    strands by h / 2 along the printer's z moves it, h / 2 M sin of the angle between that and the ray, plus
    M h² / 8r.
    """
    upwards, height = context.upwards, context.world.printer.layer_height_mm
    radius = context.radius
    if upwards is None or len(context.points) == 0:
        return 0.0

    def shift(seen: Shadows) -> float:
        across = view_axes(seen.view)[1]
        moves = np.array([0.5 * height * upwards, height**2 / (8 * radius) * across])
        each = shifts_mm(seen, moves[:, None], radius)
        return float(each.sum(axis=0).max()) / seen.view.pixel_mm

    return max(shift(seen) for seen in context.shadows)


LAYERS = Effect(
    "layers",
    "px",
    layers_magnitude,
    2.0,  # half a pixel, at standard accuracy
    "the steps of its layers show in the outline",
)
