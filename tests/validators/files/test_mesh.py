"""A 3MF's objects are read where they are placed; what is no file is refused. Other formats: test_hostile."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from knotfab_validators.files.mesh import read_mesh


def test_3mf_places_its_objects_and_knows_its_unit(tmp_path: Path) -> None:
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.CentiMeter)
    body = model.AddMeshObject()
    for x, y, z in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]:
        body.AddVertex(lib3mf.Position((x, y, z)))
    for face in [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]:
        body.AddTriangle(lib3mf.Triangle(face))
    model.AddBuildItem(body, wrapper.GetIdentityTransform())
    model.AddBuildItem(body, wrapper.GetTranslationTransform(5.0, 0.0, 0.0))
    model.QueryWriter("3mf").WriteToFile(str(tmp_path / "part.3mf"))
    mesh = read_mesh(tmp_path / "part.3mf")
    assert len(mesh.faces) == 8 and len(mesh.vertices) == 8
    assert mesh.vertices.max(axis=0) == pytest.approx([60, 10, 10])
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.volume == pytest.approx(2 * 1000 / 6)
