"""A tube that was swept round until it met itself, but not sewn together there: its two rims, joined."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["sew_rims"]

NEAR = 0.25  # a share of the rims' radius, between their middles
ALIKE = 0.2  # a share of the rims' radius, between their radii


def sew_rims(mesh: Mesh) -> Mesh | None:
    """Return a surface with two like rims in one place, closed by a strip of faces; None where it is not so.

    VTK's tubes about closed lines are so: the rings at the seam are turned against each other.

    Args:
        mesh: one body, wound in one way.
    """
    rims = _rims(mesh)
    if len(rims) != 2:
        return None
    one, other = rims[0], rims[1][::-1]  # both the same way round the tube now
    a, b = mesh.vertices[one], mesh.vertices[other]
    sizes = [float(np.linalg.norm(p - p.mean(axis=0), axis=1).mean()) for p in (a, b)]
    apart = float(np.linalg.norm(a.mean(axis=0) - b.mean(axis=0)))
    if apart > NEAR * min(sizes) or max(sizes) - min(sizes) > ALIKE * max(sizes):
        return None
    nearest = int(np.linalg.norm(b - a[0], axis=1).argmin())
    strip = _zip(one, np.roll(other, -nearest), a, np.roll(b, -nearest, axis=0))
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, strip]))


def _rims(mesh: Mesh) -> list[Ints]:
    """Give the closed lines of half-edges without a twin, as vertices in their order; none if they branch."""
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    count = np.int64(len(mesh.vertices))
    bare = ~np.isin(start * count + end, end * count + start)
    start, end = start[bare], end[bare]
    if len(np.unique(start)) != len(start):
        return []
    after = dict(zip(start.tolist(), end.tolist(), strict=True))
    rims = []
    while after:
        first, at = after.popitem()
        rim = [first]
        while at != first:
            rim.append(at)
            if at not in after:
                return []
            at = after.pop(at)
        rims.append(np.array(rim))
    return rims


def _zip(one: Ints, other: Ints, a: Array, b: Array) -> Ints:
    """Return the faces of a strip between two rings of vertices (n,) and (m,), at points a and b.

    Each step goes on along the ring of which the smaller share of the length is done.
    """
    shares = []
    for points in (a, b):
        step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        shares.append(np.cumsum(step) / step.sum())
    faces, i, j = [], 0, 0
    while i < len(one) or j < len(other):
        here, there = one[i % len(one)], other[j % len(other)]
        if j == len(other) or (i < len(one) and shares[0][i] <= shares[1][j]):
            i += 1
            faces.append((one[i % len(one)], here, there))
        else:
            j += 1
            faces.append((there, other[j % len(other)], here))
    return np.array(faces)
