"""Place points about a surface: their distance from it, and how often it winds round them (libigl)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["surface_distance", "winding_numbers"]


def surface_distance(points: Array, mesh: Mesh) -> Array:
    """Return (n,) distance of points (n, 3) from the nearest face, mm."""
    from igl import point_mesh_squared_distance

    square = point_mesh_squared_distance(*_contiguous(points, mesh.vertices, mesh.faces))[0]
    return np.sqrt(np.maximum(np.asarray(square, dtype=np.float64), 0.0))


def winding_numbers(points: Array, mesh: Mesh, *, exact: bool = True) -> Array:
    """Return (n,) generalised winding numbers of points (n, 3): in matter of a closed mesh 1, outside 0.

    Exact ones sum up the solid angles of all faces; the others have an error of about a thousandth,
    and more near the surface (Barill et al., "Fast winding numbers for soups and clouds", ACM TOG
    37(4), 2018).
    """
    from igl import fast_winding_number, winding_number

    if not len(points):
        return np.zeros(0)
    wind = winding_number if exact else fast_winding_number
    found = wind(*_contiguous(mesh.vertices, mesh.faces, points))
    return np.asarray(found, dtype=np.float64).ravel()


def _contiguous(*arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Make arrays contiguous, as libigl takes them."""
    return tuple(np.ascontiguousarray(array) for array in arrays)
