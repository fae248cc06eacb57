"""A 3MF's components and transforms are placed as lib3mf places them, over several parts as well."""

import io
import os
import shutil
import zipfile
from pathlib import Path

import lib3mf
import numpy as np
import pytest
from tables import some

from knotfab_validators.check import MOST_TRIANGLES, BadFile
from knotfab_validators.files import threemf_model
from knotfab_validators.files.scene import read_knots, read_scene
from knotfab_validators.files.threemf import DEEPEST, corners_3mf
from knotfab_validators.files.threemf_rows import Rows, cut_rows
from knotfab_validators.geometry.mesh import enclosed_volume
from tests.corpus.files import CORE, MESH, as_3mf, cube_obj, model, seeds
from tests.corpus.fuzzed import fuzz_file
from tests.corpus.hostile import handmade
from tests.corpus.judge import examine, read_mesh

TURNED = "0.8 0.6 0 -0.6 0.8 0 0 0 1 3 -4 5"
STRETCHED = "2 0 0 0.5 1 0 0 0.25 1.5 7 8 -9"


def nest() -> str:
    """Two cubes in an object that is in another, each with a transform of its own."""
    pair = f'<component objectid="1" transform="{TURNED}"/><component objectid="1"/>'
    more = f'<component objectid="2" transform="{STRETCHED}"/><component objectid="1"/>'
    objects = [
        f'<object id="1" type="model">{MESH}</object>',
        f'<object id="2" type="model"><components>{pair}</components></object>',
        f'<object id="3" type="model"><components>{more}</components></object>',
    ]
    items = f'<item objectid="3" transform="{TURNED}"/><item objectid="1"/>'
    return model("".join(objects), items)


def by_lib3mf(content: bytes) -> np.ndarray:
    read = lib3mf.get_wrapper().CreateModel()
    read.QueryReader("3mf").ReadFromBuffer(content)
    objects, parts = read.MergeToModel().GetMeshObjects(), []
    while objects.MoveNext():
        body = objects.GetCurrentMeshObject()
        points = np.array([list(p.Coordinates) for p in body.GetVertices()])
        parts.append(points[np.array([list(t.Indices) for t in body.GetTriangleIndices()])])
    return np.concatenate(parts)


def test_components_within_components_are_placed_as_by_lib3mf() -> None:
    content = as_3mf(nest())
    ours = corners_3mf(content, "a.3mf")
    assert ours.shape == (48, 3, 3)
    np.testing.assert_allclose(ours, by_lib3mf(content), atol=1e-4)


def test_objects_may_lie_in_another_part_of_the_package() -> None:
    """Some slicers write them so (Production Extension)."""
    production = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
    part = model(f'<object id="7" type="model">{MESH}</object>', "")
    root = (
        f'<model xmlns="{CORE}" xmlns:p="{production}" requiredextensions="p"><resources>'
        '<object id="1"><components><component p:path="/3D/Objects/A.model" objectid="7" '
        'transform="1 0 0 0 1 0 0 0 1 5 0 0"/></components></object></resources>'
        '<build><item objectid="1"/></build></model>'
    )
    content = as_3mf(root, **{"3D/objects/a.model": part})
    corners = corners_3mf(content, "a.3mf")
    assert corners.shape == (12, 3, 3) and corners.max(axis=(0, 1)) == pytest.approx([25, 20, 20])
    with pytest.raises(BadFile, match="different units"):
        corners_3mf(as_3mf(root, **{"3D/objects/a.model": part.replace("millimeter", "inch")}), "")
    with pytest.raises(BadFile, match=r"has no 3d/objects/a\.model"):
        corners_3mf(as_3mf(root), "a.3mf")


def chain(levels: int) -> bytes:
    objects = [f'<object id="0">{MESH}</object>']
    for i in range(levels):
        inner = f'<components><component objectid="{i}"/></components>'
        objects.append(f'<object id="{i + 1}">{inner}</object>')
    return as_3mf(model("".join(objects), f'<item objectid="{levels}"/>'))


def test_components_may_be_in_each_other_up_to_a_limit() -> None:
    assert len(corners_3mf(chain(DEEPEST), "a.3mf")) == 12
    with pytest.raises(BadFile, match="in each other"):
        corners_3mf(chain(DEEPEST + 1), "a.3mf")


def test_triangles_are_counted_before_they_are_made() -> None:
    """The largest number that is allowed would be made: here the count alone is looked at."""
    rows = 2000
    mesh = MESH.replace(
        "</triangles>", '<triangle v1="0" v2="1" v3="2"/>' * (rows - 12) + "</triangles>"
    )
    most = MOST_TRIANGLES // rows
    items = '<item objectid="1"/>' * (most + 1)
    with pytest.raises(BadFile, match="more than 20000000 triangles"):
        corners_3mf(as_3mf(model(f'<object id="1">{mesh}</object>', items)), "a.3mf")


def test_points_are_in_single_precision_as_by_lib3mf() -> None:
    content = as_3mf(nest().replace("20.0", "20.123456789"))
    plain = as_3mf(
        model(
            f'<object id="1">{MESH.replace("20.0", "20.123456789")}</object>',
            '<item objectid="1"/>',
        )
    )
    assert np.array_equal(corners_3mf(plain, "a.3mf"), by_lib3mf(plain))
    np.testing.assert_allclose(corners_3mf(content, "a.3mf"), by_lib3mf(content), atol=1e-4)


def test_what_is_not_built_is_not_read_as_part_of_it() -> None:
    two = f'<object id="1">{MESH}</object><object id="2">{MESH}</object>'
    assert len(corners_3mf(as_3mf(model(two, '<item objectid="2"/>')), "a.3mf")) == 12


@pytest.mark.parametrize(
    "line", ['<!DOCTYPE m [<!ENTITY x SYSTEM "file:///dev/zero">]>', "<!DOCTYPE m>"]
)
def test_document_types_are_refused_before_they_do_anything(line: str) -> None:
    with pytest.raises(BadFile, match="document type"):
        corners_3mf(as_3mf(nest().replace("<model", f"{line}<model", 1)), "a.3mf")


# Rows of a 3MF that are read apart are those that expat would read, and nothing else is taken for
# one.


POINTS = np.random.default_rng(0).normal(0, 90, (40, 3))
FACES = np.random.default_rng(1).integers(0, 40, (2000, 3))


def mesh(
    point: str = '<vertex x="{}" y="{}" z="{}" />',
    face: str = '<triangle v1="{}" v2="{}" v3="{}"/>',
    digits: str = ".6f",
    space: str = "\n\t",
) -> str:
    points = [point.format(*(format(x, digits) for x in row)) for row in POINTS.tolist()]
    faces = [face.format(*row) for row in FACES.tolist()]
    inner = f"<vertices>{space}{space.join(points)}</vertices>"
    return f"<mesh>{inner}<triangles>{space.join(faces)}{space}</triangles></mesh>"


def package(content: str) -> bytes:
    return as_3mf(model(f'<object id="1">{content}</object>', '<item objectid="1"/>'))


def cut(content: str) -> dict[int, Rows]:
    return cut_rows(content.encode())[1]


def by_expat(content: bytes, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    monkeypatch.setattr(threemf_model, "cut_rows", lambda text: (text, {}))
    found = corners_3mf(content, "a.3mf")
    monkeypatch.undo()
    return found


WRITTEN = {
    "as lib3mf writes it": mesh(),
    "without spaces": mesh(space=""),
    "fifteen digits": mesh(digits=".11f"),
    "whole numbers": mesh(digits=".0f"),
    "more digits than a double has": mesh(digits=".17f"),
}
OTHERWISE = {
    "exponents": mesh(digits=".9e"),
    "other quotes": mesh(point="<vertex x='{}' y='{}' z='{}' />"),
    "another order": mesh(point='<vertex z="{}" y="{}" x="{}" />'),
    "an end tag": mesh(point='<vertex x="{}" y="{}" z="{}"></vertex>'),
    "a sign": mesh(point='<vertex x="+1" y="{}" z="{}" /><!-- {} -->'),
}


@pytest.mark.parametrize("name", [*WRITTEN, *OTHERWISE])
def test_corners_are_those_that_expat_reads(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = {**WRITTEN, **OTHERWISE}[name]
    kinds = {rows.kind for rows in cut(content).values()}
    assert kinds == ({"vertices", "triangles"} if name in WRITTEN else {"triangles"})
    found = corners_3mf(package(content), "a.3mf")
    assert found.shape == (2000, 3, 3)
    assert np.array_equal(found, by_expat(package(content), monkeypatch))


def test_rows_stand_where_their_tag_is_in_what_is_left() -> None:
    content = mesh().encode()
    rest, found = cut_rows(content + content)
    assert rest == b"<mesh><vertices></vertices><triangles></triangles></mesh>" * 2
    assert len(found) == 4
    for place, rows in found.items():
        assert rest[place:].startswith(f"<{rows.kind}>".encode())
        if rows.kind == "triangles":
            assert np.array_equal(rows.numbers, FACES)
        else:
            np.testing.assert_allclose(rows.numbers, POINTS, atol=5.1e-7, rtol=0)


@pytest.mark.parametrize("hidden", ["<!--{}-->", "<metadata><![CDATA[{}]]></metadata>"])
def test_what_is_no_element_is_not_read(hidden: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = package(hidden.format(mesh(digits=".0f")) + mesh())
    found = corners_3mf(content, "a.3mf")
    assert found.shape == (2000, 3, 3)
    assert np.array_equal(found, by_expat(content, monkeypatch))


@pytest.mark.parametrize(
    "row",
    [
        *('<vertex x="1" y="2"/>', '<vertex x="" y="1" z="2"/>', '<vertex x="1" y="2" z="a"/>'),
        *('<vertex x="1-2" y="" z="3"/>', '<vertex x="1.2.3" y="1" z="2"/>'),
        *(
            '<vertex x="1 2" y="3" z=""/>',
            '<vertex x="1 2" y=" " z="3"/>',
            '<vertex x1="" y="2" z="3"/>',
        ),
    ],
)
def test_a_row_that_is_no_three_numbers_is_refused_as_before(row: str) -> None:
    with pytest.raises(BadFile, match="not three numbers"):
        corners_3mf(package(mesh().replace("<vertices>", f"<vertices>{row}")), "a.3mf")


def test_a_file_larger_than_is_looked_at_at_once_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threemf_model, "MOST_AT_ONCE", 1000)
    content = package(mesh())
    assert np.array_equal(corners_3mf(content, "a.3mf"), by_expat(content, monkeypatch))


# Strangers' files are refused in one sentence; sound ones of every format are read alike.


def volume(path: Path) -> float:
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("name", [n for n in seeds() if n.split(".")[1] not in ("json", "toml")])
def test_every_format_reads_the_same_cube(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(seeds()[name])
    mesh = read_mesh(path)
    assert mesh.vertices.shape == (8, 3) and mesh.faces.shape == (12, 3)
    assert volume(path) == pytest.approx(8000.0, rel=1e-6)
    other = tmp_path / "cube.unknown"  # the content tells
    other.write_bytes(seeds()[name])
    assert volume(other) == pytest.approx(8000.0, rel=1e-6)


@pytest.mark.slow
def test_hostile_files_get_one_sentence(tmp_path: Path) -> None:
    for file in handmade():
        place = tmp_path / "place"
        place.mkdir()
        outcome = examine(file, place)
        if file.says is None:
            assert outcome.kind in ("pass", "fail", "refused"), (file.name, outcome.said)
        else:
            assert outcome.kind == "refused" and file.says in outcome.said, (file.name, outcome)
        assert {p.name for p in place.iterdir()} <= {file.name, "failures.png"}
        shutil.rmtree(place)


@pytest.mark.slow
@pytest.mark.parametrize("block", some(range(4), 4))
def test_fuzzed_files_end_in_a_verdict_or_a_sentence(block: int, tmp_path: Path) -> None:
    # seeds among the 10,000 of make validator-table
    for seed in range(15 * block, 15 * (block + 1)):
        outcome = examine(fuzz_file(seed), tmp_path)
        assert outcome.kind in ("pass", "fail", "refused"), (seed, outcome)


def test_fuzzing_repeats_itself() -> None:
    assert fuzz_file(7) == fuzz_file(7) != fuzz_file(8)


def test_what_is_no_plain_file_is_refused_without_waiting(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.stl"
    os.mkfifo(pipe)
    loop = tmp_path / "loop.stl"
    loop.symlink_to(loop)
    for path in (pipe, loop, tmp_path, Path("/dev/zero"), tmp_path / "none.stl"):
        for read in (read_mesh, read_knots, read_scene):
            with pytest.raises(BadFile, match=path.name):
                read(path)


def test_faces_that_are_wrong_reach_the_checks(tmp_path: Path) -> None:
    """Equal faces, and one with a corner twice, are not repaired away."""
    path = tmp_path / "a.obj"
    path.write_bytes(cube_obj() + b"f 1 2 4\nf 1 1 2\n")
    assert len(read_mesh(path).faces) == 14


def test_a_3mf_has_its_units_transforms_and_components(tmp_path: Path) -> None:
    mesh = seeds()["cube.3mf"]
    assert mesh[:2] == b"PK"
    cube = f'<object id="1" type="model">{MESH}</object>'
    pair = (
        '<object id="2" type="model"><components><component objectid="1"/><component objectid="1" '
        'transform="1 0 0 0 1 0 0 0 1 50 0 0"/></components></object>'
    )
    twice = model(cube + pair, '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 7"/>')
    path = tmp_path / "a.3mf"
    path.write_bytes(as_3mf(twice))
    read = read_mesh(path)
    assert len(read.faces) == 24 and read.vertices.max(axis=0) == pytest.approx([70, 20, 27])
    notes: list[str] = []
    path.write_bytes(
        as_3mf(model(cube, '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'))
    )
    assert enclosed_volume(read_mesh(path, notes=notes)) == pytest.approx(8000.0)
    assert len(notes) == 1 and "mirrored an object" in notes[0]  # k56
    for unit, mm in (("inch", 25.4), ("centimeter", 10.0)):
        path.write_bytes(as_3mf(twice.replace("millimeter", unit)))
        assert read_mesh(path).vertices.max(axis=0) == pytest.approx(mm * np.array([70, 20, 27]))


def test_open_curves_are_read(tmp_path: Path) -> None:
    path = tmp_path / "k.json"
    path.write_text(
        '{"schema": 1, "knots": [{"closed": false, "points": [[0,0,0],[3,0,0],[3,4,0]]},'
        ' {"points": [[0,0,9],[3,0,9],[3,4,9]]}]}'
    )
    curves = read_knots(path)
    assert curves.closed == (False, True) and curves.types == ("open", "unknot")
    assert curves.lengths_mm == (7.0, 12.0)


RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
MODELS = "".join(
    f'<Relationship Id="r{k}" Target="/3D/{k}.model" Type="{threemf_model.START_PART}"/>'
    for k in (1, 2)
)
CURA = '<metadatagroup><metadata name="cura:{}">{}</metadata></metadatagroup>'
# what programs put into an archive: entries by name, the object's own words, triangles and a note or refusal
STRANGE: dict[str, tuple[dict[str, str], str, int, str]] = {
    "relations to several models": (
        {"3D/_rels/3dmodel.model.rels": f'<Relationships xmlns="{RELATIONS}">{MODELS}</Relationships>'},
        "", 12, ""),
    "Finder's": (
        {"__MACOSX/_rels/._.rels": "\0\5", "3D/._3dmodel.model": "\0", ".DS_Store": "\0"}, "", 12, ""),
    "a profile": (
        {"Metadata/Slic3r_PE.config": "; perimeters = 1\n"}, "", 12, "perimeters to 1: not checked"),
    "nothing set": ({"Metadata/project_settings.config": "{}", "Metadata/plate_1.png": "x"}, "", 12, ""),
    **{
        kind: ({}, CURA.format(kind, "True"), 0, f"nothing of it is printed: left out .* cura:{kind}")
        for kind in threemf_model.CURA_KINDS
    },
    "no modifier": ({}, CURA.format("cutting_mesh", "False"), 12, ""),
}  # fmt: skip


@pytest.mark.parametrize("case", STRANGE)
def test_what_programs_put_beside_a_model(case: str) -> None:
    entries, words, triangles, said = STRANGE[case]
    text = model(f'<object id="1" type="model">{words}{MESH}</object>', '<item objectid="1"/>')
    notes: list[str] = []
    if not triangles:
        with pytest.raises(BadFile, match=said):
            corners_3mf(as_3mf(text, **entries), "a.3mf", notes)
        return
    assert len(corners_3mf(as_3mf(text, **entries), "a.3mf", notes)) == triangles
    assert (said in notes[0]) if said else notes == []


@pytest.mark.parametrize("name", ["part.glb", "part.gltf", "part.stl"])
def test_a_gltf_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"glTF\2\0\0\0" if name != "part.gltf" else b"{}")
    with pytest.raises(
        BadFile, match="it is not an STL" if "stl" in name else "it is glTF, .*name part.stl"
    ):
        read_mesh(tmp_path / name)


def test_what_is_doubted_is_counted_up_to_a_bound() -> None:
    words = "".join(f"<w{k}/>" for k in range(3000))
    text = model(f'<object id="1">{words}{MESH}</object>', '<item objectid="1"/>')
    with pytest.raises(BadFile, match=r"the element w0; .* the element w9, and no build") as found:
        corners_3mf(as_3mf(text), "a.3mf", strict=True)
    assert str(found.value).count("the element") <= threemf_model.MOST_DOUBTS


def test_an_archive_of_a_folder_or_of_gcode_is_told() -> None:
    with zipfile.ZipFile(io.BytesIO(as_3mf(model(f'<object id="1">{MESH}</object>', "")))) as file:
        entries = {name: file.read(name) for name in file.namelist()}
    for prefix, more, said in (
        ("ring/", {}, "its files lie in the folder ring/ of the archive"),
        ("", {"Metadata/plate_1.gcode": b"G28"}, r"it holds only G-code \(plate_1.gcode\)"),
    ):
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as file:
            for name, content in (entries | more).items():
                file.writestr(prefix + name, content)
        with pytest.raises(BadFile, match=said):
            corners_3mf(packed.getvalue(), "a.3mf")
