"""The plates on which a part is printed in several pieces: 3MF files beside the scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import Mesh, number_bodies

if TYPE_CHECKING:
    from knotfab_formats.scene import Plate as Listed
    from knotfab_validators.files.scene import Scene

__all__ = ["Plate", "read_plates", "read_table"]


@dataclass(frozen=True)
class Plate:
    """A plate: its whole mesh in its own print coordinates, and where its bodies go in the part.

    `body` (n,) is the number of each vertex's body, in the order of their first faces; `to_part` (k, 4, 4)
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
        """Return points (n, 3) of the plate, on the bodies (n,), where they are in the part."""
        motion = self.to_part[body.clip(max=len(self.to_part) - 1)]
        moved: Array = np.einsum("nij,nj->ni", motion[:, :3, :3], points) + motion[:, :3, 3]
        return moved

    def places(self, points: Array) -> Array:
        """Return (n, 3) the same, of points anywhere on the plate: each goes with its nearest vertex."""
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(self.mesh.vertices).query(points)
        return self.in_part(points, self.body[nearest])


def read_plates(folder: Path, scene: Scene) -> list[Plate]:
    """Read the plates that the scene names, from `folder`.

    Raises:
        BadFile: a plate cannot be read.
    """
    return _read(folder, scene.pose.plates if scene.pose is not None else ())


def read_table(folder: Path, scene: Scene) -> list[Plate]:
    """Read the plates of the frame that holds lamps; `to_part` takes their bodies to the scene."""
    return _read(folder, scene.lamps.table)


def _read(folder: Path, listed: tuple[Listed, ...]) -> list[Plate]:
    found = []
    for plate in listed:
        mesh = read_mesh(folder / plate.file)
        to_part = np.array(plate.matrices, dtype=np.float64)
        found.append(Plate(plate.file, mesh, number_bodies(mesh)[0], to_part))
    return found
