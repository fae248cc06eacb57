"""Compiled loops of the soft renderer: each pixel's winning capsule, and the gradient of its distance.

Points are in receiver axes, mm (see `silhouette.Frame`), arrays and numbers of one precision. The distance is
computed by the operations of `render.capsules` in the same order, so that both give the same. Each loop runs
on one thread, so that the order of all sums is fixed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Real
from knotfab.base.compiled import compiled

Places = NDArray[np.int32]

_SIDE = 8  # pixels of a tile's side
_AREA = _SIDE * _SIDE
_HALF = 0.5 * (_SIDE - 1)
_DIAGONAL = 1.41422 * _HALF  # the way from a tile's middle to its farthest pixel
_BAND = 8  # rows of tiles whose candidates are held at once
_ROUNDING_PX = 1e-3  # a capsule is dropped only if it loses by more than this
_BLOCK = 256  # pixels evaluated at once, to stay in cache
_TINY = 1e-30  # this and the next as in render.capsule
_NEAREST = 1e-12
_LOST = 4.0  # machine epsilons


def _exp(x: float) -> float:
    """Return e^x for x <= 0, to an ulp or two."""
    return math.exp(x)


@overload(_exp, strict=False)
def _exp_of(x: types.Type) -> Any:
    if x != types.float32:
        return lambda x: math.exp(x)

    def single(x: Any) -> Any:
        # Cephes' expf: only what a vector unit does, so that the loops around it stay wide
        x = max(x, np.float32(-87.0))
        n = np.floor(x * np.float32(1.44269504088896341) + np.float32(0.5))
        x = x - n * np.float32(0.693359375) + n * np.float32(2.12194440e-4)
        p = np.float32(1.9875691500e-4) * x + np.float32(1.3981999507e-3)
        p = p * x + np.float32(8.3334519073e-3)
        p = p * x + np.float32(4.1665795894e-2)
        p = p * x + np.float32(1.6666665459e-1)
        p = p * x + np.float32(5.0000001201e-1)
        p = p * (x * x) + x + np.float32(1.0)
        return p * np.int32((np.int32(n) + np.int32(127)) << np.int32(23)).view(np.float32)

    return single


@compiled
def _sigmoid(x: Any, one: Any) -> Any:
    e = _exp(-abs(x))
    return (one if x >= 0 else e) / (one + e)


@compiled
def _four(real: Any, numbers: Array) -> Any:
    return real(numbers[0]), real(numbers[1]), real(numbers[2]), real(numbers[3])


@compiled
def _meet(a: Any, b: Any, qx: Any, qy: Any, lost: Any, tiny: Any, zero: Any, one: Any) -> Any:
    """Find where a ray passes closest to a segment; see `render.capsules`.

    Returned are t along the segment, the moment c there, the segment's e, |e|^2, the distance, and whether
    that exceeds rounding errors.
    """
    (x0, y0, z0), (x1, y1, z1) = a, b
    ax, ay = z0 * qy - y0, x0 - z0 * qx
    az = -(ax * qx + ay * qy)
    ex, ey = z1 * qy - y1, x1 - z1 * qx
    ez = -(ex * qx + ey * qy)
    ex, ey, ez = ex - ax, ey - ay, ez - az
    square = max(ex * ex + ey * ey + ez * ez, tiny)
    t = min(max(-(ax * ex + ay * ey + az * ez) / square, zero), one)
    cx, cy, cz = ax + t * ex, ay + t * ey, az + t * ez
    stretch = one + qx * qx + qy * qy
    length = (cx * cx + cy * cy + cz * cz) / stretch
    least = max((lost * x0) * (lost * x0) + (lost * y0) * (lost * y0), tiny)
    miss = math.sqrt(max(length, least))
    return t, (cx, cy, cz), (ex, ey, ez), square, stretch, miss, length >= least


@compiled
def _boxes(
    a: Real, b: Real, seen: NDArray[np.bool_], numbers: Array, columns: int, rows: int, reach: float
) -> NDArray[np.int32]:
    """Return the first tile (column, row) that each capsule can colour, and the numbers of tiles, [n, 4].

    A sphere's silhouette reaches less than r / (z - 2r) * (1 + |q|)^2 * focal beyond its centre's
    pixel, and the signed distance falls by at least one pixel in 1 + |q| beyond that.
    """
    u0, v0, step, radius = numbers
    focal = 1.0 / step
    boxes = np.zeros((len(a), 4), np.int32)
    for k in range(len(a)):
        if not (seen[k] and a[k, 2] > 2 * radius and b[k, 2] > 2 * radius):
            continue
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for p in (a[k], b[k]):
            x, y, z = p
            near = max(z - 2 * radius, _TINY)
            aside = 1.0 + max(abs(x), abs(y)) / near
            grow = radius / near * aside * aside * focal + reach * (z / near) * aside + 1.0
            u, v = x / z * focal - u0, y / z * focal - v0
            left, right = min(left, u - grow), max(right, u + grow)
            top, bottom = min(top, v - grow), max(bottom, v + grow)
        last_u, last_v = _SIDE * columns - 1.0, _SIDE * rows - 1.0
        # comparisons are written so that NaN is left out
        if right >= 0 and left <= last_u and bottom >= 0 and top <= last_v:
            boxes[k, 0] = int(max(left, 0.0)) // _SIDE
            boxes[k, 1] = int(max(top, 0.0)) // _SIDE
            boxes[k, 2] = int(min(right, last_u)) // _SIDE - boxes[k, 0] + 1
            boxes[k, 3] = int(min(bottom, last_v)) // _SIDE - boxes[k, 1] + 1
    return boxes


@compiled
def _candidates(
    a: Real,
    b: Real,
    boxes: NDArray[np.int32],
    numbers: Array,
    columns: int,
    rows: tuple[int, int],  # rows of tiles: the first, and one past the last
    reach: float,
) -> tuple[NDArray[np.int64], Places]:
    """List the capsules that can win a pixel of each tile t of these rows, from first[t] to first[t + 1].

    The distance of a pixel's ray to a segment changes by at most |p| per unit of direction (p the
    farther end), so its value at the tile's middle bounds it over the tile; depths between the ends'
    bound the signed distance. A capsule whose upper bound is below the tile's best lower bound is out.
    """
    u0, v0, step, radius = numbers
    focal = 1.0 / step
    best = np.full(columns * (rows[1] - rows[0]), -reach)
    pairs = 0
    for k in range(len(boxes)):
        high = min(boxes[k, 1] + boxes[k, 3], rows[1]) - max(boxes[k, 1], rows[0])
        pairs += boxes[k, 2] * max(high, 0)
    most, tiles, capsules = np.empty(pairs), np.empty(pairs, np.int32), np.empty(pairs, np.int32)
    pair = 0
    for k in range(len(boxes)):
        top, bottom = max(boxes[k, 1], rows[0]), min(boxes[k, 1] + boxes[k, 3], rows[1])
        if boxes[k, 2] == 0 or top >= bottom:
            continue
        p = (np.float64(a[k, 0]), np.float64(a[k, 1]), np.float64(a[k, 2]))
        q = (np.float64(b[k, 0]), np.float64(b[k, 1]), np.float64(b[k, 2]))
        far = max(p[0] ** 2 + p[1] ** 2 + p[2] ** 2, q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
        slack = math.sqrt(far) * step * _DIAGONAL
        near_scale, far_scale = focal / min(p[2], q[2]), focal / max(p[2], q[2])
        for row in range(top, bottom):
            qy = (row * _SIDE + _HALF + v0) * step
            for column in range(boxes[k, 0], boxes[k, 0] + boxes[k, 2]):
                qx = (column * _SIDE + _HALF + u0) * step
                _, _, _, _, _, miss, _ = _meet(p, q, qx, qy, 0.0, _TINY, 0.0, 1.0)
                above, below = radius - miss + slack, radius - miss - slack
                most[pair] = above * (near_scale if above > 0 else far_scale)
                least = below * (far_scale if below > 0 else near_scale)
                tile = (row - rows[0]) * columns + column
                best[tile] = max(best[tile], least)
                tiles[pair], capsules[pair] = tile, k
                pair += 1
    first = np.zeros(len(best) + 1, np.int64)
    for pair in range(pairs):
        first[tiles[pair] + 1] += most[pair] >= best[tiles[pair]] - _ROUNDING_PX
    for tile in range(len(best)):
        first[tile + 1] += first[tile]
    place, listed = first.copy(), np.empty(first[-1], np.int32)
    for pair in range(pairs):
        tile = tiles[pair]
        if most[pair] >= best[tile] - _ROUNDING_PX:
            listed[place[tile]] = capsules[pair]
            place[tile] += 1
    return first, listed


@compiled
def find_winners(
    a: Real,  # [n, 3]
    b: Real,  # [n, 3]
    seen: NDArray[np.bool_],  # [n] which there are
    numbers: Array,  # u0, v0, step, radius (mm)
    width: int,
    height: int,
    reach: float,
) -> tuple[Places, Places]:
    """Find flat indices of pixels with s > -reach (px), and for each the last capsule of largest s."""
    real = a.dtype.type
    u0, v0, step, radius = _four(real, numbers)
    focal = real(1.0 / numbers[2])
    one, zero, tiny = real(1), real(0), real(_TINY)
    lost = real(_LOST * np.finfo(a.dtype).eps)
    columns, rows = (width + _SIDE - 1) // _SIDE, (height + _SIDE - 1) // _SIDE
    boxes = _boxes(a, b, seen, numbers, columns, rows, reach)
    pixel, capsule = np.empty(width * height, np.int32), np.empty(width * height, np.int32)
    qx, qy = np.empty(_AREA, a.dtype), np.empty(_AREA, a.dtype)
    best, who = np.empty(_AREA, a.dtype), np.empty(_AREA, np.int32)
    found = 0
    for begin in range(0, rows, _BAND):
        band = (begin, min(begin + _BAND, rows))
        first, listed = _candidates(a, b, boxes, numbers, columns, band, reach)
        for tile in range(len(first) - 1):
            if first[tile + 1] == first[tile]:
                continue
            left, top = tile % columns * _SIDE, (begin + tile // columns) * _SIDE
            for i in range(_AREA):
                qx[i] = (real(left + i % _SIDE) + u0) * step
                qy[i] = (real(top + i // _SIDE) + v0) * step
                best[i] = -reach
                who[i] = -1
            for place in range(first[tile], first[tile + 1]):
                k = listed[place]
                p, q = (a[k, 0], a[k, 1], a[k, 2]), (b[k, 0], b[k, 1], b[k, 2])
                for i in range(_AREA):
                    t, _, _, _, _, miss, _ = _meet(p, q, qx[i], qy[i], lost, tiny, zero, one)
                    s = (radius - miss) * (focal / (p[2] + t * (q[2] - p[2])))
                    better = s >= best[i]
                    best[i] = s if better else best[i]
                    who[i] = k if better else who[i]
            for i in range(_AREA):
                u, v = left + i % _SIDE, top + i // _SIDE
                if who[i] >= 0 and u < width and v < height:
                    pixel[found] = v * width + u
                    capsule[found] = who[i]
                    found += 1
    return pixel[:found].copy(), capsule[:found].copy()


def are_within(places: Places, count: int) -> bool:
    """Return whether all indices lie in range(count)."""
    return not len(places) or bool(places.min() >= 0 and places.max() < count)


@compiled
def evaluate(
    a: Real,  # [n, 3]
    b: Real,  # [n, 3]
    pixel: Places,  # [m]
    capsule: Places,  # [m]
    numbers: Array,  # u0, v0, step, radius (mm)
    width: int,
    tau: float,
    field: Real,  # [height * width]
    own: float,
    other: float,
    slopes: Array,  # [n, 6] with respect to a and b, added to
    image: Real,  # [height * width], or empty: where g goes
) -> float:
    """Return the sum over pixels of own g^2 / 2 + other g f, and add its gradient to `slopes`.

    Here g = sigmoid(tau s) is the silhouette of the pixel's winning capsule, f the field there.
    """
    real = a.dtype.type
    u0, v0, step, radius = _four(real, numbers)
    focal, sharp = real(1.0 / numbers[2]), real(tau)
    one, zero, tiny, nearest = real(1), real(0), real(_TINY), real(_NEAREST)
    lost = real(_LOST * np.finfo(a.dtype).eps)
    half, mine, others = real(0.5 * own), real(own), real(other)
    across = 1.0 / width
    # arrays of a pixel: ends, ray, field; then its share of the gradient and the sum, and g
    work = np.zeros((17, _BLOCK), a.dtype)
    total = 0.0
    for begin in range(0, len(pixel), _BLOCK):
        count = min(_BLOCK, len(pixel) - begin)
        for i in range(count):
            place, k = pixel[begin + i], capsule[begin + i]
            row = np.int32((place + 0.5) * across)
            work[0, i], work[1, i], work[2, i] = a[k, 0], a[k, 1], a[k, 2]
            work[3, i], work[4, i], work[5, i] = b[k, 0], b[k, 1], b[k, 2]
            work[6, i] = (real(place - row * width) + u0) * step
            work[7, i] = (real(row) + v0) * step
            work[8, i] = field[place]
        # no branch and no place that is looked up: this loop is run by vector instructions
        for i in range(_BLOCK):
            p, q = (work[0, i], work[1, i], work[2, i]), (work[3, i], work[4, i], work[5, i])
            qx, qy, f = work[6, i], work[7, i], work[8, i]
            t, c, e, square, stretch, miss, clear = _meet(p, q, qx, qy, lost, tiny, zero, one)
            change = q[2] - p[2]
            depth = p[2] + t * change
            ahead = depth > nearest
            scale = focal / (depth if ahead else one)
            s = (radius - miss) * scale
            g = _sigmoid(sharp * s, one) if ahead else zero
            # s pulls on the nearest place, by its distance and by its depth
            weight = sharp * g * (one - g) * (mine * g + others * f)
            deeper = -weight * s / (depth if ahead else one)
            wider = -weight * scale / (stretch * miss) if clear else zero
            # the distance does not feel where along the segment that is, the depth does
            slide = deeper * change / square if t > zero and t < one else zero
            from_a, from_b = (one - t) * wider + slide, t * wider - slide
            slide_a, slide_b = -slide * (one - t), -slide * t
            # back through the moments
            cx, cy, cz = c[0] - qx * c[2], c[1] - qy * c[2], c[0] * qy - c[1] * qx
            ex, ey, ez = e[0] - qx * e[2], e[1] - qy * e[2], e[0] * qy - e[1] * qx
            work[9, i] = from_a * cy + slide_a * ey
            work[10, i] = -(from_a * cx + slide_a * ex)
            work[11, i] = from_a * cz + slide_a * ez + deeper * (one - t)
            work[12, i] = from_b * cy + slide_b * ey
            work[13, i] = -(from_b * cx + slide_b * ex)
            work[14, i] = from_b * cz + slide_b * ez + deeper * t
            work[15, i] = g * (half * g + others * f)
            work[16, i] = g
        for i in range(count):
            k = capsule[begin + i]
            for j in range(6):
                slopes[k, j] += work[9 + j, i]
            total += work[15, i]
        if len(image) > 0:
            for i in range(count):
                image[pixel[begin + i]] = work[16, i]
    return total
