"""Closed meshes as regions, and a knot to be held in them."""

import numpy as np
from validator_parts import circle

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh

CURVE = circle(360, 40.0)  # in the plane z = 0
KNOT = Curves((CURVE,), ("unknot",), (True,), 3.0)


def prism(*outline: tuple[float, float], low: float = -30.0, high: float = 30.0) -> Mesh:
    """What stands over a polygon that is a star about its first corner, from z `low` to `high`."""
    n = len(outline)
    flat = np.array(outline)
    vertices = np.vstack([np.c_[flat, np.full(n, low)], np.c_[flat, np.full(n, high)]])
    i = np.arange(n)
    j = (i + 1) % n
    caps = np.array([[0, k, k + 1] for k in range(1, n - 1)])
    sides = np.concatenate([np.c_[i, j, j + n], np.c_[i, j + n, i + n]])
    return Mesh(vertices, np.concatenate([caps[:, ::-1], caps + n, sides]))


def box_mesh(size: tuple[float, float, float]) -> Mesh:
    x, y, z = (s / 2 for s in size)
    return prism((-x, -y), (x, -y), (x, y), (-x, y), low=-z, high=z)
