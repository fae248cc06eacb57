"""The distance between the bodies of a mesh that are nearest to each other."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.collision import collision_body, collision_distance
from knotfab_validators.geometry.heap import tell_heap
from knotfab_validators.geometry.mesh import Mesh, number_bodies

__all__ = ["nearest_bodies"]


MOST_BODIES = 500


def nearest_bodies(mesh: Mesh) -> tuple[float, Array] | str:
    """Least distance between two connected pieces of the surface, and the nearest points (2, 3).

    0 where two cross. By python-fcl's trees of boxes, whose triangle distances are exact; pairs of
    bodies are taken in the order of their bounding boxes' distance. Returns a sentence instead
    where there is only one body, or more than 500, or the faces are such a heap that trees do not help.
    """
    # faces that lie on each other are at one distance from everything
    once = np.unique(np.sort(mesh.faces, axis=1), axis=0)
    if len(once) < len(mesh.faces):
        mesh = Mesh(mesh.vertices, once)
    label, count = number_bodies(mesh)
    if count == 1:
        return "the part is one body"
    if count > MOST_BODIES:
        return f"the part falls into {count} bodies, more than {MOST_BODIES}"
    if why := tell_heap(mesh):
        return why
    models, low, high = [], [], []
    for body in range(count):
        faces = mesh.faces[label[mesh.faces[:, 0]] == body]
        used, index = np.unique(faces, return_inverse=True)
        points = mesh.vertices[used]
        low.append(points.min(axis=0))
        high.append(points.max(axis=0))
        models.append(collision_body(Mesh(points, index.reshape(-1, 3))))
    i, j = np.triu_indices(count, 1)
    a, b = np.array(low), np.array(high)
    gap = np.linalg.norm(np.maximum(np.maximum(a[i] - b[j], a[j] - b[i]), 0.0), axis=1)
    best, points = np.inf, np.zeros((2, 3))
    for k in np.argsort(gap):
        if gap[k] >= best:
            break
        distance, nearest = collision_distance(models[i[k]], models[j[k]])
        if distance < best:
            best, points = distance, nearest
    return best, points
