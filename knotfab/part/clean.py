"""A united body as it will be written: in single precision, and still not crossing itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab.geometry.meshes import Mesh, as_manifold, as_mesh, face_normals

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["clean_body"]

# Slivers along the seams of a union may turn over when their corners are rounded; edges shorter than
# these are collapsed, the least that is enough.
TOLERANCES_MM = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)


def clean_body(body: Mesh) -> Mesh:
    """Return the body with corners that single precision (STL) holds exactly, without crossings if possible.

    Each tolerance is tried until libigl's exact predicates find no two faces that cross and none
    without an area; where none is enough, the last is returned and the validators will say so.

    Args:
        body: a closed mesh in print coordinates.
    """
    solid = as_manifold(body)
    rounded = body
    for tolerance in TOLERANCES_MM:
        rounded = _round_solid(solid.simplify(tolerance))
        if _is_clean(rounded):
            break
    return rounded


def _round_solid(solid: Manifold) -> Mesh:
    vertices, faces = as_mesh(solid)
    return vertices.astype(np.float32).astype(np.float64), faces


def _is_clean(body: Mesh) -> bool:
    from igl import predicates

    vertices, faces = body
    if len(np.unique(vertices, axis=0)) < len(vertices):
        return False  # two corners became one
    if not face_normals(vertices[faces]).any(axis=1).all():
        return False
    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int64)
    )
    return len(pairs) == 0
