"""What strangers' files have that a standard does not ask for is read and said, or refused by its name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from validator_parts import circle, tube

from knotfab_validators.check import BadFile
from knotfab_validators.geometry.mesh import Mesh, enclosed_volume
from tests.corpus.files import MESH, RELATIONS, as_3mf, cube_obj, cube_stl, cube_text, encode, model
from tests.corpus.judge import read_mesh
from tests.corpus.parts import Body

CUBE = 8000.0  # mm³
PRUSA = "Metadata/Slic3r_PE_model.config"
BAMBU = "Metadata/model_settings.config"


def read(folder: Path, name: str, content: bytes, unit: str = "mm") -> tuple[Mesh, list[str]]:
    (folder / name).write_bytes(content)
    notes: list[str] = []
    return read_mesh(folder / name, unit, notes), notes


def volume(folder: Path, name: str, content: bytes) -> tuple[float, str]:
    mesh, notes = read(folder, name, content)
    return enclosed_volume(mesh), " ".join(notes)


@pytest.mark.parametrize(("name", "content"), [("a.stl", cube_text()), ("a.obj", cube_obj())])
def test_byte_order_marks_are_passed_over(tmp_path: Path, name: str, content: bytes) -> None:
    assert volume(tmp_path, name, b"\xef\xbb\xbf" + content) == (pytest.approx(CUBE), "")


@pytest.mark.parametrize("header", [b"cube", b"solid of some program"])
@pytest.mark.parametrize("behind", [1, 2, 49, 51, 1000 + 1])
def test_bytes_behind_the_last_triangle_are_passed_over_and_told(
    tmp_path: Path, header: bytes, behind: int
) -> None:
    content = header.ljust(80) + cube_stl()[80:]
    found, notes = volume(tmp_path, "a.stl", content + b"\0" * behind)
    assert found == pytest.approx(CUBE) and f"{behind} byte" in notes


def test_an_empty_count_is_passed_over_and_told(tmp_path: Path) -> None:
    """Some programs never fill it in; slicers go by the file's length."""
    content = b"cube".ljust(80) + b"\0" * 4 + cube_stl()[84:]
    found, notes = volume(tmp_path, "a.stl", content)
    assert found == pytest.approx(CUBE) and "counts no triangles" in notes
    with pytest.raises(BadFile, match="not an STL"):
        read(tmp_path, "a.stl", content[:-1])


@pytest.mark.parametrize(
    "content", [cube_stl() + b"\0" * 100, cube_stl()[:-1], b"solid\0" + b"x" * 90]
)
def test_a_wrong_count_of_triangles_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(BadFile, match="not an STL"):
        read(tmp_path, "a.stl", content)


@pytest.mark.parametrize(("name", "content"), [("a.stl", cube_text()), ("a.obj", cube_obj())])
def test_decimal_commas_are_named(tmp_path: Path, name: str, content: bytes) -> None:
    with pytest.raises(BadFile, match="decimal commas"):
        read(tmp_path, name, content.replace(b"20.0", b"20,0"))


def objects(kind: str = "model", item: str = "", head: str = "", **entries: str) -> bytes:
    """A cube, and one above it of another kind, or whose item says more."""
    both = f'<object id="1">{MESH}</object><object id="2" type="{kind}">{MESH}</object>'
    items = f'<item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 90" {item}/>'
    text = model(both, items).replace("<resources>", f"{head}<resources>", 1)
    return as_3mf(text, **entries)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (objects("support"), "support object"),
        (objects("solidsupport"), "support object"),
        (objects(item='printable="0"'), "not printable"),
    ],
)
def test_what_is_not_printed_is_left_out_and_said(
    tmp_path: Path, content: bytes, said: str
) -> None:
    found, notes = volume(tmp_path, "a.3mf", content)
    assert found == pytest.approx(CUBE) and said in notes


def prusa(kind: str, key: str = "volume_type") -> str:
    """The settings of a project in which the second half of a cube's triangles is of a kind."""
    return (
        '<config><object id="1"><volume firstid="0" lastid="5"/><volume firstid="6" lastid="11">'
        f'<metadata type="volume" key="{key}" value="{kind}"/></volume></object></config>'
    )


def bambu(kind: str) -> str:
    return f'<config><object id="3"><part id="1"/><part id="2" subtype="{kind}"/></object></config>'


def assembled(**entries: str) -> bytes:
    both = "".join(f'<object id="{k}">{MESH}</object>' for k in (1, 2))
    parts = '<component objectid="1"/><component objectid="2"/>'
    whole = f'<object id="3"><components>{parts}</components></object>'
    return as_3mf(model(both + whole, '<item objectid="3"/>'), **entries)


@pytest.mark.parametrize("kind", ["ParameterModifier", "SupportBlocker", "SupportEnforcer"])
def test_modifiers_of_slicers_projects_are_left_out(tmp_path: Path, kind: str) -> None:
    one = as_3mf(model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>'))
    assert len(read(tmp_path, "a.3mf", one)[0].faces) == 12
    for text in (prusa(kind), prusa("1", "modifier")):
        entries = {PRUSA: text}
        content = as_3mf(
            model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>'), **entries
        )
        mesh, notes = read(tmp_path, "a.3mf", content)
        assert len(mesh.faces) == 6
        assert kind.lower() in notes[0] or "parametermodifier" in notes[0]
    mesh, notes = read(tmp_path, "b.3mf", assembled(**{BAMBU: bambu("modifier_part")}))
    assert len(mesh.faces) == 12 and "modifier_part" in notes[0]
    assert len(read(tmp_path, "b.3mf", assembled(**{BAMBU: bambu("normal_part")}))[0].faces) == 24


def outside(target: str) -> str:
    more = f'<Relationship Target="{target}" Id="x" Type="t" TargetMode="External"/>'
    return RELATIONS.replace("</Relationships>", f"{more}</Relationships>")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (assembled(**{BAMBU: bambu("negative_part")}), "negative volume"),
        (objects(**{PRUSA: prusa("NegativeVolume")}), "negative volume"),
        (objects("other"), "type other"),
        (objects("ghost"), "type ghost"),
        (objects(head='<metadata name="Title">a</metadata>' * 2), "metadata Title twice"),
        (objects(**{"3D/_rels/3dmodel.model.rels": outside("http://a.b/c")}), "outside the file"),
        (
            as_3mf(model(f'<object id="1" type="support">{MESH}</object>', '<item objectid="1"/>')),
            "nothing of it is printed",
        ),
    ],
)
def test_what_the_core_standard_forbids_is_refused(
    tmp_path: Path, content: bytes, said: str
) -> None:
    with pytest.raises(BadFile, match=said):
        read(tmp_path, "a.3mf", content)


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("in", 25.4)])
def test_a_file_without_a_unit_has_the_one_that_is_given(
    tmp_path: Path, unit: str, mm: float
) -> None:
    for name, content in (("a.stl", cube_stl()), ("a.obj", cube_obj())):
        mesh, _ = read(tmp_path, name, content, unit)
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx([20 * mm] * 3)
    mesh, notes = read(tmp_path, "a.3mf", objects(), unit)
    assert enclosed_volume(mesh) == pytest.approx(2 * CUBE)
    assert bool(notes) == (unit != "mm")


def test_corners_that_rounding_parted_are_joined(tmp_path: Path) -> None:
    cube, _ = read(tmp_path, "cube.stl", cube_stl())
    corners = cube.vertices[cube.faces] + np.random.default_rng(1).normal(0, 5e-6, (12, 3, 3))
    facets = np.zeros(12, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("x", "<u2")])
    facets["corners"] = corners
    content = bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes()
    found, said = volume(tmp_path, "a.stl", content)
    assert found == pytest.approx(CUBE, rel=1e-4) and "were joined" in said
    facets["corners"][0, 0] += 0.01  # a real gap stays one
    mesh, notes = read(tmp_path, "b.stl", content[:84] + facets.tobytes())
    assert len(mesh.vertices) > 8 and not notes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace(b"endsolid cube", b"").replace(b"endsolid", b""), "no end"),
        (lambda text: b"# made by hand\n; twice\n" + text, ""),
        (lambda text: text + b"\0\0\n", ""),
    ],
)
def test_loose_text_stl_is_read(tmp_path: Path, change: Any, words: str) -> None:
    found, said = volume(tmp_path, "a.stl", change(cube_text()))
    assert found == pytest.approx(CUBE) and words in said


@pytest.mark.parametrize("size_mm", [1e-3, 1e-6])
@pytest.mark.slow
def test_a_cloud_of_tiny_triangles_is_read_as_it_is(size_mm: float, tmp_path: Path) -> None:
    """Each corner is as near to every other as rounding would leave it: joining them would never end."""
    corners = size_mm * np.random.default_rng(0).random((20_000, 3, 3))
    faces = np.arange(60_000).reshape(-1, 3)
    (tmp_path / "cloud.stl").write_bytes(encode(Body(corners.reshape(-1, 3), faces), "stl"))
    assert len(read_mesh(tmp_path / "cloud.stl").faces) > 19_000


# Triangles of STL files, binary and text, are read as they are.


@pytest.mark.parametrize("form", ["stl", "stl-text"])
def test_an_stl_gives_its_triangles_and_joins_equal_corners(tmp_path: Path, form: str) -> None:
    vertices, faces = tube(circle(30) + 100, 3.0, 8)
    single = vertices.astype(np.float32).astype(np.float64)
    (tmp_path / "part.stl").write_bytes(encode(Body(single, faces), form))
    mesh = read_mesh(tmp_path / "part.stl")
    np.testing.assert_allclose(
        mesh.vertices[mesh.faces], single[faces], rtol=0 if form == "stl" else 1e-8
    )
    assert len(mesh.vertices) == 30 * 8
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.int64
