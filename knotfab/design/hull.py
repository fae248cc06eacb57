"""Compute the visual hull of several pictures, and how much of each its shadow draws.

The visual hull (Laurentini 1994) is the largest body that spills in no view. A part that spills nowhere draws
no more of a picture than the hull's shadow does, so the shadow's IoU bounds the part's. What the shadow lacks
are contradictions between the pictures (Mitra & Pauly 2009). It is found by following each pixel's ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled
from knotfab.scene.camera import Camera, Plane
from knotfab_formats.views import View


@dataclass(frozen=True)
class HullBound:
    """The hull's shadow in one view, against the view's picture.

    `covered` (the shadow) and `wanted` (the picture) are (h, w) on a coarse grid of the frame; `iou` is
    theirs. `low` and `high`, (3,) mm, bound the hull's points found; infinite if they were not asked for.
    """

    covered: Mask
    wanted: Mask
    iou: float
    low: Array
    high: Array

    @property
    def deepest(self) -> float:
        """Depth of the deepest place of the picture that is not covered, over the picture's longer side."""
        lacking = self.wanted & ~self.covered
        if not lacking.any():
            return 0.0
        away = distance_transform_edt(np.pad(~self.covered, 1))[1:-1, 1:-1]
        return float(away[lacking].max() / max(lacking.shape))


def hull_bounds(
    cameras: Sequence[Camera],
    masks: Sequence[Mask],
    reach_mm: float,
    rays_px: int = 192,
    steps: int = 240,
    ends: bool = False,
    wider: float = 0.0,
    walls: Sequence[Plane] = (),
    extents: bool = True,
) -> tuple[HullBound, ...]:
    """Return the hull's bound of each view, in the views' order.

    The other masks are widened by half the distance between samples, so that sampling never lowers a bound.

    Args:
        cameras: one a view, at its mask's resolution.
        masks: silhouettes (H, W).
        reach_mm: half the length of the rays, centred on their points nearest to the origin.
        rays_px: longer side of the grid of rays. steps: samples of a ray.
        ends: whether the screens end at the frames, so that shadows beside a frame do not count as spilled.
        wider: further widening of the other masks, as a share of their heights.
        walls: planes behind which nothing stands, as `walls_of` gives them.
        extents: whether to compute `low` and `high`, which takes longer.
    """
    step = 2 * reach_mm / steps
    wide = []
    for camera, mask in zip(cameras, masks, strict=True):
        # half a step, as it is seen where the frame stands
        cells = int(np.ceil(0.5 * step / min(np.linalg.norm(camera.du), np.linalg.norm(camera.dv))))
        reach = cells + round(wider * len(mask))
        wide.append(np.asarray(_distance_from(mask.tobytes(), mask.shape) <= reach))
    return tuple(
        _bound(
            camera,
            mask,
            [(c, w) for k, (c, w) in enumerate(zip(cameras, wide, strict=True)) if k != n],
            reach_mm,
            rays_px,
            steps,
            ends,
            walls,
            extents,
        )
        for n, (camera, mask) in enumerate(zip(cameras, masks, strict=True))
    )


def contradictions(views: Sequence[View], bounds: Sequence[HullBound]) -> list[str]:
    """Describe, for each view with a low bound, how low it is and where most of its picture is missing."""
    lines = []
    for view, bound in zip(views, bounds, strict=True):
        if bound.iou >= 0.97:  # too little to mention
            continue
        missing = bound.wanted & ~bound.covered
        share = missing.sum() / max(1, bound.wanted.sum())
        rows, columns = np.nonzero(missing)
        height, width = missing.shape
        up = "top" if rows.mean() < height / 3 else "bottom" if rows.mean() > 2 * height / 3 else ""
        side = "left" if columns.mean() < width / 3 else ""
        side = "right" if columns.mean() > 2 * width / 3 else side
        where = " ".join(word for word in (up, side) if word) or "middle"
        line = (
            f"view {view.name}: the other pictures leave no room for {share:.1%} of its silhouette, "
            f"most of it at the {where}: its IoU can be {bound.iou:.3f} at best without spilling elsewhere"
        )
        if bound.iou < 0.9:
            line += ". Use pictures whose silhouettes fill the same heights, or other azimuths"
        lines.append(line)
    return lines


@lru_cache(maxsize=16)  # moving views asks again for the same masks
def _distance_from(mask: bytes, shape: tuple[int, int]) -> Array:
    """Return the distance of each pixel from the mask, px."""
    drawn = np.frombuffer(mask, dtype=np.bool_).reshape(shape)
    return np.asarray(distance_transform_edt(~drawn), dtype=np.float32)


def _bound(
    camera: Camera,
    mask: Mask,
    others: list[tuple[Camera, Mask]],
    reach_mm: float,
    rays_px: int,
    steps: int,
    ends: bool,
    walls: Sequence[Plane],
    extents: bool,
) -> HullBound:
    rows, columns = mask.shape
    every = max(1.0, max(rows, columns) / rays_px)
    u = np.arange(0.5 * every - 0.5, columns - 0.5, every)
    v = np.arange(0.5 * every - 0.5, rows - 0.5, every)
    at_v, at_u = (np.minimum(np.rint(p).astype(int), n - 1) for p, n in ((v, rows), (u, columns)))
    wanted = mask[np.ix_(at_v, at_u)]
    at = np.argwhere(wanted)
    covered = np.zeros_like(wanted)
    on = camera.corner + u[at[:, 1], None] * camera.du + v[at[:, 0], None] * camera.dv
    begin, ray = rays_within(camera, on, reach_mm, walls)
    met, low, high = follow_rays(
        begin,
        ray,
        np.linspace(-1.0, 1.0, steps) if extents else places_outwards(steps),
        np.array([c.projection for c, _ in others]).reshape(-1, 3, 4),
        np.array([w.shape for _, w in others], dtype=np.int64).reshape(-1, 2),
        np.concatenate([w.ravel() for _, w in others]) if others else np.zeros(0, dtype=np.bool_),
        ends,
        extents,
    )
    covered[at[met, 0], at[met, 1]] = True
    iou = float(covered.sum() / max(1, wanted.sum()))
    return HullBound(covered, wanted, iou, low, high)


def rays_within(
    camera: Camera, on: Array, reach_mm: float, walls: Sequence[Plane]
) -> tuple[Array, Array]:
    """Return the midpoints and half vectors, (n, 3), of rays from the eye to points `on` of the receiver.

    Each ray is a segment that extends `reach_mm` to both sides of its point nearest to the origin, and ends
    at the walls.
    """
    ray = on - camera.eye
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    begin = camera.eye - (ray @ camera.eye)[:, None] * ray
    near, far = np.full(len(ray), -reach_mm), np.full(len(ray), reach_mm)
    for *normal, offset in walls:
        along, height = ray @ normal, begin @ normal + offset
        # keep rays parallel to the wall from dividing by zero
        along = np.where(np.abs(along) > 1e-9, along, 1e-9)
        ends = -height / along
        near = np.where(along > 0, np.maximum(near, ends), near)
        far = np.where(along > 0, far, np.minimum(far, ends))
    half = np.maximum(0.5 * (far - near), 0.0)[:, None]
    return begin + (0.5 * (near + far))[:, None] * ray, half * ray


def places_outwards(steps: int) -> Array:
    """Return even places from -1 to 1, ordered from the middle outwards, (steps,)."""
    every = np.linspace(-1.0, 1.0, steps)
    return np.asarray(every[np.argsort(np.abs(every), kind="stable")])


@compiled
def follow_rays(
    begin: Array,
    ray: Array,
    along: Array,
    projections: Array,
    shapes: Indices,
    masks: Mask,
    ends: bool = False,
    extents: bool = True,
) -> tuple[Mask, Array, Array]:
    """Find the rays `begin + along * ray`, (n, 3), that meet the hull, and the bounding box of those points.

    A point is in the hull if it is within all masks. For the box each ray is followed from both ends to its
    first point there. Homogeneous pixel coordinates are linear in `along`.

    Args:
        along: (k,) samples, in ascending order for the box.
        projections: (m, 3, 4) of the masks' cameras. shapes: (m, 2). masks: all masks, concatenated flat.
        ends: whether places beside a mask count as within it. extents: whether to compute the box.
    """
    met = np.zeros(len(ray), dtype=np.bool_)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    back = along[::-1].copy() if extents else along[:0]
    at, by = np.empty((len(shapes), 3)), np.empty((len(shapes), 3))
    for n in range(len(ray)):
        for k in range(len(shapes)):
            for i in range(3):
                p = projections[k, i]
                at[k, i] = p[0] * begin[n, 0] + p[1] * begin[n, 1] + p[2] * begin[n, 2] + p[3]
                by[k, i] = p[0] * ray[n, 0] + p[1] * ray[n, 1] + p[2] * ray[n, 2]
        for steps in (along, back):
            for a in steps:
                inside, first = True, 0
                for k in range(len(shapes)):
                    w = at[k, 2] + a * by[k, 2]
                    if w <= 0:
                        inside = False
                        break
                    w = 1.0 / w
                    u = (at[k, 0] + a * by[k, 0]) * w + 0.5
                    v = (at[k, 1] + a * by[k, 1]) * w + 0.5
                    rows, columns = shapes[k]
                    if u < 0 or v < 0 or u >= columns or v >= rows:
                        inside = ends
                    else:
                        inside = masks[first + int(v) * columns + int(u)]
                    if not inside:
                        break
                    first += rows * columns
                if inside:
                    met[n] = True
                    if extents:
                        for i in range(3):
                            x = begin[n, i] + a * ray[n, i]
                            low[i], high[i] = min(low[i], x), max(high[i], x)
                    break
            if not met[n]:
                break
    return met, low, high
