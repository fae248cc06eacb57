"""How much of its picture a piece tells whoever sees it unlit, from twelve sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from knotfab_formats.verdict import FOREIGN_SIGNS, Named, Told, ToldFrom
from knotfab_validators.arrays import Array, Ints, Mask, compiled

# azimuth and elevation in degrees: to both sides, and from above and below
SIDES = (
    *((a * s, 0) for a in (30, 45, 60, 90) for s in (1, -1)),
    *((0, e) for e in (30, 45, -30, -45)),
)
DOOR = (45, 0), (-45, 0)  # where most people come in
NEARBY_DEG = -6, 0, 6  # directions of which the mean is taken
SEEDS = 0x1E3779B97F4A7C15, 0x2545F4914F6CDD1D, 0x5851F42D4C957F2D  # of the fits to each
# With so much more IoU than foreign signs have, any picture is named. Half of it parts what was named from
# what was called a tangle in 30 of 32 views (benchmarks/read_aside.py); standard deviations of the signs, and
# shares of what the picture itself gets, follow his words less.
PLAIN = 0.25
SAME = 0.85  # a sign that fits the picture itself this well is not foreign
_TRIES, _FIRST_TRIES = 100, 5  # steps of a fit, and of one that bounds it from below
_ROUNDING = 1e-9  # error of a sum of fits
# each foreign sign's mean fit to the 23 others, which takes half a second to work out; a test does
# fmt: off
GAINS = (
    0.547641, 0.541700, 0.496514, 0.414206, 0.501941, 0.514966, 0.532926, 0.351468,
    0.390180, 0.559378, 0.455426, 0.458257, 0.536448, 0.373261, 0.385690, 0.356277,
    0.401256, 0.401055, 0.390833, 0.347061, 0.542437, 0.333164, 0.539504, 0.362041,
)
# fmt: on
# a look's box in cells, the margin about it, and how many times finer it is drawn
_CELLS, _MARGIN, _FINER = 15, 2, 6
# a look is stretched to the picture's box by this much at most: nobody reads a sliver
_NARROW = 2.5
_SIGN_PX, _SIGN_MARGIN_PX = 40, 5  # side of a foreign sign, and the margin about its box within it


def tell(
    vertices: Array, parts: Mapping[str, Ints], axes: Array, target: Mask
) -> tuple[Told, dict[str, Named]] | None:
    """Measure how much of the picture is told: from the worst side, and from the door.

    Each share is by how much the picture fits silhouettes better than foreign signs do, in IoU, of what is
    `PLAIN`, or of what the picture itself gets if that is less. The largest of all parts counts. Beside it
    stands the picture's rank among the signs, by the angle (degrees) from which the worst is seen.

    Args:
        vertices: (n, 3). parts: faces (m, 3) of what is seen, by name. axes: rows to the right, up, and out
            of the wall. target: (H, W), the picture's silhouette.
    """
    if not target.any():
        return None
    picture, local = _Picture(target), axes @ vertices.T
    found = list[tuple[float, tuple[int, int], str, Named]]()
    for name, faces in parts.items():
        used, place = np.unique(faces, return_inverse=True)
        own = np.ascontiguousarray(place.reshape(-1, 3), dtype=np.int64)
        seen = np.ascontiguousarray(local[:, used])
        for side in SIDES if len(faces) else ():
            rival = max((s for s, by, *_ in found if side not in DOOR or by in DOOR), default=0.0)
            share, named = picture.read(_look(seen, own, side, picture), rival)
            found.append((share, side, name, named))
    if not found:
        return None
    share, (azimuth, elevation), of, named = max(found, key=lambda seen: seen[:3])
    door = max(share for share, side, *_ in found if side in DOOR)
    told = Told(worst=ToldFrom(share, azimuth, elevation), door=door, of=of)
    return told, {str(max(abs(azimuth), abs(elevation))): named}


def tell_side(local: Array, faces: Ints, side: tuple[int, int], target: Mask) -> float:
    """Measure how much faces (m, 3) tell from one side; vertices `local` (n, 3) are in the view's axes."""
    picture = _Picture(target)
    own, seen = np.ascontiguousarray(faces, dtype=np.int64), np.ascontiguousarray(local.T)
    return picture.read(_look(seen, own, side, picture))[0]


def _look(seen: Array, faces: Ints, side: tuple[int, int], picture: _Picture) -> list[Array]:
    """Draw faces (m, 3) between vertices `seen` (3, n), in the view's axes, from nearly one side."""
    turned = [_look_from(*_beside(side, by)) @ seen for by in NEARBY_DEG]
    return [_draw_look(points, faces, picture.wide) for points in turned]


def tell_flat(sheet: Mask, target: Mask) -> float:
    """Measure how much of a picture a flat sheet on the wall tells, seen from the front."""
    picture = _Picture(target)
    return picture.read([_shrink(sheet, picture.wide)] * len(SEEDS))[0]


class _Picture:
    """A picture that looks are compared with: what it fits better than foreign signs do."""

    def __init__(self, target: Mask) -> None:
        self.wide, self.own = _aspect(target), _shrink(target)
        signs, gains = _foreign(), np.array(GAINS)
        gain = np.array([_fit(self.own, [sign] * len(SEEDS)) for sign in signs])
        others = gain < SAME
        others = others if others.any() else ~others
        self.signs, self.gains, self.usual = signs[others], gains[others], gain[others].mean()
        self.plain = min(PLAIN, self._stand_out([self.own] * len(SEEDS))[0])

    def read(self, looks: Sequence[Array], rival: float = 0.0) -> tuple[float, Named]:
        """Return how far the picture stands out in looks from nearly one side, of what is plain, and rank it.

        What is surely less than the share of a `rival` is not worked out: a number between them is returned.
        """
        out, named = self._stand_out(looks, rival * self.plain)
        return min(max(out / self.plain, 0.0), 1.0), named

    def _stand_out(self, looks: Sequence[Array], least: float = -np.inf) -> tuple[float, Named]:
        own = _fit(self.own, looks) - self.usual
        # a fit only grows with its steps, so that what stands out only falls
        fits = np.array([_fit(sign, looks, _FIRST_TRIES) for sign in self.signs])
        for k, sign in enumerate(self.signs):
            if own - (fits - self.gains).mean() < least - _ROUNDING:
                break
            fits[k] = _fit(sign, looks)
        others = fits - self.gains
        out = float(own - others.mean())
        return out, Named(out / (float(others.std()) or np.inf), bool(own > others.max()))


def _beside(side: tuple[int, int], by_deg: int) -> tuple[int, int]:
    """Turn a direction a little farther to its own side."""
    azimuth, elevation = side
    return (azimuth, elevation + by_deg) if elevation else (azimuth + by_deg, 0)


def _look_from(azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the axes of a look from there: to the right, and up, (2, 3)."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    right = [np.cos(a), 0.0, -np.sin(a)]
    up = [-np.sin(e) * np.sin(a), np.cos(e), -np.sin(e) * np.cos(a)]
    return np.array([right, up])


def _aspect(mask: Mask) -> float:
    """Return the width of a mask's bounding box over its height."""
    rows, columns = (np.flatnonzero(mask.any(axis=k)) for k in (1, 0))
    return float((np.ptp(columns) + 1) / (np.ptp(rows) + 1))


def _draw_look(points: Array, faces: Ints, wide: float) -> Array:
    """Draw faces (m, 3) between points (2, n) on the grid, stretched to a picture's box, `wide` by 1."""
    low, high = points.min(axis=1), points.max(axis=1)
    x, y = np.maximum(high - low, 1e-9)
    window = np.array([max(x, y * wide / _NARROW), max(y, x / wide / _NARROW)])
    size = _CELLS * _FINER
    scale = np.array([[size], [-size]]) / window[:, None]
    pixels = scale * points + (0.5 * size - scale * 0.5 * (low + high)[:, None])
    return _to_cells(fill_triangles(pixels, faces, size))


def _shrink(mask: Mask, wide: float | None = None) -> Array:
    """Draw a mask so that its box fills the grid.

    A box far narrower or flatter than one that is `wide` times as wide as high is enlarged first.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    y, x = float(np.ptp(rows) + 1), float(np.ptp(columns) + 1)
    middle = 0.5 * np.array([rows[0] + rows[-1] + 1, columns[0] + columns[-1] + 1])
    if wide is not None:
        x, y = max(x, y * wide / _NARROW), max(y, x / wide / _NARROW)
    at = (np.arange(_CELLS * _FINER) + 0.5) / (_CELLS * _FINER) - 0.5
    i, j = (np.floor(m + s * at).astype(int) for m, s in zip(middle, (y, x), strict=True))
    inside = ((i >= 0) & (i < len(mask)))[:, None] & ((j >= 0) & (j < mask.shape[1]))
    return _to_cells(
        mask[np.ix_(np.clip(i, 0, len(mask) - 1), np.clip(j, 0, mask.shape[1] - 1))] & inside
    )


def _to_cells(fine: Mask) -> Array:
    cover = fine.reshape(_CELLS, _FINER, _CELLS, _FINER).mean(axis=(1, 3))
    return np.pad(cover, _MARGIN)


@cache
def _foreign() -> Array:
    """Return the foreign signs on the grid."""
    from PIL import Image

    with Image.open(FOREIGN_SIGNS) as image:
        column = np.asarray(image.convert("L")) > 127
    signs = np.split(column, len(column) // column.shape[1])
    return np.array([_shrink(_cover(sign) > 0.5) for sign in signs])


def _cover(sign: Mask) -> Array:
    """Return how much of each pixel a sign covers, stretched to its box, (_SIGN_PX, _SIGN_PX)."""
    rows, columns = (np.flatnonzero(sign.any(axis=k)) for k in (1, 0))
    box = sign[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.float64)
    inner = _SIGN_PX - 2 * _SIGN_MARGIN_PX
    for _ in range(2):  # integrate along each axis and sample at the pixels' borders
        area = np.vstack([np.zeros(box.shape[1]), np.cumsum(box, axis=0)])
        at = np.linspace(0, len(box), inner + 1)
        low = np.minimum(at.astype(int), len(box) - 1)
        share = (at - low)[:, None]
        border = (1 - share) * area[low] + share * area[low + 1]
        box = (np.diff(border, axis=0) * inner / len(box)).T
    return np.pad(box, _SIGN_MARGIN_PX)


def _fit(picture: Array, looks: Sequence[Array], tries: int = _TRIES) -> float:
    """Return the mean of a picture's fits to looks, each begun from another seed."""
    pairs = zip(looks, SEEDS, strict=True)
    fits = [fit_picture(picture, look, seed, tries) for look, seed in pairs]
    return float(np.mean(fits))


@compiled
def fill_triangles(points: Array, faces: Ints, size: int) -> Mask:
    """Fill triangles between points (2, n), px, on size × size pixels."""
    found = np.zeros((size, size), dtype=np.bool_)
    for k in range(len(faces)):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        ax, bx, cx = points[0, a], points[0, b], points[0, c]
        left = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        right = min(size - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        if left > right:  # as most are: many of them share a pixel
            continue
        ay, by, cy = points[1, a], points[1, b], points[1, c]
        top = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        bottom = min(size - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        for j in range(top, bottom + 1):
            for i in range(left, right + 1):
                if found[j, i]:
                    continue
                x, y = i + 0.5, j + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
                    found[j, i] = True
    return found


@compiled
def fit_picture(picture: Array, look: Array, seed: int, tries: int) -> float:
    """Return the largest IoU of two pictures (n, n) under a nearly identical affine map."""
    map_ = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    best, scale, shift = _overlap(picture, look, map_), 1.0, len(picture) / 20.0
    state = np.uint64(seed)
    moved = map_.copy()
    for _ in range(tries):
        for i in range(6):
            # the sum of four uniform numbers is nearly normal
            total = 0.0
            for _ in range(4):
                state ^= state << np.uint64(13)
                state ^= state >> np.uint64(7)
                state ^= state << np.uint64(17)
                total += np.float64(state >> np.uint64(11)) / 9007199254740992.0
            moved[i] = map_[i] + scale * (shift if i % 3 == 2 else 0.12) * (total - 2.0) * 1.7320508
        if abs(moved[0] * moved[4] - moved[1] * moved[3]) < 0.35:
            continue
        value = _overlap(picture, look, moved)
        if value > best:
            best, scale = value, min(1.5, 1.6 * scale)
            for i in range(6):
                map_[i] = moved[i]
        else:
            scale = max(0.03, 0.96 * scale)
    return best


@compiled
def _overlap(picture: Array, look: Array, map_: Array) -> float:
    n = len(picture)
    middle, both, either = (n - 1) / 2, 0.0, 0.0
    for j in range(n):
        for i in range(n):
            x = map_[0] * (i - middle) + map_[1] * (j - middle) + map_[2] + middle
            y = map_[3] * (i - middle) + map_[4] * (j - middle) + map_[5] + middle
            value, u, v = 0.0, int(np.floor(x)), int(np.floor(y))
            if 0 <= u < n - 1 and 0 <= v < n - 1:
                s, t = x - u, y - v
                value = (look[v, u] * (1 - s) + look[v, u + 1] * s) * (1 - t)
                value += (look[v + 1, u] * (1 - s) + look[v + 1, u + 1] * s) * t
            both += min(picture[j, i], value)
            either += max(picture[j, i], value)
    return both / either
