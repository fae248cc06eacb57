"""Compiled loops of bending: what the other pictures leave uncovered of each, and its gradient."""

from __future__ import annotations

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled

__all__ = ["sample_field", "uncovered"]


@compiled
def sample_field(field: Array, u: Array, v: Array, value: Array, slope: Array) -> None:
    """Write bilinear values (n,) of a field (h, w), and slopes (n, 2), at (u, v); at its ends as there."""
    rows, columns = field.shape
    for n in range(len(u)):
        x, y = min(max(u[n], 0.0), columns - 1.001), min(max(v[n], 0.0), rows - 1.001)
        i, j = int(y), int(x)
        p, q = y - i, x - j
        a, b, c, d = field[i, j], field[i, j + 1], field[i + 1, j], field[i + 1, j + 1]
        value[n] = (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d)
        slope[n, 0] = (1 - p) * (b - a) + p * (d - c)
        slope[n, 1] = (1 - q) * (c - a) + q * (d - b)


@compiled
def uncovered(
    cover: Array,
    firsts: Indices,
    shapes: Indices,
    projections: Array,
    owner: Indices,
    pixel: Indices,
    inside: Mask,
    begin: Array,
    ray: Array,
    along: Array,
    winner: Indices,
    pull: Array,
) -> float:
    """Return the sum of squares of the pictures' parts that the shadow of the others' hull does not cover.

    The hull's shadow on a ray is the most, along it, of the least that the others cover there.

    Args:
        cover: (N,) of all views' pixels, one after the other; of view k from `firsts[k]` on.
        projections: (m, 3, 4) onto these pixels. owner, pixel: each ray's view, and its place in `cover`.
        inside: whether each ray is in its frame; places outside are uncovered. winner: winner
            of each ray where the shadow was found last; it is set. pull: (N,) the gradient; it is added to.
    """
    total = 0.0
    count = len(shapes)
    here, ahead = np.empty((count, 3)), np.empty((count, 3))
    for n in range(len(owner)):
        own = cover[pixel[n]]
        if own <= 1e-4:
            continue
        best, where, which = 0.0, -1, -1
        if inside[n]:
            for k in range(count):
                for i in range(3):
                    p = projections[k, i]
                    here[k, i] = p[0] * begin[n, 0] + p[1] * begin[n, 1] + p[2] * begin[n, 2] + p[3]
                    ahead[k, i] = p[0] * ray[n, 0] + p[1] * ray[n, 1] + p[2] * ray[n, 2]
            for trial in range(-1, len(along)):
                t = winner[n] if trial < 0 else trial
                a = along[t]
                least, by = 2.0, -1
                for k in range(count):
                    if k == owner[n]:
                        continue
                    w = here[k, 2] + a * ahead[k, 2]
                    u, v = (here[k, 0] + a * ahead[k, 0]) / w, (here[k, 1] + a * ahead[k, 1]) / w
                    rows, columns = shapes[k]
                    if w <= 0 or not (0 <= u < columns - 1 and 0 <= v < rows - 1):
                        least = 0.0
                        break
                    i, j = int(v), int(u)
                    f, q, e = v - i, u - j, firsts[k] + i * columns + j
                    value = (1 - f) * ((1 - q) * cover[e] + q * cover[e + 1]) + f * (
                        (1 - q) * cover[e + columns] + q * cover[e + columns + 1]
                    )
                    if value < least:
                        least, by = value, k
                    if least <= best:
                        break
                if least > best:
                    best, where, which = least, t, by
                if best >= own:
                    break
        if where >= 0:
            winner[n] = where
        lack = own - best
        if lack <= 0:
            continue
        total += lack * lack
        pull[pixel[n]] += 2 * lack
        if which >= 0:
            a = along[where]
            w = here[which, 2] + a * ahead[which, 2]
            u = (here[which, 0] + a * ahead[which, 0]) / w
            v = (here[which, 1] + a * ahead[which, 1]) / w
            columns = shapes[which, 1]
            i, j = int(v), int(u)
            f, q, e = v - i, u - j, firsts[which] + i * columns + j
            pull[e] -= 2 * lack * (1 - f) * (1 - q)
            pull[e + 1] -= 2 * lack * (1 - f) * q
            pull[e + columns] -= 2 * lack * f * (1 - q)
            pull[e + columns + 1] -= 2 * lack * f * q
    return total
