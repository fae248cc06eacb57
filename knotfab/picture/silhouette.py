"""Silhouette masks: smooth polygons with holes, resampling, pieces, holes and specks."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import points_at
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    import scipy.sparse
    from shapely import MultiPolygon, Polygon
    from shapely.geometry.base import BaseGeometry

USUAL_SHARE = 0.014  # usual tube radius over the frame's longer side
LONGER_SIDE = 1024  # px of the longer side when pictures are compared and traced
_SPECK = 2.0  # px²: smaller pieces and holes are dropped from polygons
_REACH = 0.5  # px: how far smoothing may move the outline; half of it where coverage is known
_SPACING = 0.5  # px between samples while smoothing
# Just below one half, so that pixels that touch only at corners stay connected.
_LEVEL = 0.499


def _box_weights(source: int, wanted: int, low: float, high: float) -> scipy.sparse.csr_array:
    """Return box weights: the coverage of source pixels by even target pixels, (wanted, source).

    Rows sum to 1 where low to high lies in the source, to less where a target pixel stands out of it.
    """
    from scipy.sparse import csr_array

    edges = np.linspace(low, high, wanted + 1)
    cuts = np.union1d(edges, np.arange(source + 1.0))
    cuts = cuts[(cuts >= max(low, 0.0)) & (cuts <= min(high, source))]
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    rows = np.clip(np.searchsorted(edges, middle) - 1, 0, wanted - 1)
    cells = np.clip(middle.astype(np.int64), 0, source - 1)
    weights = (np.diff(cuts) * (wanted / (high - low))).astype(np.float32)
    return csr_array((weights, (rows, cells)), shape=(wanted, source))


def resample_mask(
    mask: Mask | Array,
    width: int,
    height: int,
    window: tuple[float, float, float, float] | None = None,
) -> NDArray[np.float32]:
    """Return the mask's coverage at another resolution, by an exact box filter.

    Args:
        mask: (H, W); or greys in 0 .. 1, whose means are taken.
        width, height: width and height of the result, smaller or larger than the mask's.
        window: left, top, right and bottom of the result in the mask's pixels; None: the mask's own frame.
            Beyond the mask nothing is covered.

    Returns:
        (height, width) in 0 .. 1: the part of each pixel's area that the shape covers.
    """
    rows, columns = mask.shape
    left, top, right, bottom = window or (0.0, 0.0, float(columns), float(rows))
    if window is None and (rows, columns) == (height, width):
        return mask.astype(np.float32)
    across = _box_weights(columns, width, left, right).T.tocsr()
    down = _box_weights(rows, height, top, bottom)
    narrow = np.empty((rows, width), dtype=np.float32)
    step = max(1, 2**24 // columns)  # bounds the float copy of a large mask
    for first in range(0, rows, step):
        narrow[first : first + step] = mask[first : first + step].astype(np.float32) @ across
    return np.asarray(np.clip(down @ narrow, 0.0, 1.0), dtype=np.float32)


def polygon_iou(one: BaseGeometry, other: BaseGeometry) -> float:
    """Return the intersection over union of two shapes."""
    return float(one.intersection(other).area / one.union(other).area)


def fit_size(width: int, height: int, longer: int) -> tuple[int, int]:
    """Scale a frame's width and height, px, to `longer` px on the longer side."""
    scale = longer / max(width, height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def _area(ring: Array) -> float:
    x, y = ring.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _smooth(ring: Array, length: float, reach: float) -> Array:
    """Smooth the stair steps of a closed ring, moving it by at most about `reach`.

    Strong smoothing alone would round corners: so moves are clipped to `reach`, and the clipped
    ring is smoothed again, more lightly, twice. Vertices that straight runs can spare are dropped.

    Args:
        ring: (n, 2), the last point not repeated.
        length: px; waves shorter than about six times this are damped by 1 / (1 + (ω length)⁴),
            which leaves lower frequencies alone to fourth order.
        reach: px.
    """
    from scipy import fft
    from shapely import LinearRing

    closed = np.vstack([ring, ring[:1]])
    steps = np.hypot(*np.diff(closed, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    n = fft.next_fast_len(max(16, int(arc[-1] / _SPACING)), real=True)
    at = np.arange(n) * (arc[-1] / n)
    points = points_at(closed, arc, at)
    omega = 2.0 * np.pi * fft.rfftfreq(n, arc[-1] / n)[:, None]

    def damped(values: Array, scale: float) -> Array:
        spectrum = fft.rfft(values, axis=0) / (1.0 + (omega * scale) ** 4)
        return np.asarray(fft.irfft(spectrum, n=n, axis=0))

    smooth = damped(points, length)
    for scale in (0.5 * length, 0.25 * length):
        shift = smooth - points
        far = np.maximum(1.0, np.hypot(*shift.T) / reach)[:, None]
        smooth = damped(points + shift / far, scale)
    line = LinearRing(smooth).simplify(0.05, preserve_topology=False)  # px
    few = np.asarray(line.coords)[:-1]
    return smooth if len(few) < 4 else few


def _restore_area(ring: Array, area: float, reach: float) -> Array:
    """Offset the ring along its normals, by at most `reach` px, so that it encloses `area`."""
    for _ in range(2):  # the second takes care of the offset's curvature term
        tangent = np.roll(ring, -1, axis=0) - np.roll(ring, 1, axis=0)
        tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
        length = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T).sum()
        signed = _area(ring)
        offset = np.clip((area - abs(signed)) / max(length, 1e-9), -reach, reach)
        # (t_v, -t_u) points outwards where the signed area is positive
        ring = ring + np.sign(signed) * offset * tangent[:, ::-1] * (1.0, -1.0)
    return ring


def _trace_rings(coverage: NDArray[np.float32]) -> list[list[Array]]:
    """Trace the outlines at half coverage: each piece's outer ring and holes, no point repeated."""
    import contourpy

    generator = contourpy.contour_generator(
        z=np.pad(coverage, 1), name="serial", fill_type=contourpy.FillType.OuterOffset
    )
    found = []
    for points, offsets in zip(*generator.filled(_LEVEL, 2.0), strict=True):
        rings = [points[a : b - 1] - 1.0 for a, b in pairwise(offsets)]
        found.append([np.asarray(r, dtype=np.float64) for r in rings])
    return found


def trace_polygon(mask: Mask, smooth_px: float = 1.5) -> MultiPolygon:
    """Trace the silhouette as smooth polygons with holes, in the mask's pixel coordinates.

    A larger mask is first reduced to 1024 px on the longer side. Its outline at half coverage (marching
    squares) is traced, and the stair steps of its pixels are smoothed away.

    Args:
        mask: (H, W).
        smooth_px: length of the smoothing, in px of the traced mask; 0 leaves the outline as it is.

    Returns:
        Valid polygons, pixel centres at integers, v down; the area is the mask's to about 0.2 %,
        the outline within about 0.7 px of the traced one. Pieces and holes below 2 px² are dropped.
    """
    import shapely
    from shapely import MultiPolygon

    height, width = mask.shape
    w, h = fit_size(width, height, min(LONGER_SIDE, max(width, height)))
    took_part("shapely", "outlined the picture")
    coverage = resample_mask(mask, w, h)
    binary = (w, h) == (width, height)
    traced = _trace_rings(coverage)
    # a picture with more is noise, and smoothing it would only take time
    if sum(map(len, traced)) > 3000:
        smooth_px = 0.0
    reach = _REACH if binary else 0.5 * _REACH
    kept: list[Polygon] = []
    for rings in traced:
        # On a binary mask marching squares cut 1/8 px² off each corner of a ring, 1/2 in all.
        areas = [abs(_area(r)) + (0.5 if binary else 0.0) for r in rings]
        if areas[0] < _SPECK:
            continue
        large = [(r, a) for r, a in zip(rings, areas, strict=True) if a >= _SPECK]
        kept.extend(_smooth_piece(large, smooth_px, reach))
    shape = MultiPolygon(kept)
    if not shape.is_valid:  # neighbours that touched at a corner may overlap by a hair
        shape = _polygons(shapely.make_valid(shapely.union_all(kept)))
    scale = np.array([width / w, height / h])
    return shapely.transform(shape, lambda uv: (uv + 0.5) * scale - 0.5)


def _smooth_piece(
    rings: list[tuple[Array, float]], smooth_px: float, reach: float
) -> list[Polygon]:
    """Smooth one piece as much as its thin parts allow without self-intersection."""
    import shapely
    from shapely import Polygon

    for part in (1.0, 0.4) if smooth_px > 0 else ():
        moved = [
            _restore_area(_smooth(r, smooth_px * part, reach * part), a, reach) for r, a in rings
        ]
        piece = Polygon(moved[0], moved[1:])
        if piece.is_valid:
            return [piece]
    traced = Polygon(rings[0][0], [r for r, _ in rings[1:]])
    return [traced] if traced.is_valid else list(_polygons(shapely.make_valid(traced)).geoms)


def _polygons(shape: object) -> MultiPolygon:
    import shapely
    from shapely import MultiPolygon, Polygon

    parts = shapely.get_parts(shapely.get_parts(shape))
    return MultiPolygon([p for p in parts if isinstance(p, Polygon) and p.area > 0])


# Masks as sets of pixels: pieces (8-connected), holes (4-connected) and outlines.

_MANY, _HARDLY = 6, 0.015  # the fewest specks of dust, and their largest share of the ink
_HALF = 0.5 - 1e-5  # with room for single precision


def mask_iou(one: Mask, other: Mask) -> float:
    """Return intersection over union of two masks (H, W) of one grid; 1 where both are empty."""
    union = int((one | other).sum())
    return float((one & other).sum() / union) if union else 1.0


def outline_px(mask: Mask) -> int:
    """Count the sides of pixels along the outline of a mask, the frame's included."""
    edged = np.pad(mask, 1)
    return int((edged[1:] ^ edged[:-1]).sum() + (edged[:, 1:] ^ edged[:, :-1]).sum())


def sample_mask(mask: Mask, width: int, height: int) -> Mask:
    """Resample a mask to (height, width): set where it covers half of a pixel or more."""
    return resample_mask(mask, width, height) >= _HALF


def signed_distance(mask: Mask) -> Array:
    """Return the distance of pixels' centres (H, W) to a mask's outline, px, positive inside."""
    from scipy.ndimage import distance_transform_edt

    signed = distance_transform_edt(mask) - distance_transform_edt(~mask)
    return np.asarray(signed - 0.5 * np.sign(signed))


def opened_share(mask: Mask, radius: float = USUAL_SHARE, longer_px: int = 320) -> float:
    """Return the share of a mask that its opening by a tube keeps, by default by a usual one.

    Args:
        radius: as a share of the mask's longer side. longer_px: of the copy on which it is measured.
    """
    from scipy.ndimage import distance_transform_edt

    size = fit_size(mask.shape[1], mask.shape[0], min(longer_px, max(mask.shape)))
    small = sample_mask(mask, *size)
    reach = radius * max(size)
    kept = distance_transform_edt(np.pad(small, 1, mode="edge"))[1:-1, 1:-1] >= reach
    if not kept.any():
        return 0.0
    opened = distance_transform_edt(~kept) < reach
    return float((opened & small).sum() / small.sum())


def pieces_of(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number the pieces from 1, (H, W), and count their pixels, (n,); corner contact joins pieces."""
    from scipy import ndimage

    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    return labels, np.bincount(labels.ravel())[1:]


def holes_of(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number the holes from 1, (H, W), and count their pixels, (n,); holes do not touch the frame."""
    from scipy import ndimage

    around, count = ndimage.label(np.pad(~mask, 1, constant_values=True))
    number = np.arange(count + 1)
    number[1:] -= 1  # the background outside comes first, from the corner
    labels = number[around[1:-1, 1:-1]].astype(np.int32)
    return labels, np.bincount(labels.ravel(), minlength=count)[1:]


def keep_largest(mask: Mask, count: int) -> Mask:
    """Keep the `count` largest pieces; among equal ones, the first row by row."""
    labels, areas = pieces_of(mask)
    kept = np.zeros(len(areas) + 1, dtype=bool)
    kept[1 + np.argsort(-areas, kind="stable")[:count]] = True
    return np.asarray(kept[labels])


def drop_specks(mask: Mask, least_px: int) -> Mask:
    """Remove pieces and fill holes of fewer than `least_px` pixels."""
    labels, areas = pieces_of(mask)
    return fill_holes(np.concatenate([[False], areas >= least_px])[labels], least_px)


def fill_holes(mask: Mask, least_px: float) -> Mask:
    """Fill holes of fewer than `least_px` pixels."""
    labels, areas = holes_of(mask)
    return np.asarray(mask | np.concatenate([[False], areas < least_px])[labels])


def count_dust(mask: Mask, least_px: float) -> int:
    """Count pieces and holes below `least_px` that are dust; 0 where they may be intended.

    Dust is numerous, a tiny share of the ink, and scattered; lettering and dots stand closer.
    """
    from scipy import ndimage
    from scipy.spatial import KDTree

    at, sides = [], []
    for labels, areas in (pieces_of(mask), holes_of(mask)):
        few = np.flatnonzero(areas < least_px) + 1
        at += ndimage.center_of_mass(labels > 0, labels, few)
        sides += np.sqrt(areas[few - 1]).tolist()
    if len(at) < _MANY or np.square(sides).sum() > _HARDLY * mask.sum():
        return 0
    apart = KDTree(at).query(at, 2)[0][:, 1]
    # least ratio of the distance between specks of dust to their size
    return len(at) if np.median(apart) > 2.5 * np.median(sides) else 0


def smooth(mask: Mask, sigma_px: float) -> Mask:
    """Smooth a mask by a Gaussian, cut at half; beyond the frame it is continued."""
    from scipy import ndimage

    blurred = ndimage.gaussian_filter(mask.astype(np.float32), sigma_px, mode="nearest")
    return np.asarray(blurred > 0.5)
