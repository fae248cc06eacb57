"""The distance between the bodies of a mesh that are nearest to each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .read_mesh import Mesh

__all__ = ["nearest_bodies"]

Array = NDArray[np.float64]

MOST_BODIES = 500


def nearest_bodies(mesh: Mesh) -> tuple[float, Array] | str:
    """Least distance between two connected pieces of the surface, and the nearest points (2, 3).

    0 where two cross. By python-fcl's trees of boxes, whose triangle distances are exact; pairs of
    bodies are taken in the order of their bounding boxes' distance. Returns a sentence instead
    where there is only one body, or more than 500.
    """
    import fcl
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(mesh.vertices)
    rows, columns = mesh.faces[:, [0, 1]].ravel(), mesh.faces[:, [1, 2]].ravel()
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    bodies = np.unique(label[mesh.faces[:, 0]])
    if len(bodies) == 1:
        return "the part is one body"
    if len(bodies) > MOST_BODIES:
        return f"the part falls into {len(bodies)} bodies, more than {MOST_BODIES}"
    models, low, high = [], [], []
    for body in bodies:
        faces = mesh.faces[label[mesh.faces[:, 0]] == body]
        used, index = np.unique(faces, return_inverse=True)
        points = mesh.vertices[used]
        low.append(points.min(axis=0))
        high.append(points.max(axis=0))
        model = fcl.BVHModel()
        model.beginModel(len(points), len(faces))
        model.addSubModel(points, index.reshape(-1, 3))
        model.endModel()
        models.append(fcl.CollisionObject(model))
    i, j = np.triu_indices(len(bodies), 1)
    a, b = np.array(low), np.array(high)
    gap = np.linalg.norm(np.maximum(np.maximum(a[i] - b[j], a[j] - b[i]), 0.0), axis=1)
    best, points = np.inf, np.zeros((2, 3))
    for k in np.argsort(gap):
        if gap[k] >= best:
            break
        asked = fcl.DistanceRequest(enable_nearest_points=True)
        answer = fcl.DistanceResult()
        distance = max(float(fcl.distance(models[i[k]], models[j[k]], asked, answer)), 0.0)
        if distance < best:
            best, points = distance, np.array(answer.nearest_points)
    return best, points
