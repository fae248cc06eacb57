"""STL and 3MF: what is read back is what was written, byte for byte the same each time."""

import io
import locale
import re
import subprocess
import zipfile
from pathlib import Path

import lib3mf
import numpy as np
import pytest
import trimesh
from PIL import Image

from knotfab import __version__
from knotfab.geometry.tube import Mesh, join_meshes, mesh_volume, split_shells, sweep
from knotfab.part.files import (
    About,
    read_back_strict,
    read_shells,
    write_3mf,
    write_coloured_3mf,
    write_stl,
)
from knotfab.part.slicer_process import REMEDY, find_slicer
from knotfab_validators.files.mesh import read_mesh


@pytest.fixture
def bodies() -> list[Mesh]:
    """Two rings, apart, in the positive octant, at single precision."""
    t = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    ring = np.stack([30 * np.cos(t), 30 * np.sin(t), 5 * np.sin(2 * t)], axis=1)
    return [
        (vertices.astype(np.float32).astype(np.float64), faces)
        for vertices, faces in (
            sweep(ring + np.array([40, 40, 10]), 2.0, 12),
            sweep(0.5 * ring + np.array([100, 40, 10]), 2.0, 12),
        )
    ]


def test_stl_reads_back_closed_with_the_same_volume(tmp_path: Path, bodies: list[Mesh]) -> None:
    write_stl(tmp_path / "part.stl", bodies)
    part = trimesh.load_mesh(tmp_path / "part.stl")
    assert part.is_watertight and part.is_winding_consistent and part.body_count == 2
    assert part.volume == pytest.approx(sum(mesh_volume(*b) for b in bodies), rel=1e-6)
    wanted = np.concatenate([vertices[faces] for vertices, faces in bodies])
    assert (part.triangles == wanted).all()
    raw = (tmp_path / "part.stl").read_bytes()
    assert len(raw) == 84 + 50 * len(wanted) and not raw.startswith(b"solid")
    facets = np.frombuffer(raw[84:], dtype=[("n", "<f4", 3), ("c", "<f4", 9), ("a", "<u2")])
    assert facets["n"] == pytest.approx(part.face_normals, abs=1e-5)


def test_files_are_repeatable(tmp_path: Path, bodies: list[Mesh]) -> None:
    for suffix, write in ((".stl", write_stl), (".3mf", write_3mf)):
        first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
        write(first, bodies)
        write(second, bodies)
        assert first.read_bytes() == second.read_bytes()


def test_3mf_is_clean_and_complete(tmp_path: Path, bodies: list[Mesh]) -> None:
    path = tmp_path / "part.3mf"
    write_3mf(path, bodies, About("Ring & <ring>"))
    assert read_back_strict(path) == []
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    about = model.GetMetaDataGroup()
    found = {about.GetMetaData(i).GetName(): about.GetMetaData(i).GetValue() for i in range(2)}
    assert found["Title"] == "Ring & <ring>" and found["Application"].startswith("knotfab ")
    # one thing to print: one mesh of all bodies, where they are
    items, objects = model.GetBuildItems(), model.GetObjects()
    assert items.Count() == objects.Count() == 1 and items.MoveNext()
    _is_identity(items.GetCurrent().GetObjectTransform())
    whole = model.GetMeshObjectByID(items.GetCurrent().GetObjectResourceID())
    assert whole.GetName() == "Ring & <ring>" and whole.IsManifoldAndOriented()
    vertices, faces = join_meshes(bodies)
    read = np.array([list(p.Coordinates) for p in whole.GetVertices()])
    assert read == pytest.approx(vertices, abs=1e-5) and (read >= 0).all()
    assert np.array_equal([list(t.Indices) for t in whole.GetTriangleIndices()], faces)


def test_what_it_is_and_a_small_picture(tmp_path: Path, bodies: list[Mesh]) -> None:
    """Both stand under the core specification's names; slicers and the validators read the file still."""
    drawn = io.BytesIO()
    Image.new("RGB", (30, 20), "red").save(drawn, "PNG")
    path, again = tmp_path / "part.3mf", tmp_path / "again.3mf"
    about = About("Cat", "Ada & Bob", 'Lit "so": 5 < 6 mm.', "CC BY 4.0", drawn.getvalue())
    for one in (path, again):
        write_3mf(one, bodies, about)
    assert path.read_bytes() == again.read_bytes() and read_back_strict(path) == []
    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    group = model.GetMetaDataGroup()
    found = [group.GetMetaData(i) for i in range(group.GetMetaDataCount())]
    assert {one.GetName(): one.GetValue() for one in found} == {
        "Title": "Cat",
        "Designer": "Ada & Bob",
        "Description": 'Lit "so": 5 < 6 mm.',
        "LicenseTerms": "CC BY 4.0",
        "Application": f"knotfab {__version__}",
    }
    assert bytes(model.GetPackageThumbnailAttachment().WriteToBuffer()) == drawn.getvalue()
    with zipfile.ZipFile(path) as archive:
        relations = archive.read("_rels/.rels").decode()
        kinds = archive.read("[Content_Types].xml").decode()
    (to,) = re.findall(r'Target="/?([^"]+\.png)"', relations)
    with zipfile.ZipFile(path) as archive:
        assert archive.read(to) == drawn.getvalue()
    assert "/package/2006/relationships/metadata/thumbnail" in relations
    assert 'Extension="png" ContentType="image/png"' in kinds
    assert len(read_mesh(path).faces) == sum(len(faces) for _, faces in bodies)


def _is_identity(transform: lib3mf.Transform) -> None:
    assert np.array_equal(np.array(transform.Fields), np.eye(4)[:, :3])


def test_it_holds_no_settings_of_a_slicer(tmp_path: Path, bodies: list[Mesh]) -> None:
    """The model alone, without what any slicer would take for a profile or a colour of its own."""
    path = tmp_path / "part.3mf"
    write_3mf(path, bodies)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        model = archive.read("3D/3dmodel.model").decode()
    assert set(names) == {"[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"}
    assert model.count("<object ") == model.count("<item ") == model.count("<mesh>") == 1
    assert "<component" not in model and "<base" not in model


def test_shells_are_read_as_they_were_written(tmp_path: Path, bodies: list[Mesh]) -> None:
    """The maker and the validators, which share no code, read the same shells."""
    path = tmp_path / "part.3mf"
    write_3mf(path, bodies)
    found = read_shells(path)
    for (own, order), (vertices, faces) in zip(found, bodies, strict=True):
        assert own == pytest.approx(vertices, abs=1e-5) and np.array_equal(order, faces)
    mesh = read_mesh(path)
    corners = np.concatenate([v[f] for v, f in found])
    assert np.array_equal(mesh.vertices[mesh.faces], corners)


def test_shells_are_told_apart_whatever_the_order_of_their_faces(bodies: list[Mesh]) -> None:
    vertices, faces = join_meshes([*bodies, bodies[0]])
    assert len(vertices) == sum(len(v) for v, _ in bodies) + len(bodies[0][0])
    mixed = np.random.default_rng(0).permutation(len(faces))
    found = split_shells((vertices, faces[mixed]))
    assert sorted(len(f) for _, f in found) == sorted(len(f) for _, f in [*bodies, bodies[0]])
    for shell in found:
        assert any(mesh_volume(*shell) == pytest.approx(mesh_volume(*body)) for body in bodies)


def test_what_is_no_3mf_has_no_shells(tmp_path: Path) -> None:
    (tmp_path / "part.3mf").write_bytes(b"no archive")
    for name in ("part.3mf", "missing.3mf"):
        with pytest.raises(ValueError, match="not a 3MF"):
            read_shells(tmp_path / name)


def test_colours_and_names(tmp_path: Path, bodies: list[Mesh]) -> None:
    """One item whose components are the bodies, where they are."""
    path = tmp_path / "part-colours.3mf"
    names = ["knot 1", "a plate"]
    write_coloured_3mf(path, bodies, names, ["#D9d4c7", "#000001"], About("both"))
    assert read_back_strict(path) == []
    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    items = model.GetBuildItems()
    assert items.Count() == 1 and items.MoveNext()
    whole = model.GetComponentsObjectByID(items.GetCurrent().GetObjectResourceID())
    assert whole.GetComponentCount() == 2 and whole.GetName() == "both"
    found = []
    for i, (name, (vertices, faces)) in enumerate(zip(names, bodies, strict=True)):
        _is_identity(whole.GetComponent(i).GetTransform())
        body = model.GetMeshObjectByID(whole.GetComponent(i).GetObjectResourceID())
        assert body.GetName() == name and body.IsManifoldAndOriented()
        read = np.array([list(p.Coordinates) for p in body.GetVertices()])
        assert read == pytest.approx(vertices, abs=1e-5)
        assert np.array_equal([list(t.Indices) for t in body.GetTriangleIndices()], faces)
        resource, prop, has = body.GetObjectLevelProperty()
        shade = model.GetBaseMaterialGroupByID(resource).GetDisplayColor(prop)
        assert has
        found.append((shade.Red, shade.Green, shade.Blue, shade.Alpha))
    assert found == [(0xD9, 0xD4, 0xC7, 255), (0, 0, 1, 255)]
    # a colour that occurs twice is one material, and the file is repeatable
    write_coloured_3mf(path, bodies, names, ["#aabbcc", "#AABBCC"], About("both"))
    with zipfile.ZipFile(path) as archive:
        assert archive.read("3D/3dmodel.model").decode().count("<base ") == 1
    again = tmp_path / "again.3mf"
    write_coloured_3mf(again, bodies, names, ["#aabbcc", "#AABBCC"], About("both"))
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("colors", [["#aabbcc"], ["red", "red"], ["#aabbc", "#aabbcc"], []])
def test_invalid_colours_are_refused(tmp_path: Path, bodies: list[Mesh], colors: list[str]) -> None:
    with pytest.raises(ValueError, match="colour"):
        write_coloured_3mf(tmp_path / "part.3mf", bodies, ["a", "b"], colors, About("x"))
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(find_slicer() is None, reason=f"PrusaSlicer is not installed: {REMEDY}")
def test_prusaslicer_opens_it(tmp_path: Path, bodies: list[Mesh]) -> None:
    write_3mf(tmp_path / "part.3mf", bodies)
    slicer = find_slicer()
    assert slicer is not None
    command = [slicer, "--datadir", str(tmp_path / "settings"), "--info", "part.3mf"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    (read,) = re.findall(r"^volume = ([\d.]+)", done.stdout, re.MULTILINE)
    assert float(read) == pytest.approx(sum(mesh_volume(*body) for body in bodies), rel=1e-5)
    every = join_meshes(bodies)[0]
    for axis, (name, of) in enumerate((n, o) for n in "xyz" for o in ("min", "max")):
        (found,) = re.findall(rf"^{of}_{name} = ([-\d.]+)", done.stdout, re.MULTILINE)
        assert float(found) == pytest.approx(getattr(every[:, axis // 2], of)(), abs=1e-4)
    assert done.stdout.count("manifold = yes") == 1
    assert re.search(r"^number_of_parts = +2$", done.stdout, re.MULTILINE)


def test_locale_is_left_as_it_was(tmp_path: Path, bodies: list[Mesh]) -> None:
    before = locale.setlocale(locale.LC_ALL)
    write_3mf(tmp_path / "part.3mf", bodies)
    assert locale.setlocale(locale.LC_ALL) == before
    read_back_strict(tmp_path / "part.3mf")
    read_back_strict(tmp_path / "missing.3mf")
    assert locale.setlocale(locale.LC_ALL) == before


def test_what_cannot_be_written_is_refused(tmp_path: Path, bodies: list[Mesh]) -> None:
    below = [(bodies[0][0] - [50.0, 0.0, 0.0], bodies[0][1])]
    broken = [(np.where(bodies[0][0] > 60, np.nan, bodies[0][0]), bodies[0][1])]
    for wrong in (below, broken, [], [(bodies[0][0], bodies[0][1][:0])]):
        with pytest.raises(ValueError):
            write_3mf(tmp_path / "part.3mf", wrong)
    with pytest.raises(ValueError, match="names"):
        write_coloured_3mf(tmp_path / "part.3mf", bodies, ["one"], ["#aabbcc"] * 2, About("x"))
    for wrong in (broken, []):
        with pytest.raises(ValueError):
            write_stl(tmp_path / "part.stl", wrong)
    assert not list(tmp_path.iterdir())


def test_strict_reader_refuses_a_broken_archive(tmp_path: Path, bodies: list[Mesh]) -> None:
    """An index beyond the vertices, a repeated index, and bytes of no archive are refused."""
    path = tmp_path / "part.3mf"
    write_3mf(path, bodies)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for wrong in (b'<triangle v1="0" v2="99999" v3="1"', b'<triangle v1="1" v2="1" v3="2"'):
        model = files["3D/3dmodel.model"]
        start = model.index(b"<triangle ")
        end = model.index(b" />", start)
        changed = {**files, "3D/3dmodel.model": model[:start] + wrong + model[end:]}
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in changed.items():
                archive.writestr(name, content)
        assert read_back_strict(path)
    path.write_bytes(b"no archive")
    assert read_back_strict(path)
