"""pymeshlab and trimesh, which neither maker nor validators use, on the same parts."""

import numpy as np
import pymeshlab
import pytest
from validator_parts import trefoil

from knotfab.geometry.tube import sweep
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.surface_checks import self_intersections


def _count_selected(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Faces that pymeshlab finds to intersect others."""
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.apply_filter("compute_selection_by_self_intersections_per_face")
    return int(meshes.current_mesh().selected_face_number())


@pytest.mark.parametrize(("size", "clear"), [(12.0, True), (4.0, False)])
def test_self_intersection_agrees_with_pymeshlab(size: float, clear: bool) -> None:
    vertices, faces = sweep(trefoil(300, size), 3.0, 24)
    ours = len(self_intersections(Mesh(vertices, faces.astype(np.int64))))
    assert (ours == 0) == clear
    assert (_count_selected(vertices, faces) == 0) == clear
