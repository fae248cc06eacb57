"""Find the longest stretch along which the outlines of shadow and picture differ, and exact distances."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from knotfab_validators.arrays import Array, Mask, compiled

WRONG_PX = 2.0
"""An outline is wrong where the other one is farther away than this: 0.2 % of the frame."""


@dataclass(frozen=True)
class WrongStretch:
    """The longest connected stretch of either outline that is wrong.

    `length_px` is its length along the outline, `off_px` how far the other outline is from its
    worst point, and `where` that point (u, v); all in pixels of the compared masks. All are zero if
    nothing is wrong. `quantile_95_px` is of both outlines as a whole: the distance from the other
    outline within which 95 % of either one lies.
    """

    length_px: float
    off_px: float
    where: tuple[float, float]
    quantile_95_px: float = field(default=0.0, compare=False)


def find_wrong_stretch(shadow: Mask, target: Mask, wrong_px: float = WRONG_PX) -> WrongStretch:
    """Find the longest stretch along which one outline stays farther than `wrong_px` from the other.

    Both outlines are walked: the shadow's, which finds spill and blobs, and the target's, which
    finds what is missing (Hausdorff distances are two-sided for the same reason). An outline is
    the marching-squares contour of its mask; distances are those of the pixel grid (exact
    Euclidean distance transform), so they are good to half a pixel. An empty mask has no outline,
    and the whole of the other one is then wrong.

    Args:
        shadow, target: (H, W), on one grid.
    """
    if shadow.shape != target.shape:
        raise ValueError(f"masks of one grid are compared, got {shadow.shape} and {target.shape}")
    worst = WrongStretch(0.0, 0.0, (0.0, 0.0))
    rows, columns = np.nonzero(shadow | target)
    if not len(rows):
        return worst
    top, left = max(int(rows.min()) - 2, 0), max(int(columns.min()) - 2, 0)
    window = slice(top, int(rows.max()) + 3), slice(left, int(columns.max()) + 3)
    one, other = (np.pad(mask[window], 1) for mask in (shadow, target))
    quantile = 0.0
    for walked, asked in ((one, other), (other, one)):
        distance = _distance_to_outline(asked)
        lines = [(line, _sample_outline(distance, line)) for line in _outlines(walked)]
        if lines:
            every = np.concatenate([off for _, off in lines])
            quantile = max(quantile, float(np.quantile(every, 0.95)))
        for line, off in lines:
            found = _longest_run(line, off, wrong_px)
            if found.length_px > worst.length_px:
                u, v = found.where
                worst = WrongStretch(found.length_px, found.off_px, (u + left - 1, v + top - 1))
    return replace(worst, quantile_95_px=max(quantile, 0.0))


def _outlines(mask: Mask) -> list[Array]:
    """Return closed polylines (n, 2) of (u, v); the last point repeats the first."""
    from contourpy import LineType, contour_generator

    generator = contour_generator(z=mask.astype(np.float64), line_type=LineType.Separate)
    lines = generator.lines(0.5)
    return [np.asarray(line, dtype=np.float64) for line in lines if len(line) > 2]


def _distance_to_outline(mask: Mask) -> Array:
    """Return each pixel's distance to the outline, px (H, W); the diagonal without one."""
    if not mask.any() or mask.all():
        return np.full(mask.shape, float(np.hypot(*mask.shape)))
    # the outline lies half a pixel before the nearest centre on the other side
    return np.asarray(np.where(mask, depth_in(mask), depth_in(~mask)) - 0.5)


def _sample_outline(field: Array, points: Array) -> Array:
    """Sample the field at points (n, 2) of (u, v): the smaller of the two neighbouring pixels' values."""
    u, v = points.T
    low = field[np.floor(v).astype(int), np.floor(u).astype(int)]
    high = field[np.ceil(v).astype(int), np.ceil(u).astype(int)]
    smaller: Array = np.minimum(low, high)
    return smaller


def _longest_run(line: Array, off: Array, wrong_px: float) -> WrongStretch:
    """Return the longest run of edges whose ends are both wrong, along one closed polyline."""
    wrong = off > wrong_px
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    bad = wrong[:-1] & wrong[1:]
    if bad.all():
        at = int(off.argmax())
        return WrongStretch(float(steps.sum()), float(off[at]), _point(line[at]))
    start = int(np.flatnonzero(~bad)[0])  # start at a correct point, so that no run is cut
    bad, steps = np.roll(bad, -start), np.roll(steps, -start)
    here = np.roll(np.arange(len(steps)), -start)
    run = np.cumsum(np.diff(bad.astype(int), prepend=0) == 1) * bad
    if not run.any():
        return WrongStretch(0.0, 0.0, (0.0, 0.0))
    lengths = np.bincount(run, weights=steps)
    lengths[0] = 0.0
    members = here[run == int(lengths.argmax())]
    at = int(members[off[members].argmax()])
    return WrongStretch(float(lengths.max()), float(off[at]), _point(line[at]))


def _point(uv: Array) -> tuple[float, float]:
    return (float(uv[0]), float(uv[1]))


# Exact distances on a grid of pixels, by compiled loops.


def depth_in(mask: Mask) -> Array:
    """Return the distance (H, W), px, of each pixel of a mask to the nearest one outside it; 0 outside.

    If nothing is outside, it is the diagonal of the grid.
    """
    if mask.all():
        return np.full(mask.shape, float(np.hypot(*mask.shape)))
    return np.asarray(np.sqrt(_square_depth(np.ascontiguousarray(mask))))


@compiled
def _square_depth(mask: Mask) -> Array:
    """Return the squared distances: columns first, then the lower envelope of parabolas in each row.

    The method, in integers throughout, is that of A. Meijster, J. B. T. M. Roerdink and W. H.
    Hesselink, "A general algorithm for computing distance transforms in linear time", 2000.
    """
    height, width = mask.shape
    far = height + width
    down = np.empty((height, width), dtype=np.int64)
    for x in range(width):
        down[0, x] = far if mask[0, x] else 0
    for y in range(1, height):
        for x in range(width):
            down[y, x] = min(down[y - 1, x] + 1, far) if mask[y, x] else 0
    for y in range(height - 2, -1, -1):
        for x in range(width):
            down[y, x] = min(down[y, x], down[y + 1, x] + 1)
    squares = np.zeros((height, width))
    apex, begins = np.empty(width, dtype=np.int64), np.empty(width, dtype=np.int64)
    for y in range(height):
        g, end = down[y], 0
        while end < width:
            if g[end] == 0:
                end += 1
                continue
            # the pixels that bound a run are the nearest to it
            begin = max(end - 1, 0)
            while end < width and g[end] > 0:
                end += 1
            stop, last = min(end + 1, width), 0
            apex[0], begins[0] = begin, begin
            for x in range(begin + 1, stop):
                while last >= 0:
                    at, old = begins[last], apex[last]
                    if (at - old) ** 2 + g[old] ** 2 <= (at - x) ** 2 + g[x] ** 2:
                        break
                    last -= 1
                if last < 0:
                    last, apex[0], begins[0] = 0, x, begin
                    continue
                old = apex[last]
                meet = 1 + (x * x - old * old + g[x] ** 2 - g[old] ** 2) // (2 * (x - old))
                if meet < stop:
                    last += 1
                    apex[last], begins[last] = x, meet
            for x in range(stop - 1, begin - 1, -1):
                squares[y, x] = (x - apex[last]) ** 2 + g[apex[last]] ** 2
                if x == begins[last]:
                    last -= 1
    return squares
