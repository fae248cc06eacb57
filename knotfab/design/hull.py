"""What several pictures leave of each other: the visual hull's own shadows against the pictures.

The visual hull (Laurentini 1994) is the largest body that spills in no view. Its shadow in a view is
all of that picture that any part which spills nowhere can draw, so its IoU is a bound that such a
part cannot beat; what is missing from it are contradictions between the pictures (Mitra & Pauly
2009). It is found by following each pixel's ray, with no voxels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation

from knotfab.arrays import Array, Mask
from knotfab.scene.camera import Camera

__all__ = ["HullBound", "hull_bounds", "inside_hull"]


_RAYS_PX = 192  # longer side of the grid of rays
_STEPS = 240  # samples of a ray


@dataclass(frozen=True)
class HullBound:
    """One view's share of the hull.

    `covered` and `wanted` are (h, w) on a coarse grid of the view's frame: the hull's shadow and the
    picture. `iou` is theirs. `low` and `high` (3,): the extents in mm of the hull's points met.
    """

    covered: Mask
    wanted: Mask
    iou: float
    low: Array
    high: Array


def inside_hull(points: Array, cameras: Sequence[Camera], masks: Sequence[Mask]) -> Mask:
    """Which of the points (n, 3), mm, lie in every picture's silhouette; outside a frame is outside."""
    inside = np.ones(len(points), dtype=bool)
    for camera, mask in zip(cameras, masks, strict=True):
        left = np.flatnonzero(inside)
        if len(left) == 0:
            break
        inside[left] = _look_up(camera, mask, points[left])
    return inside


def _look_up(camera: Camera, mask: Mask, points: Array) -> Mask:
    p = camera.projection
    h = points @ p[:, :3].T + p[:, 3]
    before = h[:, 2] > 0
    w = np.where(before, h[:, 2], 1.0)
    u = np.rint(h[:, 0] / w).astype(np.int64)
    v = np.rint(h[:, 1] / w).astype(np.int64)
    rows, columns = mask.shape
    seen = before & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    seen[seen] = mask[v[seen], u[seen]]
    return np.asarray(seen)


def hull_bounds(
    cameras: Sequence[Camera], masks: Sequence[Mask], reach_mm: float
) -> tuple[HullBound, ...]:
    """The bound of each view, in their order.

    Args:
        cameras: one a view, at its mask's resolution.
        masks: silhouettes (H, W).
        reach_mm: half the length of ray that is followed, about the point nearest to the origin.

    The other masks are widened by half a sample's distance, and a pixel of the coarse grid counts where
    its middle is drawn, so that sampling takes nothing from the bound.
    """
    step = 2 * reach_mm / _STEPS
    wide = []
    for camera, mask in zip(cameras, masks, strict=True):
        # half a step, as it is seen where the frame stands
        cells = int(np.ceil(0.5 * step / min(np.linalg.norm(camera.du), np.linalg.norm(camera.dv))))
        wide.append(_widen(mask, cells))
    return tuple(
        _bound(
            camera,
            mask,
            [(c, w) for k, (c, w) in enumerate(zip(cameras, wide, strict=True)) if k != n],
            reach_mm,
        )
        for n, (camera, mask) in enumerate(zip(cameras, masks, strict=True))
    )


def _widen(mask: Mask, cells: int) -> Mask:
    around = np.add.outer(np.arange(-cells, cells + 1) ** 2, np.arange(-cells, cells + 1) ** 2)
    return np.asarray(binary_dilation(mask, around <= cells * cells))


def _bound(
    camera: Camera, mask: Mask, others: list[tuple[Camera, Mask]], reach_mm: float
) -> HullBound:
    rows, columns = mask.shape
    every = max(1.0, max(rows, columns) / _RAYS_PX)
    u = np.arange(0.5 * every - 0.5, columns - 0.5, every)
    v = np.arange(0.5 * every - 0.5, rows - 0.5, every)
    wanted = mask[np.ix_(np.rint(v).astype(int), np.rint(u).astype(int))]
    at = np.argwhere(wanted)
    covered = np.zeros_like(wanted)
    on = camera.corner + u[at[:, 1], None] * camera.du + v[at[:, 0], None] * camera.dv
    ray = on - camera.eye
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    nearest = -(ray @ camera.eye)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    met = np.zeros(len(at), dtype=bool)
    for along in np.linspace(-reach_mm, reach_mm, _STEPS):
        points = camera.eye + (nearest + along)[:, None] * ray
        inside = inside_hull(points, [c for c, _ in others], [w for _, w in others])
        if inside.any():
            met |= inside
            low = np.minimum(low, points[inside].min(0))
            high = np.maximum(high, points[inside].max(0))
    covered[at[met, 0], at[met, 1]] = True
    iou = float(covered.sum() / max(1, wanted.sum()))
    return HullBound(covered, wanted, iou, low, high)
