"""The plates on which a part is printed in several pieces: plate-N.3mf, beside the scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .read_mesh import Mesh, read_mesh
from .read_scene import Scene

__all__ = ["Laid", "read_plates"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Laid:
    """A plate: its whole mesh in its own print coordinates, and where its bodies go in the part.

    `body` (n,) is the number of each vertex's body, counted in the file's order; `to_part` (k, 4, 4)
    are the scene's motions. There may be more bodies than motions, or fewer.
    """

    name: str
    mesh: Mesh
    body: Ints
    to_part: Array

    @property
    def bodies(self) -> int:
        return int(self.body.max()) + 1

    def in_part(self, points: Array, body: Ints) -> Array:
        """Points (n, 3) of the plate, on the bodies (n,), where they are in the part."""
        motion = self.to_part[body.clip(max=len(self.to_part) - 1)]
        moved: Array = np.einsum("nij,nj->ni", motion[:, :3, :3], points) + motion[:, :3, 3]
        return moved

    def places(self, points: Array) -> Array:
        """(n, 3) the same, of points anywhere on the plate: each goes with its nearest vertex."""
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(self.mesh.vertices).query(points)
        return self.in_part(points, self.body[nearest])


def read_plates(folder: Path, scene: Scene) -> list[Laid]:
    """The plates that the scene names, from `folder`.

    Raises:
        BadFile: a plate cannot be read.
    """
    found = []
    for number, motions in enumerate(scene.plates, start=1):
        name = f"plate-{number}.3mf"
        mesh = read_mesh(folder / name)
        found.append(Laid(name, mesh, _bodies(mesh), np.array(motions, dtype=np.float64)))
    return found


def _bodies(mesh: Mesh) -> Ints:
    """(n,) the number of each vertex's connected surface, in the order of their first faces."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    n = len(mesh.vertices)
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    of_faces = label[mesh.faces[:, 0]]
    names, first = np.unique(of_faces, return_index=True)
    rank = np.zeros(int(label.max()) + 1, dtype=np.int64)
    rank[names[np.argsort(first)]] = np.arange(len(names))
    numbers: Ints = rank[label]
    return numbers
