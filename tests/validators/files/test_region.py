"""A region that is a mesh, read with its scene."""

from pathlib import Path

import pytest
from region_meshes import KNOT, box_mesh

from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.scene import parse_scene, read_region_mesh, read_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.region import check_region
from tests.corpus.files import encode
from tests.corpus.parts import Body


def test_a_scene_reads_its_mesh_and_says_what_is_wrong_with_it(tmp_path: Path) -> None:
    mesh = box_mesh((86.0, 100.0, 10.0))

    def write(used: Mesh, name: str = "room.stl") -> None:
        body = Body(used.vertices, used.faces)
        (tmp_path / name).write_bytes(encode(body, "stl"))

    scene = tmp_path / "scene.toml"
    scene.write_text('[region]\nkind = "mesh"\nfile = "room.stl"\n')
    with pytest.raises(BadFile, match=r"room\.stl: cannot be read"):
        read_scene(scene)
    write(mesh)
    found = read_scene(scene)
    assert found.region.kind == "mesh" and found.surface is not None
    assert check_region(found.region, None, KNOT, None, found.surface).measured == pytest.approx(
        0.0, abs=1e-9
    )
    write(Mesh(mesh.vertices, mesh.faces[1:]))
    with pytest.raises(BadFile, match=r"\[region\] file: room\.stl is not a closed surface"):
        read_scene(scene)
    write(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    with pytest.raises(BadFile, match="inside out"):
        read_region_mesh(tmp_path / "room.stl", "scene.toml")
    for text in ('kind = "mesh"', 'kind = "box"\nfile = "room.stl"', 'kind = "mesh"\nfile = 3'):
        scene.write_text("[region]\n" + text)
        with pytest.raises(BadFile, match=r"\[region\] file"):
            read_scene(scene)
    bare = parse_scene({"region": {"kind": "mesh", "file": "room.stl"}}).region
    assert check_region(bare, None, KNOT).status == "skipped"
