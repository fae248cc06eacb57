"""The visual hull of several pictures: its own shadows against the pictures.

The visual hull (Laurentini 1994) is the largest body that spills in no view. Its shadow in a view is
all of that picture that any part which spills nowhere can draw, so its IoU is a bound that such a
part cannot beat; what is missing from it are contradictions between the pictures (Mitra & Pauly
2009). It is found by following each pixel's ray, with no voxels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt
from shapely import MultiPolygon

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled
from knotfab.base.errors import SceneError
from knotfab.design.candidates import DEPTH_RATIO
from knotfab.limits.region import region_mesh
from knotfab.scene.camera import Camera, Plane, view_axes
from knotfab_formats.bounds import MOST_MM
from knotfab_formats.piece import Mount, Region
from knotfab_formats.scene import LIGHT_SHARE, WALL_SHARE, ResolvedView, SettledRegion
from knotfab_formats.views import View


@dataclass(frozen=True)
class HullBound:
    """One view's share of the hull.

    `covered` and `wanted` are (h, w) on a coarse grid of the view's frame: the hull's shadow and the
    picture. `iou` is theirs. `low` and `high` (3,): the extents in mm of the hull's points met; infinite
    where these were not asked for.
    """

    covered: Mask
    wanted: Mask
    iou: float
    low: Array
    high: Array


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
    """Return the bound of each view, in their order.

    Args:
        cameras: one a view, at its mask's resolution.
        masks: silhouettes (H, W).
        reach_mm: half the length of ray that is followed, about the point nearest to the origin.
        rays_px: longer side of the grid of rays. steps: samples of a ray.
        ends: whether what another view sees beside its frame spills nowhere: its screen ends there.
        wider: by how much the other masks are widened, in shares of their heights.
        walls: behind which nothing stands, as of `walls_of`.
        extents: whether these are asked for; a ray is left at the first point met otherwise.

    The other masks are widened by half a sample's distance, and a pixel of the coarse grid counts where
    its middle is drawn, so that sampling takes nothing from the bound.
    """
    step = 2 * reach_mm / steps
    wide = []
    for camera, mask in zip(cameras, masks, strict=True):
        # half a step, as it is seen where the frame stands
        cells = int(np.ceil(0.5 * step / min(np.linalg.norm(camera.du), np.linalg.norm(camera.dv))))
        wide.append(_widen(mask, cells + round(wider * len(mask))))
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
    """Return a sentence for each view whose bound is low: how low, and where most is missing."""
    lines = []
    for view, bound in zip(views, bounds, strict=True):
        if bound.iou >= 0.97:  # too little to be told
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


def _widen(mask: Mask, cells: int) -> Mask:
    """Return the mask and all within so many pixels of it."""
    return np.asarray(_beyond(mask.tobytes(), mask.shape) <= cells)


@lru_cache(maxsize=16)  # views are moved, and their masks stay
def _beyond(mask: bytes, shape: tuple[int, int]) -> Array:
    """Measure how far pixels are from a mask, px."""
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
        np.linspace(-1.0, 1.0, steps) if extents else outwards(steps),
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
    """Return middles and halves (n, 3) of the lines through the eye and points `on` (n, 3) of the receiver.

    Each reaches `reach_mm` to both sides of its point nearest to the origin, or as far as the walls let it.
    """
    ray = on - camera.eye
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    begin = camera.eye - (ray @ camera.eye)[:, None] * ray
    near, far = np.full(len(ray), -reach_mm), np.full(len(ray), reach_mm)
    for *normal, offset in walls:
        along, height = ray @ normal, begin @ normal + offset
        # a ray beside the wall meets it nowhere
        along = np.where(np.abs(along) > 1e-9, along, 1e-9)
        ends = -height / along
        near = np.where(along > 0, np.maximum(near, ends), near)
        far = np.where(along > 0, far, np.minimum(far, ends))
    half = np.maximum(0.5 * (far - near), 0.0)[:, None]
    return begin + (0.5 * (near + far))[:, None] * ray, half * ray


def outwards(steps: int) -> Array:
    """Order so many places from -1 to 1, those in the middle first."""
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
    """Find which of the rays `begin + along * ray` (n, 3) meet a point within all masks, and these points'
    box.

    The first and the last of a ray's points within all masks span what that ray adds to the box, so each ray
    is followed from its two ends. A projection of it is linear in `along`.

    Args:
        along: (k,) places; in their order, where the box is asked for.
        projections: (m, 3, 4) of the masks' cameras. shapes: (m, 2). masks: all of them, one after the other.
        ends: whether beside a mask counts as within it. extents: whether the box is asked for.
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


# Room: the region with its size settled, and how much depth there is in it for a piece of one
# view.


_FOOT_SHARE = 0.5  # of the radius: a valley is sunk so far into its plate, and stands flat there
_BACK_MM = 0.7  # of the plate stays below it
_PLATE_SHARE = 0.24  # of the frame's longer side: from the middle of a piece on a plate to the wall
_WIDER = 1.25  # the region's width over the picture's
_BESIDE_RADII = 2.0  # before and behind the centre lines


def resolve_region(
    region: Region,
    views: Sequence[ResolvedView],
    bounds: Sequence[HullBound],
    radius: float,
    mount: Mount | None = None,
) -> SettledRegion:
    """Return the region with its extents: those of the scene, or what the pictures need.

    Of one view, clear of wall and lamp, a quarter wider than the picture and turned as the view is; of
    several, the visual hull's extents about its middle, with a tube radius (mm) of play. Where the `mount`
    has the piece stand in a plate, it begins at that plate's back.

    Raises:
        InputError: a mesh is unfit. SceneError: it would be larger than any region.
    """
    known = region.model_dump()
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        size = tuple(round(float(s), 4) for s in most - least)
        return SettledRegion(**{**known, "size_mm": size})
    if region.size_mm is not None:
        return SettledRegion(**known)
    if bounds:
        known |= {"azimuth_deg": 0.0, "elevation_deg": 0.0}  # the hull's extents are the scene's
        low = np.min([b.low for b in bounds], 0)
        high = np.max([b.high for b in bounds], 0)
        x, y, z = 2 * (np.maximum(np.abs(low), np.abs(high)) + radius)
        around = {"cylinder": float(np.hypot(x, z)), "sphere": float(np.linalg.norm([x, y, z]))}
    else:
        (view,) = views
        known |= {"azimuth_deg": view.azimuth_deg, "elevation_deg": view.elevation_deg}
        x, y = (_WIDER / view.magnification * side for side in view.frame_mm)
        reach = view.reach_mm
        if mount is not None and mount.on_feet:
            reach = view.wall_distance_mm + mount.thickness_mm - _BACK_MM / 2
        z = 2.0 * reach
        widest = min(max(x, y, z), 1.9 * view.light_distance_mm)
        around = {"cylinder": widest, "sphere": widest}
    size = {
        "box": (x, y, z),
        "cylinder": (around["cylinder"], y, around["cylinder"]),
        "sphere": (around["sphere"],) * 3,
    }[region.kind]
    if max(size) > MOST_MM:
        raise SceneError(
            "the region",
            f"it would be {max(size):.6g} mm large, and the largest is {MOST_MM:g} mm",
            "Make the picture smaller (--size), or give another lamp (--lamp-distance).",
        )
    return SettledRegion(**{**known, "size_mm": tuple(round(float(s), 4) for s in size)})


def depth_extent(
    asked: float | None,
    polygon: MultiPolygon,
    region: SettledRegion,
    radius: float,
    ahead: Sequence[float] = (0.0, 0.0, 1.0),
) -> float | None:
    """Return the extent of the centre lines along the one view's axis in mm, None for a flat piece.

    Args:
        asked: the scene's depth, mm; 0: a flat piece; None: as the pictures need it.
        ahead: that axis, towards the light.

    Raises:
        SceneError: the region has no room for it.
    """
    if asked == 0:
        return None
    low_x, low_y, high_x, high_y = polygon.bounds
    usual = DEPTH_RATIO * (max(high_x - low_x, high_y - low_y) + 2 * radius)
    wanted = asked or usual
    room = most_depth_mm(0.5 * _across(region, np.asarray(ahead)), radius)
    if room <= 0:
        raise SceneError(
            "the region",
            f"a tube {2 * radius:.1f} mm thick has no room between the light and the wall",
            "Move the wall away (--wall-distance, wall_distance_mm), make the picture smaller (--size), or "
            "enlarge the region.",
        )
    if asked is not None and wanted > room + 1e-3:
        raise SceneError(
            "scene key piece.depth",
            f"{wanted:g} mm do not fit a region that is {room:.1f} mm deep for it",
            "Ask for less depth, or enlarge the region and the distance to the wall",
        )
    # an auto depth is rounded down, so that a rebuild from the number finds the same room
    return float(np.floor(min(wanted, room) * 1e4) / 1e4) if asked is None else wanted


def foot_sink_mm(mount: Mount, radius: float) -> float:
    """Return how deep the valleys of a tube (mm) are sunk into the plate that they stand in, mm."""
    return min(_FOOT_SHARE * radius, mount.thickness_mm - _BACK_MM)


def plate_wall_mm(mount: Mount, view: ResolvedView, depth: float | None, thinnest: float) -> float:
    """Return how far behind the piece's middle the wall is whose plate it stands in, mm.

    Args:
        depth: the one that is asked for, mm. thinnest: the thinnest tube's radius, mm.
    """
    asked = None if depth is None else 0.5 * depth + thinnest - foot_sink_mm(mount, thinnest)
    return round(
        min(asked or _PLATE_SHARE * view.longer_mm, LIGHT_SHARE * view.light_distance_mm), 2
    )


def plate_depth_mm(mount: Mount, view: ResolvedView, radius: float) -> float:
    """Return the extent of the centre lines of a tube whose valleys stand in the plate, mm.

    Raises:
        SceneError: the wall is too near.
    """
    depth = 2.0 * (view.wall_distance_mm + foot_sink_mm(mount, radius) - radius)
    if depth < 8.0 * radius:  # less than an arch over a neighbour
        raise SceneError(
            "scene key views.wall_distance_mm",
            f"{view.wall_distance_mm:g} mm leave a tube {2 * radius:.1f} mm thick that stands on the wall's "
            f"plate a depth of {max(depth, 0.0):.1f} mm",
            "Leave it out, or use --plate pegs",
        )
    return float(np.floor(depth * 1e4) / 1e4)


def most_depth_mm(reach_mm: float, radius: float) -> float:
    """Return the extent of the centre lines in a region that reaches so far to either side, mm."""
    return 2.0 * (reach_mm - _BESIDE_RADII * radius)


def least_wall_mm(back_mm: float, radius: float) -> float:
    """Return how near a flat wall may be for a region of open size, mm; the light stands far enough.

    Args:
        back_mm: how far the centre lines reach behind the middle, or half of the depth that is asked for.
    """
    return (back_mm + _BESIDE_RADII * radius) / WALL_SHARE


def _across(region: SettledRegion, ahead: Array) -> float:
    """Measure how far a region reaches along a direction (3,), alike to both sides of the middle, mm."""
    if region.kind == "mesh" and region.file is not None:
        least, most = region_mesh(region.file, region.center_mm).bounds
        return 2.0 * _chord(np.minimum(most, -least), ahead)
    axes = view_axes(region)
    aside = 2.0 * abs(float(ahead @ region.center_mm))
    if region.kind == "sphere":
        return min(region.size_mm) - aside
    half = np.array(region.size_mm) / 2.0
    along = axes @ ahead
    if region.kind == "cylinder":  # about its own upright axis
        half, along = half[:2], np.array([np.hypot(along[0], along[2]), along[1]])
    return 2.0 * _chord(half, along) - aside


def _chord(half: Array, ahead: Array) -> float:
    """Give half of the line through a box's middle; `half` (n,): of its sides, `ahead` (n,) a unit vector."""
    steep = np.abs(ahead) > 1e-9
    return float((half[steep] / np.abs(ahead[steep])).min())
