"""Compiled loops of bending: what the other pictures leave uncovered of each, and its gradient."""

from __future__ import annotations

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled

__all__ = ["sample_field", "uncovered"]


@compiled
def sample_field(field: Array, u: Array, v: Array, value: Array, slope: Array) -> None:
    """Bilinear values (n,) of a field (h, w), and their slopes (n, 2), at (u, v); at its ends as there."""
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
    """The squares of what the pictures cover and the shadow of the hull of the others does not, summed.

    The hull's shadow on a ray is the most, along it, of the least that the others cover there.

    Args:
        cover: (N,) of all views' pixels, one after the other; of view k from `firsts[k]` on.
        projections: (m, 3, 4) onto these pixels. owner, pixel: of each ray, its view, its place in `cover`.
        inside: of each ray, whether it is in its frame; what is outside is uncovered. winner: of each ray
            where the shadow was found last; it is set. pull: (N,) the gradient; it is added to.
    """
    total = 0.0
    for n in range(len(owner)):
        own = cover[pixel[n]]
        if own <= 1e-4:
            continue
        best, where, which = 0.0, -1, -1
        if inside[n]:
            for trial in range(-1, len(along)):
                t = winner[n] if trial < 0 else trial
                a = along[t]
                x, y, z = (
                    begin[n, 0] + a * ray[n, 0],
                    begin[n, 1] + a * ray[n, 1],
                    begin[n, 2] + a * ray[n, 2],
                )
                least, by = 2.0, -1
                for k in range(len(shapes)):
                    if k == owner[n]:
                        continue
                    p = projections[k]
                    w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                    u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w
                    v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w
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
            a, p = along[where], projections[which]
            x, y, z = (
                begin[n, 0] + a * ray[n, 0],
                begin[n, 1] + a * ray[n, 1],
                begin[n, 2] + a * ray[n, 2],
            )
            w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
            u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w
            v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w
            columns = shapes[which, 1]
            i, j = int(v), int(u)
            f, q, e = v - i, u - j, firsts[which] + i * columns + j
            pull[e] -= 2 * lack * (1 - f) * (1 - q)
            pull[e + 1] -= 2 * lack * (1 - f) * q
            pull[e + columns] -= 2 * lack * f * (1 - q)
            pull[e + columns + 1] -= 2 * lack * f * q
    return total
