"""Find the frame, the shadow and the lamp in a photograph, and rectify it to the frame seen square on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy import ndimage
from scipy.optimize import minimize

from knotfab.base.arrays import Array, Mask
from knotfab.knots import Knots
from knotfab.picture.silhouette import mask_iou, resample_mask
from knotfab.render.silhouette import frame_of, render
from knotfab.report.drill_template import MARK_RADII_MM
from knotfab.scene.camera import Camera
from knotfab_formats.errors import InputError

_FAINT = 0.12  # least share of the light that a shadow takes away
_ROUNDS = 6  # rounds of fitting the bare wall's light and the threshold


def read_corners(words: Sequence[str], width: int, height: int) -> Array:
    """Parse four `x,y` in px: top left, top right, bottom right, bottom left of the frame; (4, 2).

    Raises:
        InputError: they cannot be the corners of a frame in the photograph.
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
    """Return the homography (3, 3) that maps four points (4, 2) to four others.

    The direct linear transformation (Hartley and Zisserman, section 4.1).
    """
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, -u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, -v])
    return np.asarray(np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3))


def map_points(matrix: Array, points: Array) -> Array:
    """Map points (n, 2) by a homography."""
    h = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return np.asarray(h[:, :2] / h[:, 2:])


def rectify(photo: Array, corners: Array, size: tuple[int, int], pad: tuple[int, int]) -> Array:
    """Return the frame seen square on, with a margin. What lies outside the photograph is NaN.

    Args:
        photo: (H, W) brightness.
        corners: (4, 2) px of the frame in it.
        size: width and height of the result's frame in px.
        pad: margins to the sides, and above and below, in px.
    """
    (width, height), (pad_u, pad_v) = size, pad
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    u, v = np.meshgrid(np.arange(-pad_u, width + pad_u), np.arange(-pad_v, height + pad_v))
    square = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    at = map_points(homography(frame, corners), square)
    # a finer photograph is first averaged over one px of the result
    blur = max(0.0, 0.4 * float(np.sqrt(shapely.Polygon(corners).area / (width * height))) - 0.4)
    smooth = ndimage.gaussian_filter(photo, blur) if blur > 0 else photo
    seen = ndimage.map_coordinates(smooth, at[:, ::-1].T, order=1, cval=np.nan)
    return np.asarray(seen.reshape(u.shape))


def find_shadow(seen: Array, what: str) -> Mask:
    """Segment the shadow on an unevenly lit wall.

    The bare wall's brightness is a cubic in x and y. Its fit to the lit pixels and Otsu's threshold of the
    brightness relative to it are repeated in turns.

    Raises:
        InputError: nothing is much darker than the rest.
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
    return np.asarray(ndimage.median_filter(dark, 3))


def _threshold(values: Array) -> float:
    """Return Otsu's threshold (1979): halfway between the means of the two classes that it separates."""
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


def from_top_left(corners: Array) -> Array:
    """Sort four corners clockwise as seen, beginning at the top left."""
    middle = corners.mean(axis=0)
    ordered = corners[np.argsort(np.arctan2(*(corners - middle).T[::-1]))]
    return np.roll(ordered, -int((ordered.sum(axis=1)).argmin()), axis=0)


# the four marks of setup.pdf: a dot in a light ring in a dark ring, seen at any tilt

_MARKS_PX = 2000  # longer side of the photograph in which they are sought
# windows over which the light is averaged, as shares of that side
_WINDOWS = 1 / 12, 1 / 30, 1 / 75
_DARKER = 0.85  # pixels below this share of the average are dark
_LEAST_PX = 9  # least width of a mark
_LARGEST = 0.25  # largest width of a mark, as a share of the photograph's longer side
_DOT, _LIGHT, _RING = MARK_RADII_MM
_HOLE, _MIDDLE = (_LIGHT / _RING) ** 2, (_DOT / _RING) ** 2  # shares of a mark's area
_OFF = 0.4  # relative error allowed in these shares, because of blur and threshold
_APART = 0.08  # distance allowed between the middles of dot and ring, as a share of the mark's size
_LIKE_AN_ELLIPSE = 0.06  # relative error allowed in the area of the ellipse
_FLATTEST = 0.3  # least ratio of the ellipse's axes


@dataclass(frozen=True)
class _Found:
    """A mark's middle, (2,) px, and the square root of its area."""

    middle: Array
    size: float


def find_marks(grey: Array) -> Array | None:
    """Find the middles of the marks in a photograph's brightness (H, W).

    A mark is a dark region with one hole and another region in the middle of that. The ratios of their areas
    are known, and perspective, which turns circles into ellipses, keeps them.

    Returns:
        (4, 2) px, clockwise from the top left; None unless there are exactly four.
    """
    step = max(1, round(max(grey.shape) / _MARKS_PX))
    small = ndimage.gaussian_filter(grey, 0.5 * step)[::step, ::step]
    found: list[_Found] = []
    for window in _WINDOWS:
        around = ndimage.uniform_filter(small, max(3, round(window * max(small.shape))))
        for mark in _find_rings(small < _DARKER * around):
            if all(np.linalg.norm(mark.middle - m.middle) > 0.5 * m.size for m in found):
                found.append(mark)
    if len(found) != 4:
        return None
    return from_top_left((np.stack([mark.middle for mark in found]) + 0.5) * step - 0.5)


def _find_rings(dark: Mask) -> list[_Found]:
    # without the filter, noise would join regions and punch holes
    labels, _ = ndimage.label(ndimage.median_filter(dark, 3))
    found = []
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        high, wide = (s.stop - s.start for s in place)
        if min(high, wide) < _LEAST_PX or max(high, wide) > _LARGEST * max(dark.shape):
            continue
        piece = labels[place] == number
        filled = ndimage.binary_fill_holes(piece)
        area = int(filled.sum())
        hole = area - int(piece.sum())
        if not _is_about(hole / area, _HOLE):
            continue
        inside, count = ndimage.label((labels[place] != 0) & filled & ~piece)
        if not count:
            continue
        sizes = np.bincount(inside.ravel())[1:]
        dot = inside == 1 + int(sizes.argmax())
        if not _is_about(int(sizes.max()) / area, _MIDDLE) or sizes.sum() > 1.3 * sizes.max():
            continue
        size = float(np.sqrt(area))
        middle, core = (np.array(ndimage.center_of_mass(mask)) for mask in (filled, dot))
        if np.linalg.norm(middle - core) > _APART * size or not _is_ellipse(filled):
            continue
        corner = np.array([place[1].start, place[0].start])
        found.append(_Found(0.5 * (middle + core)[::-1] + corner, size))
    return found


def _is_about(share: float, wanted: float) -> bool:
    return abs(share - wanted) <= _OFF * wanted


def _is_ellipse(region: Mask) -> bool:
    """Return whether a region has the area of the ellipse with its second moments, and is not too flat."""
    points = np.argwhere(region)
    spread = np.cov(points.T) + np.eye(2) / 12
    low, high = np.linalg.eigvalsh(spread)
    area = 4 * np.pi * np.sqrt(low * high)
    return bool(abs(area / len(points) - 1) < _LIKE_AN_ELLIPSE and low > _FLATTEST**2 * high)


# the lamp

_STEP_MM = (8.0, 8.0, 40.0)  # first steps of the simplex, and the scale of the unknowns
_COARSER = 2  # factor by which the fit's resolution is lower than the IoU's
_FARTHEST = 1.0  # largest displacement, as a share of the lamp's distance from the wall


@dataclass(frozen=True)
class LampFit:
    """How far a lamp stands from its place: to the right, up, and away from the wall.

    `iou` compares the photographed shadow with that of the knots for the lamp there, and `iou_in_place` with
    that for the lamp in its place.
    """

    right_mm: float
    up_mm: float
    away_mm: float
    iou_in_place: float
    iou: float


def cast_shadow(knots: Knots, camera: Camera, eye: Array) -> Array:
    """Render the shadow that knots in the scene cast on the camera's frame from a lamp at `eye`.

    Returns:
        (H, W) the share of each pixel that is dark.
    """
    frame = frame_of(replace(camera, eye=eye), np.float32, stretched=True)
    points = knots.points.astype(np.float32)
    ahead = points[knots.rings.next]
    # a sharpness of 4 is as steep as the coverage of a pixel by an edge
    return render(points, ahead, frame, knots.radius_mm, 4.0).astype(np.float64)


def find_lamp(knots: Knots, camera: Camera, seen: Mask) -> LampFit:
    """Fit the lamp's displacement to a photographed shadow on the camera's frame.

    A Nelder-Mead simplex minimises the squared difference of the blurred pictures.
    """
    full = camera
    camera = camera.resized(camera.width // _COARSER, camera.height // _COARSER)
    coarse = resample_mask(seen, camera.width, camera.height).astype(np.float64)
    axes = np.stack([camera.du / np.linalg.norm(camera.du), -camera.dv / np.linalg.norm(camera.dv)])
    axes = np.concatenate([axes, np.cross(axes[0], axes[1])[None]])
    if axes[2] @ camera.receiver[:3] < 0:
        axes[2] = -axes[2]
    step = np.array(_STEP_MM)
    wall, offset = camera.receiver[:3], float(camera.receiver[3])
    reach = float(camera.eye @ wall) + offset
    front = float((knots.points @ wall).max()) + offset + knots.radius_mm
    found = np.zeros(3)
    for soft in (4.0, 1.5):  # px of blur
        wanted = ndimage.gaussian_filter(coarse, soft)

        def unlike(unknown: Array, soft: float = soft, wanted: Array = wanted) -> float:
            eye = camera.eye + (unknown * step) @ axes
            # the shadow of something else would lead the lamp behind the piece, or kilometres away
            if eye @ wall + offset < front or np.linalg.norm(unknown * step) > _FARTHEST * reach:
                return np.inf
            cast = cast_shadow(knots, camera, eye)
            return float(((ndimage.gaussian_filter(cast, soft) - wanted) ** 2).sum())

        corners = np.concatenate([found[None], found + np.eye(3)])
        options = {"initial_simplex": corners, "maxfev": 90, "xatol": 0.02, "fatol": 1e-3}
        found = minimize(unlike, found, method="Nelder-Mead", options=options).x

    def likeness(at: Array) -> float:
        return mask_iou(cast_shadow(knots, full, full.eye + at @ axes) > 0.5, seen)

    right, up, away = (float(v) for v in found * step)
    return LampFit(right, up, away, likeness(np.zeros(3)), likeness(found * step))
