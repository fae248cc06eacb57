"""The 3MF beside an STL: the same surface in any order, or another one, and where."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
from validator_parts import trefoil, tube

from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.same_surface import (
    LIMIT_MM,
    check_same_3mf,
    compare_surfaces,
    find_3mf,
)
from tests.corpus.case import make_part
from tests.corpus.curves import circle
from tests.corpus.files import MESH, RELATIONS, encode, model, rewrite_archive, write
from tests.corpus.parts import Body

VERTICES, FACES = tube(trefoil(150) + 60.0, 3.0, 16)
SURFACE = Mesh(VERTICES, FACES)


def reordered() -> Mesh:
    rng = np.random.default_rng(1)
    order = rng.permutation(len(VERTICES))
    faces = np.argsort(order)[FACES[rng.permutation(len(FACES))]]
    turned = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
    return Mesh(VERTICES[order], np.take_along_axis(faces, turned, axis=1))


@pytest.mark.parametrize("other", [SURFACE, reordered()])
def test_order_and_rounding_make_no_difference(other: Mesh) -> None:
    rounded = Mesh(other.vertices.astype(np.float32).astype(np.float64), other.faces)
    found = compare_surfaces(SURFACE, rounded)
    assert found.faces == 0 and found.away_mm < 1e-5


@pytest.mark.parametrize("factor", [0.9, 1.1])
@pytest.mark.parametrize("other", [SURFACE, reordered()])
def test_one_vertex_may_be_off_by_a_thousandth(other: Mesh, factor: float) -> None:
    vertices = other.vertices.copy()
    vertices[77, 2] += factor * LIMIT_MM
    found = compare_surfaces(SURFACE, Mesh(vertices, other.faces))
    assert found.faces == 0 and found.away_mm == pytest.approx(factor * LIMIT_MM, rel=1e-6)
    assert len(found.at) == (factor > 1)
    if factor > 1:
        assert np.linalg.norm(found.at[0] - vertices[77]) < 2 * LIMIT_MM


CHANGES: dict[str, tuple[Callable[[], Mesh], int]] = {
    "a face less": (lambda: Mesh(VERTICES, FACES[1:]), 1),
    "a face more": (lambda: Mesh(VERTICES, np.concatenate([FACES, FACES[5:6]])), 1),
    "a face turned": (lambda: Mesh(VERTICES, np.concatenate([FACES[:1, ::-1], FACES[1:]])), 2),
    "inside out": (lambda: Mesh(VERTICES, FACES[:, ::-1]), 2 * len(FACES)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_other_faces_between_the_same_vertices_are_counted(name: str) -> None:
    make, count = CHANGES[name]
    assert compare_surfaces(SURFACE, make()).faces == count


def test_the_check_reads_what_lies_beside(tmp_path: Path) -> None:
    part = tmp_path / "part-03.stl"
    body = Body(VERTICES, FACES)
    part.write_bytes(encode(body, "stl"))
    mesh = read_mesh(part)
    none = check_same_3mf(mesh, part)
    assert none.status == "skipped" and not none.required and "no part-03.3mf" in none.detail
    (tmp_path / "part-03.3mf").write_bytes(encode(body, "3mf"))
    right = check_same_3mf(mesh, part)
    assert right.status == "pass" and right.required
    assert isinstance(right.measured, float) and right.measured < 1e-4
    coloured = tmp_path / "part-colours-03.3mf"
    coloured.write_bytes(encode(body.scale(1.02), "3mf"))
    assert find_3mf(part) == [tmp_path / "part-03.3mf", coloured]
    wrong = check_same_3mf(mesh, part)
    assert wrong.status == "fail" and wrong.required and coloured.name in wrong.detail and wrong.at
    coloured.write_bytes(b"")
    damaged = check_same_3mf(mesh, part)
    assert damaged.status == "fail" and damaged.required and "is empty" in damaged.detail


def test_nothing_is_looked_for_beside_other_files(tmp_path: Path) -> None:
    part = tmp_path / "part.3mf"
    part.write_bytes(encode(Body(VERTICES, FACES), "3mf"))
    assert check_same_3mf(read_mesh(part), part).status == "skipped"
    assert find_3mf(tmp_path / "other.stl") == []


START = "3D/3dmodel.model"
CUBE = f'<object id="77" type="model">{MESH}</object>'
SLICER = (
    '<config><object id="{}"><volume firstid="{}" lastid="{}">'
    '<metadata type="volume" key="{}" value="{}"/></volume></object></config>'
)
BAMBU = '<config><object id="{}"><part id="1" subtype="{}"/></object></config>'


def forged_3mf() -> Iterator[tuple[str, Change]]:
    """List the changes by name; each must be refused, or fail `same_3mf`."""
    other = model(CUBE, '<item objectid="77"/>').encode()
    for name in (
        "3D/zzz.model",
        "3D\\zzz.model",
        "3D/ZZZ.MODEL",
        "zzz.Model",
        "Metadata/a.b.model",
    ):
        yield f"a second model {name}", _put(name, other)
    for name in (
        *("Metadata/Slic3r_PE_model.config", "Metadata\\Slic3r_PE_model.config"),
        *("metadata/SLIC3R_PE_MODEL.CONFIG", "Metadata/./Slic3r_PE_model.config"),
        "Metadata/SuperSlicer_model.config",
    ):
        yield (
            f"a negative volume by {name}",
            _configure(name, SLICER, "volume_type", "NegativeVolume"),
        )
        yield f"a modifier by {name}", _configure(name, SLICER, "volume_type", "ParameterModifier")
    prusa = "Metadata/Slic3r_PE_model.config"
    yield "an old modifier", _configure(prusa, SLICER, "modifier", "1")
    bambu = "Metadata/model_settings.config"
    yield "a negative part of Bambu Studio", _put(bambu, BAMBU.format(1, "negative_part").encode())
    yield "G-code of Bambu Studio", _put("Metadata/plate_1.gcode", b"G28\n")
    yield "an extra body that one slicer leaves out", _extra_body
    built = rb"<build([^>]*)>"
    more = rb'<build\1><item objectid="77"/>'
    hidden = more.replace(b"/>", b' printable="0"/>')
    yield "an item that is not printable", _edit((built, hidden), cube="model")
    yield "a support object", _edit((built, more), cube="support")
    yield "a second item", _edit((built, more), cube="model")
    yield "the same object twice", _edit((rb"(<item [^>]*/>)", rb"\1\1"))
    for name, matrix in {
        "moved": b"1 0 0 0 1 0 0 0 1 0 0 0.5",
        "scaled": b"1.01 0 0 0 1.01 0 0 0 1.01 0 0 0",
        "mirrored": b"-1 0 0 0 1 0 0 0 1 100 0 0",
    }.items():
        yield f"an item {name}", _edit((rb"<item ", b'<item transform="' + matrix + b'" '))
    for unit in (b"inch", b"centimeter"):
        yield f"in {unit.decode()}", _edit((b"millimeter", unit))
    own = rb' xmlns="urn:own" '
    yield "an item of no namespace", _edit((built, more.replace(b" ", own, 1)), cube="model")
    cube = CUBE.encode().replace(b" ", own, 1)
    yield "an object that only some read", _edit((rb"</resources>", cube + rb"</resources>"))
    end = rb"</vertices>"
    yield (
        "a vertex that only some read",
        _edit((end, b"<vertex" + own + b'x="0" y="0" z="0"/>' + end)),
    )
    end = rb"</triangles>"
    face = b"<triangle" + own + b'v1="0" v2="1" v3="2"/>'
    yield "a triangle that only some read", _edit((end, face + end))
    yield "a prefix before an element", _prefix
    end = rb"</mesh>"
    yield "two meshes in an object", _edit((end, end + MESH.encode()))
    inner = rb'<components><component objectid="77"/></components>'
    yield "a mesh with components", _edit((end, end + inner), cube="model")
    for kind in ("infill_mesh", "cutting_mesh", "anti_overhang_mesh"):
        said = f'<metadatagroup><metadata name="cura:{kind}">True</metadata></metadatagroup><mesh>'
        yield f"Cura's {kind}", _edit((rb"<mesh>", said.encode()))
    yield "another model to start from", _start_elsewhere
    again = RELATIONS[RELATIONS.index("<Relationship ") :].replace("rel0", "rel1").encode()
    twice = RELATIONS.encode().replace(b"</Relationships>", again)
    yield "two models to start from", _put("_rels/.rels", twice)
    yield "a triangle fewer", _edit((rb"<triangle [^>]*/>\s*</triangles>", rb"</triangles>"))
    yield "a vertex moved", _edit((rb'<vertex x="-?\d', rb"\g<0>1"))


def _put(name: str, content: bytes) -> Change:
    return lambda entries: entries.__setitem__(name, content)


def _number(entries: Mapping[str, bytes]) -> int:
    found = re.search(rb'<object id="(\d+)"', entries[START])
    assert found is not None
    return int(found[1])


def _configure(name: str, text: str, key: str, value: str) -> Change:
    def change(entries: Entries) -> None:
        entries[name] = text.format(_number(entries), 0, 5, key, value).encode()

    return change


def _edit(change: tuple[bytes, bytes], *, cube: str = "") -> Change:
    """Replace the first place of a pattern in the model; `cube`: add one of this type, the object 77."""

    def edit(entries: Entries) -> None:
        before = entries[START]
        changed = re.sub(*change, before, count=1)
        assert changed != before
        if cube:
            extra = CUBE.replace('type="model"', f'type="{cube}"').encode()
            changed = re.sub(rb"(<resources[^>]*>)", lambda m: m[1] + extra, changed, count=1)
        entries[START] = changed

    return edit


def _extra_body(entries: Entries) -> None:
    """A cube among the part's own triangles, which a setting of one slicer alone leaves out."""
    mesh = entries[START]
    at = mesh.index(b"</vertices>")
    points, faces = mesh[:at].count(b"<vertex "), mesh.count(b"<triangle ")
    shifted = re.sub(
        r'v(\d)="(\d+)"', lambda m: f'v{m[1]}="{int(m[2]) + points}"', MESH.split("<triangles>")[1]
    )
    cube = MESH.split("</vertices>")[0].removeprefix("<mesh><vertices>").encode()
    mesh = mesh[:at] + cube + mesh[at:]
    end = mesh.index(b"</triangles>")
    entries[START] = mesh[:end] + shifted.removesuffix("</triangles></mesh>").encode() + mesh[end:]
    said = SLICER.format(_number(entries), faces, faces + 11, "volume_type", "ParameterModifier")
    entries["Metadata/SuperSlicer_model.config"] = said.encode()


def _prefix(entries: Entries) -> None:
    """Bind the core's namespace to a prefix too, and write one element with it."""
    text = entries[START]
    core = b"http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    text = text.replace(b"<model ", b'<model xmlns:c="' + core + b'" ', 1)
    entries[START] = text.replace(b"<item ", b"<c:item ", 1)


def _start_elsewhere(entries: Entries) -> None:
    entries["3D/other.model"] = model(CUBE, '<item objectid="77"/>').encode()
    entries["_rels/.rels"] = RELATIONS.replace("3dmodel.model", "other.model").encode()


PE, OBJECTS = "Metadata/Slic3r_PE.config", "Metadata/Slic3r_PE_model.config"
OBJECT = (
    '<config><object id="1"><metadata type="object" key="name" value="x"/>{}<volume firstid="0" lastid="{}">'
    '<metadata type="volume" key="name" value="x"/></volume></object></config>'
)
LAYERS = '<metadata type="object" key="layer_height" value="0.35"/>'
# an entry or an attribute that slicers obey, and what is said of it
STEERED: dict[str, tuple[str, str, str]] = {
    "half of the faces": (OBJECTS, OBJECT.format("", 99), "has Metadata/Slic3r_PE_model.config"),
    "an object's layers": (OBJECTS, OBJECT.format(LAYERS, 999), "sets layer_height to 0.35"),
    "a profile": (PE, "\n; layer_height = 0.35\n; perimeters = 0\n", "layer_height to 0.35, perimeters to 0"),
    "G-code in mid-print": ("Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml", "<c/>", "per_print_z.xml"),
    "ranges of layers": ("Metadata/Prusa_Slicer_layer_config_ranges.xml", "<o/>", "config_ranges.xml"),
    "Bambu's project": ("Metadata/project_settings.config", "{}", "project_settings.config"),
    "Cura's project": ("Cura/preferences.cfg", "[general]\nlayer_height = 0.3", "layer_height to 0.3"),
    "anything else": ("notes.txt", "", "has notes.txt"),
    "a painted triangle": (START, "<triangle |<triangle paint_supports='4' ", "paint_supports of triangle"),
    "a slicer's own key": (
        START,
        "<resources|<metadata name='slic3rpe:Version3mf'>1</metadata><resources",
        "the setting slic3rpe:Version3mf",
    ),
    "a slice stack": (START, "<mesh|<s xmlns='urn:s'/><mesh", "the element s"),
    "an attribute": (START, "<item |<item partnumber='5' ", "the attribute partnumber of item"),
    "an object that is not placed": (START, "<resources>|<resources><object id='9'/>", "has object 9"),
    "another kind of object": (START, "type=\"model\"|type=\"surface\"", "an object of the type surface"),
    "no such material": (START, "<object |<object pid='9' ", "a material that is not there"),
    "a comment": (START, "<resources|<!-- <vertices> --><resources", "has a comment"),
    "an instruction": (START, "<resources|<?slicer raft='1'?><resources", "has an instruction"),
    "raw text": (START, "</resources|<![CDATA[ ]]></resources", "has raw text"),
    "text": (START, "<resources>|<resources>G28", "text between its elements"),
    "a line in a name": (START, "<object |<object name='a&#10;G28' ", "an attribute of object of several"),
    "another type of content": ("[Content_Types].xml", "3dmodel+xml|printticket+xml", "types of content"),
    "another relation": (
        "_rels/.rels", "</Relationships>|<Relationship Type='urn:x' Target='/x' Id='q'/></Relationships>",
        "a relation to /x",
    ),
    "no thumbnail": ("Metadata/thumbnail.png", "; perimeters = 0", "a thumbnail that is no PNG"),
    "Cura's key": (
        START,
        "<mesh>|<metadatagroup><metadata name='cura:infill_pattern'>x</metadata></metadatagroup><mesh>",
        "the setting cura:infill_pattern",
    ),
}  # fmt: skip


def _steer(entries: Entries, where: str, what: str) -> None:
    old, _, new = what.partition("|")
    entries[where] = entries[where].replace(old.encode(), new.encode(), 1) if new else what.encode()


@pytest.mark.parametrize("case", STEERED)
@pytest.mark.parametrize("by_mm", [None, (60.0, 70.0, 0.0)])
def test_no_setting_steers_the_slicer(
    tmp_path: Path, case: str, by_mm: tuple[float, float, float] | None
) -> None:
    where, what, said = STEERED[case]
    part = write(RING, tmp_path).part
    assert part is not None and RING.body is not None
    body = Body(RING.body.vertices + (by_mm or (0.0, 0.0, 0.0)), RING.body.faces)
    forged = rewrite_archive(encode(body, "3mf"), lambda entries: _steer(entries, where, what))
    (tmp_path / "part.3mf").write_bytes(forged)
    found = check_same_3mf(read_mesh(part), part)
    assert (found.status, found.required) == ("fail", True) and said in found.detail
    assert ("moved by (60.00, 70.00, 0.00) mm" in found.detail) == (by_mm is not None)


@pytest.mark.parametrize("prefix", [True, False])
def test_no_other_archive_is_hidden_in_it(tmp_path: Path, prefix: bool) -> None:
    part = write(RING, tmp_path).part
    assert part is not None and RING.body is not None
    own = encode(RING.body, "3mf")
    other = rewrite_archive(own, _put(PE, b"; perimeters = 0"))
    (tmp_path / "part.3mf").write_bytes(other + own if prefix else own[:-2] + b"\1\0;")
    found = check_same_3mf(read_mesh(part), part)
    assert found.status == "fail" and "bytes before or behind its entries" in found.detail


def test_a_part_that_a_slicer_moved_is_told_by_how_much(tmp_path: Path) -> None:
    part = write(RING, tmp_path).part
    assert part is not None and RING.body is not None
    moved = Body(RING.body.vertices + [60.0, 70.0, 0.0], RING.body.faces)
    (tmp_path / "part.3mf").write_bytes(encode(moved, "3mf"))
    found = check_same_3mf(read_mesh(part), part)
    assert found.status == "fail" and "moved by (60.00, 70.00, 0.00) mm" in found.detail
    (tmp_path / "part.3mf").write_bytes(encode(moved.scale(1.02), "3mf"))
    assert "moved" not in check_same_3mf(read_mesh(part), part).detail


RING = make_part(circle(20.0, 24), sides=8)


@pytest.mark.parametrize(("name", "change"), list(forged_3mf()))
def test_a_3mf_that_some_slicers_read_otherwise_is_told(
    name: str, change: Change, tmp_path: Path
) -> None:
    part = write(RING, tmp_path).part
    assert part is not None and RING.body is not None
    beside = tmp_path / "part.3mf"
    beside.write_bytes(encode(RING.body, "3mf"))
    assert check_same_3mf(read_mesh(part), part).status == "pass"
    beside.write_bytes(rewrite_archive(beside.read_bytes(), change))
    found = check_same_3mf(read_mesh(part), part)
    assert (found.status, found.required) == ("fail", True), name


Entries = dict[str, bytes]
Change = Callable[[Entries], object]
