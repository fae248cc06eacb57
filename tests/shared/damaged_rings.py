"""A round tube to be damaged, its centre line, and the checks of its surface by their names."""

import numpy as np
from validator_parts import Array, circle, tube

from knotfab_formats.verdict import MESH, Check
from knotfab_validators.arrays import Ints
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh

RADIUS, SIDES = 4.0, 48
CIRCLE = circle(120)


def ring(**changes: Array | Ints) -> Mesh:
    vertices, faces = tube(CIRCLE, RADIUS, SIDES)
    return Mesh(**{"vertices": vertices, "faces": faces, **changes})  # type: ignore[arg-type]


def two(first: Mesh, second: Mesh) -> Mesh:
    return Mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
    )


def curves(*polygons: Array, radius: float | None = RADIUS) -> Curves:
    n = len(polygons)
    return Curves(polygons, ("unknot",) * n, (True,) * n, radius)


def by_name(checks: list[Check]) -> dict[str, Check]:
    assert tuple(c.name for c in checks) == MESH
    return {c.name: c for c in checks}
