"""Part a part's vertices into those of the tube, and those of the mount that holds it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.mesh import connect
from knotfab_validators.geometry.sampling import cut_edges

__all__ = ["OFF", "strand_faces", "tube_vertices"]


OFF = 1.06  # radii from the centre lines: facets and mitred rings stand out by less
REACH = 2.0  # radii from the centre lines: a mount leads farther away than that, a swollen tube does not
PROUD = 1.02  # radii from the centre lines: what stands out farther is no facet of the tube
BESIDE = 3.0  # radii along a knot: a face that spans more leads from one strand to another
SPACING = 0.125  # radii between the samples of the centre lines
ALONG = 1.2  # times a face's side: the strand between its ends, where it runs along a straight one


def tube_vertices(vertices: Array, faces: Ints, polygons: Sequence[Array], radius: float) -> Mask:
    """Tell (n,) whether each vertex is the tube's: all but those of matter that leads away from it.

    A vertex within `OFF` radii of the centre lines lies on the tube. Those farther out are the mount's
    where some vertex that is joined to them by edges, without touching the tube, is farther than
    `REACH` radii away. So a tube that is swollen, or displaced by up to its own radius, stays a tube.

    Args:
        vertices, faces: (n, 3) and (m, 3), mm. polygons: closed, [(k, 3), ...] mm, one radius.
    """
    from scipy.spatial import cKDTree

    limit = REACH * radius
    tree = cKDTree(np.concatenate([_sample(polygon, radius) for polygon in polygons]))
    distance, _ = tree.query(vertices, distance_upper_bound=limit)
    off = distance > OFF * radius
    own: Mask = ~off
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    both = off[start] & off[end]
    n = len(vertices)
    label, _ = connect(start[both], end[both], n)
    far = np.zeros(n, dtype=bool)
    far[label[off & ~(distance < limit)]] = True
    own |= off & ~far[label]
    return own


def strand_faces(
    vertices: Array,
    faces: Ints,
    polygons: Sequence[Array],
    radius: float,
    *,
    proud: float = PROUD,
    beside: float = BESIDE,
) -> Mask:
    """Tell (m,) whether each face is the tube's surface and no mount's: close to it, and to one strand alone.

    Args:
        vertices, faces: (n, 3) and (m, 3), mm. polygons: closed, [(k, 3), ...] mm, one radius.
        proud: radii from the centre line that a face may reach. beside: and along it.
    """
    from scipy.spatial import cKDTree

    samples = [_sample(polygon, radius) for polygon in polygons]
    count = np.array([len(s) for s in samples])
    first = np.concatenate([[0], np.cumsum(count)])
    tree = cKDTree(np.concatenate(samples))
    distance, nearest = tree.query(vertices, distance_upper_bound=REACH * radius)
    close = (distance <= proud * radius)[faces].all(axis=1)
    place = np.minimum(nearest, first[-1] - 1)[faces]
    knot = np.searchsorted(first, place, side="right") - 1
    result: Mask = close & (knot == knot[:, :1]).all(axis=1)
    apart = np.abs(place - place[:, [1, 2, 0]])
    apart = np.minimum(apart, count[knot] - apart)
    # a long face along a straight strand has corners as far apart as the strand between them is long
    side = np.linalg.norm(vertices[faces] - vertices[faces[:, [1, 2, 0]]], axis=2) / radius
    # samples are at most SPACING apart, so that so many of them are at most so long
    result &= (apart <= np.maximum(beside, ALONG * side) / SPACING).all(axis=1)
    return result


def _sample(polygon: Array, radius: float) -> Array:
    """Return (n, 3) points along a closed polygon, at most `SPACING` radii apart."""
    end = np.roll(polygon, -1, axis=0)
    which, begin, _ = cut_edges(polygon, end, SPACING * radius)
    return np.asarray(polygon[which] + begin[:, None] * (end - polygon)[which])
