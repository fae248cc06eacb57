"""Parts are read from STL and 3MF as they are; what is no such file is refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from validator_parts import Array, circle, tube

from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.mesh import read_mesh


def binary_stl(corners: Array) -> bytes:
    record = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = corners
    return b"solid".ljust(80) + np.uint32(len(corners)).tobytes() + record.tobytes()


@pytest.fixture
def corners() -> Array:
    vertices, faces = tube(circle(30) + 100, 3.0, 8)
    return np.asarray(vertices.astype(np.float32)[faces])


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


def bad_files(corners: Array) -> dict[str, bytes]:
    whole = binary_stl(corners)
    broken = corners.copy()
    broken[5, 1, 2] = np.nan
    return {
        "empty": b"",
        "words": b"this is not a mesh at all, only some words in a file",
        "cut off": whole[:-7],
        "head only": whole[:60],
        "count too large": whole[:80] + b"\xff\xff\xff\xff" + whole[84:],
        "no triangles": whole[:80] + bytes(4),
        "solid and nothing": b"solid nothing\nendsolid nothing\n",
        "half a text": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n",
        "not finite": binary_stl(broken),
        "zip of nothing": b"PK\x03\x04" + bytes(100),
    }


NAMES = sorted(bad_files(np.zeros((6, 3, 3))))


@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_mesh_is_refused(name: str, tmp_path: Path, corners: Array) -> None:
    (tmp_path / "part.stl").write_bytes(bad_files(corners)[name])
    with pytest.raises(BadFile, match=r"^part\.stl: "):
        read_mesh(tmp_path / "part.stl")


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.stl", tmp_path):
        with pytest.raises(BadFile, match=r"cannot be read|is a folder"):
            read_mesh(path)
