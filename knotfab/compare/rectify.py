"""Rectify a photograph to the frame seen square on: its four corners, the map, and the dark in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import InputError
from knotfab.picture.masks import mask_iou

__all__ = [
    "find_plate",
    "find_shadow",
    "from_top_left",
    "homography",
    "read_corners",
    "rectify",
    "through",
]

_LOOKED_PX = 500  # longer side at which the plate is looked for
_STRIP = 0.04  # a strip along the plate's edge, as a share of its width, that is taken to be wall
_LEAST_SHARE = 0.04  # a plate covers at least this share of the photograph
_FAINT = 0.12  # a shadow takes away at least this share of the light
_ROUNDS = 6  # the light of the bare wall is fitted to what is lit so often


def read_corners(words: Sequence[str], width: int, height: int) -> Array:
    """Read (4, 2) px from `x,y` four times: top left, top right, bottom right, bottom left of the frame.

    Raises:
        InputError: they are no four corners of something that could be seen as a frame.
    """
    call = f"--corners {' '.join(words)}"
    remedy = (
        "Give x,y of top left, top right, bottom right and bottom left, in px of the photograph."
    )
    try:
        corners = np.array([[float(part) for part in word.split(",")] for word in words])
    except ValueError as error:
        raise InputError(call, "these are not four points", remedy) from error
    if corners.shape != (4, 2) or not np.isfinite(corners).all():
        raise InputError(call, "these are not four points", remedy)
    ahead = np.roll(corners, -1, axis=0) - corners
    after = np.roll(ahead, -1, axis=0)
    turns = ahead[:, 0] * after[:, 1] - ahead[:, 1] * after[:, 0]
    if not (turns > 0).all():
        raise InputError(call, "the points do not go round a frame clockwise", remedy)
    if (corners < 0).any() or (corners > (width, height)).any():
        raise InputError(call, f"a point lies outside its {width} x {height} px", remedy)
    return corners


def homography(source: Array, target: Array) -> Array:
    """Return (3, 3) that takes four points (4, 2) to four others (Hartley and Zisserman, section 4.1)."""
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, -u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, -v])
    return np.asarray(np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3))


def through(matrix: Array, points: Array) -> Array:
    """Return (n, 2) points through a homography."""
    h = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return np.asarray(h[:, :2] / h[:, 2:])


def rectify(photo: Array, corners: Array, size: tuple[int, int], pad: tuple[int, int]) -> Array:
    """Return the frame seen square on, with a margin: what lies outside the photograph is NaN.

    Args:
        photo: (H, W) brightness. corners: (4, 2) px of the frame in it.
        size: width and height of the frame in px. pad: px of the margin on each side.
    """
    (width, height), (pad_u, pad_v) = size, pad
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    u, v = np.meshgrid(np.arange(-pad_u, width + pad_u), np.arange(-pad_v, height + pad_v))
    at = through(homography(frame, corners), np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    # where the photograph is finer, its pixels are averaged over one px here
    blur = max(0.0, 0.4 * float(np.sqrt(shapely.Polygon(corners).area / (width * height))) - 0.4)
    smooth = ndimage.gaussian_filter(photo, blur) if blur > 0 else photo
    seen = ndimage.map_coordinates(smooth, at[:, ::-1].T, order=1, cval=np.nan)
    return np.asarray(seen.reshape(u.shape))


def find_shadow(seen: Array, what: str) -> Mask:
    """Find the dark on a wall that is lit unevenly: where more than half of a shadow's depth is missing.

    The wall's brightness is a smooth surface (a cubic in x and y) through what is not in shadow, found in
    turns with the threshold between the two (Otsu's) of the brightness over it.

    Raises:
        InputError: nothing in it is much darker than the rest.
    """
    known = np.isfinite(seen)
    height, width = seen.shape
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=-1)
    lit = known & (seen >= np.median(seen[known]))
    share = seen
    cut = 1.0
    for _ in range(_ROUNDS):
        fitted, *_ = np.linalg.lstsq(terms[lit][::7], seen[lit][::7], rcond=None)
        wall = np.maximum(terms @ fitted, max(1e-9, 1e-3 * float(np.nanmax(seen))))
        share = seen / wall
        cut = _threshold(share[known])
        lit = known & (share > 0.5 * (1.0 + cut))
    dark = known & (share < cut)
    if not dark.any() or np.median(share[lit]) - np.median(share[dark]) < _FAINT:
        raise InputError(
            what, "no shadow stands out in it", "Darken the room, or check the corners (--corners)."
        )
    # grains of noise are none of the shadow
    return np.asarray(ndimage.median_filter(dark, 3))


def _threshold(values: Array) -> float:
    """Return Otsu's cut (1979), with the least variance on both sides, half-way between their means."""
    counts, edges = np.histogram(values, 256, range=(0.0, 1.3))
    middle = 0.5 * (edges[1:] + edges[:-1])
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * middle)
    with np.errstate(invalid="ignore", divide="ignore"):
        low, high = sums / below, (sums[-1] - sums) / above
        between = np.nan_to_num(below * above * (high - low) ** 2)
    best = int(between.argmax())
    return float(0.5 * (low[best] + high[best]))


def find_plate(photo: NDArray[np.float64]) -> Array | None:
    """Find (4, 2) px of a mount's plate: the quadrilateral that stands out from the wall about it.

    Args:
        photo: (H, W, 3), 0 to 1.

    Returns:
        Its corners clockwise from the top left; None where none is found.
    """
    step = max(1, round(max(photo.shape[:2]) / _LOOKED_PX))
    small = ndimage.gaussian_filter(photo, (0.7 * step, 0.7 * step, 0))[::step, ::step]
    unlike = np.linalg.norm(small / _light_of_wall(small) - 1.0, axis=2)
    best: tuple[float, Array] | None = None
    for cut in (0.04, 0.06, 0.09, 0.13, 0.18, 0.25):
        labels, count = ndimage.label(ndimage.binary_fill_holes(unlike > cut))
        if not count:
            continue
        largest = labels == 1 + int(np.bincount(labels.ravel())[1:].argmax())
        if largest.mean() < _LEAST_SHARE:
            continue
        corners = _quadrilateral(largest)
        if corners is None:
            continue
        like = _likeness(corners, largest)
        if best is None or like > best[0]:
            best = like, corners
    if best is None or best[0] < 0.95:  # IoU of a region and the quadrilateral about it
        return None
    return np.asarray((best[1] + 0.5) * step - 0.5)


def _light_of_wall(photo: Array) -> Array:
    """Fit the wall's colour in its light: a quadratic in x and y through a strip along the photo's edge."""
    height, width = photo.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    terms = np.stack([x**i * y**j for i in range(3) for j in range(3 - i)], axis=-1)
    strip = np.maximum(np.abs(x), np.abs(y)) > 1 - 2 * _STRIP
    fitted, *_ = np.linalg.lstsq(terms[strip], photo[strip], rcond=None)
    return np.asarray(np.maximum(terms @ fitted, 0.02))


def _quadrilateral(region: Mask) -> Array | None:
    """Return the four sides about a region: each a line through that side of its hull."""
    rows, columns = np.nonzero(region)
    hull = shapely.convex_hull(shapely.MultiPoint(np.stack([columns, rows], axis=1)))
    if not isinstance(hull, shapely.Polygon):
        return None
    size = float(np.sqrt(hull.area))
    simple = hull
    for tolerance in np.geomspace(0.005, 0.2, 24) * size:
        simple = hull.simplify(tolerance)
        if len(simple.exterior.coords) <= 5:
            break
    rough = np.array(simple.exterior.coords)[:-1]
    if len(rough) != 4:
        return None
    outline = shapely.segmentize(hull, 1.0)
    points = np.array(outline.exterior.coords)
    lines = []
    for a, b in zip(rough, np.roll(rough, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        rel = points - a
        t = rel @ along / np.linalg.norm(b - a)
        off = np.abs(rel[:, 0] * along[1] - rel[:, 1] * along[0])
        side = points[(t > 0.12) & (t < 0.88) & (off < 0.04 * size)]
        if len(side) < 4:
            return None
        middle = side.mean(axis=0)
        normal = np.linalg.svd(side - middle)[2][1]
        lines.append((normal, float(normal @ middle)))
    corners = []
    for (n, d), (m, e) in zip(lines, lines[1:] + lines[:1], strict=True):
        if abs(np.linalg.det(np.stack([n, m]))) < 0.1:
            return None
        corners.append(np.linalg.solve(np.stack([n, m]), [d, e]))
    return from_top_left(np.array(corners))


def from_top_left(corners: Array) -> Array:
    """Return the corners clockwise as seen, from the one at the top left."""
    middle = corners.mean(axis=0)
    ordered = corners[np.argsort(np.arctan2(*(corners - middle).T[::-1]))]
    return np.roll(ordered, -int((ordered.sum(axis=1)).argmin()), axis=0)


def _likeness(corners: Array, region: Mask) -> float:
    y, x = np.mgrid[: region.shape[0], : region.shape[1]]
    inside = shapely.contains_xy(shapely.Polygon(corners).buffer(0), x, y)
    return mask_iou(inside, region)
