"""The distance between two bodies of triangles, exactly, by FCL's trees of boxes."""

from __future__ import annotations

from typing import Any

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["collision_body", "collision_distance"]


def collision_body(mesh: Mesh) -> Any:
    """Return the mesh as FCL holds it; its triangles may be edges (two equal corners)."""
    import fcl

    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model)


def collision_distance(one: Any, other: Any) -> tuple[float, Array]:
    """Give the least distance between two bodies, 0 if they cross, and the nearest points (2, 3) of them."""
    import fcl

    request, result = fcl.DistanceRequest(enable_nearest_points=True), fcl.DistanceResult()
    distance = max(float(fcl.distance(one, other, request, result)), 0.0)
    return distance, np.asarray(result.nearest_points, dtype=np.float64)
