"""glTF binary: the piece for phones and viewers, in metres, as it hangs or stands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from knotfab.base.arrays import Array
from knotfab.geometry.meshes import Mesh

__all__ = ["write_glb"]

METRES = 1e-3
ROUGHNESS = 0.7


def write_glb(
    path: Path, bodies: Sequence[Mesh], pose: Array, names: Sequence[str], color: str
) -> None:
    """Write all `bodies` (vertices (n, 3) mm, faces (m, 3)) into one file of named meshes.

    Args:
        pose: (4, 4), from the bodies' coordinates to the scene, whose y is up as glTF's is.
        names: names of the bodies. color: their colour, "#rrggbb".
    """
    import trimesh as untyped

    trimesh: Any = untyped
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    paint = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*rgb, 255], metallicFactor=0.0, roughnessFactor=ROUGHNESS
    )
    scene = trimesh.Scene()
    for (vertices, faces), name in zip(bodies, names, strict=True):
        placed = METRES * (vertices @ pose[:3, :3].T + pose[:3, 3])
        mesh = trimesh.Trimesh(placed, faces, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=paint)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    path.write_bytes(bytes(scene.export(file_type="glb")))
