"""The signed distance of a capsule's silhouette in 50 digits: what double precision is held against."""

from __future__ import annotations

import mpmath

from knotfab.render.silhouette import NEAREST_RADII

_ZERO = mpmath.mpf(0)
Vector = list[mpmath.mpf]


def _dot(a: Vector, b: Vector) -> mpmath.mpf:
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def signed_distance_px(
    a: list[float], b: list[float], q: tuple[float, float], radius: float, focal_px: float
) -> mpmath.mpf | None:
    """Return (r - d) focal / z for the ray (q, 1): d from the line to the segment a-b, z where it is nearest.

    None for what lies before the light's near plane. The least distance is found from the components of
    both ends across the ray, not from moments.
    """
    with mpmath.workdps(50):
        one, two = [mpmath.mpf(x) for x in a], [mpmath.mpf(x) for x in b]
        least = mpmath.mpf(max(NEAREST_RADII * radius, 1e-9))
        if one[2] < least and two[2] < least:
            return None
        one, two = _cut(one, two, least), _cut(two, one, least)
        d = [mpmath.mpf(q[0]), mpmath.mpf(q[1]), mpmath.mpf(1)]
        across = []
        for p in (one, two):
            share = _dot(p, d) / _dot(d, d)
            across.append([x - share * y for x, y in zip(p, d, strict=True)])
        way = [y - x for x, y in zip(*across, strict=True)]
        square = _dot(way, way)
        t = _ZERO if square == 0 else -_dot(across[0], way) / square
        t = min(max(t, _ZERO), mpmath.mpf(1))
        at = [x + t * w for x, w in zip(across[0], way, strict=True)]
        depth = one[2] + t * (two[2] - one[2])
        return (mpmath.mpf(radius) - mpmath.sqrt(_dot(at, at))) * mpmath.mpf(focal_px) / depth


def _cut(end: Vector, other: Vector, least: mpmath.mpf) -> Vector:
    if end[2] >= least:
        return end
    t = (least - end[2]) / (other[2] - end[2])
    return [x + t * (y - x) for x, y in zip(end, other, strict=True)]
