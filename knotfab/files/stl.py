"""Binary STL: the whole part in one file, the same bytes for the same meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from knotfab.geometry.meshes import Mesh, face_normals

__all__ = ["write_stl"]

# A header that began with "solid" would be taken for a text STL; a date would spoil repeatability.
HEADER = b"knotfab binary STL, millimetres"
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(path: Path, bodies: Sequence[Mesh]) -> None:
    """Write all `bodies` (vertices (n, 3) mm, faces (m, 3)) into one binary STL.

    Coordinates are rounded to single precision, the format's; equal vertices stay equal, so a
    closed mesh stays closed. Normals are those of the unrounded faces.

    Raises:
        ValueError: no faces at all, or a coordinate that is not finite.
    """
    corners = [vertices[faces] for vertices, faces in bodies]
    triangles = np.concatenate(corners) if corners else np.empty((0, 3, 3))
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ValueError("an STL needs faces with finite corners")
    normal = face_normals(triangles)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    facets = np.zeros(len(triangles), dtype=FACET)
    facets["normal"] = normal / np.maximum(length, 1e-300)[:, None]
    facets["corners"] = triangles
    with path.open("wb") as file:
        file.write(HEADER.ljust(80, b"\0"))
        file.write(np.uint32(len(facets)).astype("<u4").tobytes())
        file.write(facets.tobytes())
