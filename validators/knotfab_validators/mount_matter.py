"""Which of a part's vertices belong to the tube, and which to the mount that holds it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["tube_vertices"]

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Mask = NDArray[np.bool_]

OFF = 1.06  # radii from the centre lines: facets and mitred rings stand out by less
REACH = 2.0  # radii from the centre lines: a mount leads farther away than that, a swollen tube does not
SPACING = 0.125  # radii between the samples of the centre lines


def tube_vertices(vertices: Array, faces: Faces, polygons: Sequence[Array], radius: float) -> Mask:
    """(n,) whether each vertex is the tube's: all but those of matter that leads away from it.

    A vertex within `OFF` radii of the centre lines lies on the tube. Those farther out are the mount's
    where some vertex that is joined to them by edges, without touching the tube, is farther than
    `REACH` radii away. So a tube that is swollen, or displaced by up to its own radius, stays a tube.

    Args:
        vertices, faces: (n, 3) and (m, 3), mm. polygons: closed, [(k, 3), ...] mm, one radius.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    samples = []
    for polygon in polygons:
        edge = np.roll(polygon, -1, axis=0) - polygon
        pieces = np.maximum(np.ceil(np.linalg.norm(edge, axis=1) / (SPACING * radius)), 1)
        count = pieces.astype(np.int64)
        which = np.repeat(np.arange(len(count)), count)
        number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        samples.append(polygon[which] + (number / count[which])[:, None] * edge[which])
    limit = REACH * radius
    tree = cKDTree(np.concatenate(samples))
    distance, _ = tree.query(vertices, distance_upper_bound=limit)
    off = distance > OFF * radius
    own: Mask = ~off
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    both = off[start] & off[end]
    n = len(vertices)
    links = coo_matrix((np.ones(int(both.sum())), (start[both], end[both])), shape=(n, n))
    _, label = connected_components(links, directed=False)
    far = np.zeros(n, dtype=bool)
    far[label[off & ~(distance < limit)]] = True
    own |= off & ~far[label]
    return own
