"""Read a closed mesh as the allowed region of a scene."""

from __future__ import annotations

from pathlib import Path

from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.surface import survey

__all__ = ["read_region_mesh"]


def read_region_mesh(path: Path, where: str) -> Mesh:
    """The closed mesh of an STL file, in mm.

    Args:
        where: how an error names the key of the scene.

    Raises:
        BadFile: it cannot be read, has a hole or faces wound against each other, or is inside out.
    """
    try:
        mesh = read_mesh(path)
    except BadFile as error:
        raise BadFile(f"{where}: {error}") from error
    found = survey(mesh)
    if not found.closed:
        edges = len(found.open_edges) + len(found.flipped_edges)
        raise BadFile(f"{where}: {path.name} is not a closed surface ({edges} edges are not right)")
    if not found.volumes_mm3.sum() > 0:
        raise BadFile(f"{where}: {path.name} encloses nothing, or is turned inside out")
    return mesh
