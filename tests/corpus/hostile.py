"""Files from strangers, made to do harm or merely broken: each must end in one clear sentence."""

import io
import random
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from .files import (
    MESH,
    RELATIONS,
    archive,
    as_3mf,
    cube_3mf,
    cube_arrays,
    cube_obj,
    cube_ply,
    cube_stl,
    cube_text,
    model,
    ply_header,
)


@dataclass(frozen=True)
class Hostile:
    """A file's name (its ending chooses the reader) and content, and a word of the refusal.

    `says` is None where any verdict or refusal will do, as long as there is one. `among`: it is one of
    a part, its knots and its scene, and is to be given with the two others, which are good. `reader`: that
    of `strangers.READERS` which reads it; "" stands for the validators.
    """

    name: str
    content: bytes
    says: str | None
    among: bool = False
    reader: str = ""


def _deep(levels: int) -> bytes:
    """Components of components: twice as many cubes at every level."""
    return _multiply('<component objectid="{}"/>', levels=levels)


def _bomb() -> bytes:
    vertices = '<vertex x="0" y="0" z="0"/>' * 2_000_000
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles/></mesh>"
    return as_3mf(model(f'<object id="1" type="model">{mesh}</object>', '<item objectid="1"/>'))


def _lying_sizes() -> bytes:
    """An archive whose directory says that the model is 10 bytes long."""
    content = bytearray(cube_3mf())
    at = content.find(b"PK\x01\x02")
    while at >= 0:
        content[at + 24 : at + 28] = struct.pack("<I", 10)
        at = content.find(b"PK\x01\x02", at + 4)
    return bytes(content)


def _with(transform: str) -> bytes:
    cube = f'<object id="1" type="model">{MESH}</object>'
    return as_3mf(model(cube, f'<item objectid="1" transform="{transform}"/>'))


def _multiply(component: str, mesh: str = MESH, levels: int = 40) -> bytes:
    """Write components as `_deep` does, but so that a search for them may overlook them."""
    objects = [f'<object id="1" type="model">{mesh}</object>']
    for i in range(2, levels + 2):
        twice = component.format(i - 1) * 2
        objects.append(f'<object id="{i}" type="model"><components>{twice}</components></object>')
    return as_3mf(model("".join(objects), f'<item objectid="{levels + 1}"/>'))


def _elsewhere() -> bytes:
    """Components of components, in a model whose name does not end as it should."""
    with zipfile.ZipFile(io.BytesIO(_deep(40))) as file:
        content = file.read("3D/3dmodel.model")
    relations = RELATIONS.replace("3dmodel.model", "3dmodel.xml")
    return archive({"_rels/.rels": relations, "3D/3dmodel.xml": content})


def _pack(entries: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as file:
        for name, content in entries:
            info = zipfile.ZipInfo()
            info.filename, info.compress_type = name, method
            file.writestr(info, content)
    return packed.getvalue()


def _of_cubes(build: str, before: str = "", head: str = "") -> bytes:
    cube = f'{before}<object id="1" type="model">{MESH}</object>'
    return as_3mf(model(cube, build).replace("<model ", f"<model {head} "))


def _knots(points: str, **keys: str) -> bytes:
    more = "".join(f', "{key}": {value}' for key, value in keys.items())
    return f'{{"schema": 1, "knots": [{{"points": {points}}}]{more}}}'.encode()


def _scene(text: str) -> bytes:
    return b"schema = 1\n" + text.encode()


def _obj(face: str) -> bytes:
    return cube_obj() + face.encode() + b"\n"


_IMPOSSIBLE = (  # a word of the refusal, and the scene
    ("piece is 3, but must be a table", "piece = 3"),
    ("tube_radius_mm", "[piece]\ntube_radius_mm = '2 mm'"),
    ("clearance_mm", "[piece]\nclearance_mm = nan"),
    ('kind is "cone", but must be "box"', "[region]\nkind = 'cone'"),
    ("a list of as many numbers", "[region]\nsize_mm = [1, 2]"),
    ("a list of as many numbers", "[printer]\nbuild_volume_mm = 'auto'"),
    ("a list of as many numbers", "[pose]\nmatrix = 'none'"),
    ("rigid", "[pose]\nmatrix = [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"),
    ("rigid", "[pose]\nmatrix = [[1,1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"),
)


@cache
def handmade() -> tuple[Hostile, ...]:
    """The files made by hand."""
    return tuple(_make_by_hand())


def _make_by_hand() -> Iterator[Hostile]:
    stl = cube_stl()
    yield Hostile("empty.stl", b"", "empty")
    yield Hostile("noise.stl", random.Random(1).randbytes(5000), "not an STL")
    yield Hostile("noise.bin", random.Random(2).randbytes(5000), "not an STL or 3MF")
    yield Hostile("cut.stl", stl[:-7], "cut off")
    yield Hostile("header.stl", stl[:84], "cut off")
    yield Hostile("short.stl", stl[:50], "cut off")
    yield Hostile("none.stl", stl[:80] + struct.pack("<I", 0), "no triangles")
    yield Hostile("huge.stl", stl[:80] + struct.pack("<I", 2**32 - 1) + stl[84:], "promises")
    yield Hostile("minus.stl", stl[:80] + struct.pack("<i", -1) + stl[84:], "cut off")
    for word, value in (("nan", float("nan")), ("inf", float("inf")), ("far", 3e38)):
        content = bytearray(stl)
        content[96:100] = struct.pack("<f", value)
        says = "as large as" if word == "far" else "not finite"
        yield Hostile(f"{word}.stl", bytes(content), says)
        name = {"far": "1e300"}.get(word, word)
        replaced = cube_text().replace(b"vertex 20.0", f"vertex {name}".encode(), 1)
        yield Hostile(f"{word}-text.stl", replaced, says)
        yield Hostile(f"{word}.obj", cube_obj().replace(b"v 20.0", f"v {name}".encode(), 1), says)
        rest = cube_ply().replace(b"\n20.0", f"\n{name}".encode(), 1)
        yield Hostile(f"{word}.ply", rest, "not finite")
    yield Hostile("none-text.stl", b"solid x\nendsolid x\n", "no triangles")
    yield Hostile("page.stl", b"<!DOCTYPE html><html><body>404</body></html>" * 9, "not an STL")
    yield Hostile("picture.stl", b"\x89PNG\r\n\x1a\n" + bytes(200), "not an STL")
    yield Hostile("words.stl", cube_text().replace(b"20.0", b"twenty", 1), "not three numbers")
    between = cube_text().replace(b"endfacet", b"endfacet\nnonsense", 1)
    yield Hostile("between.stl", between, "after line")
    yield Hostile("python.stl", cube_text().replace(b"20.0", b"2_0.0", 1), "not three numbers")
    yield Hostile("open.stl", cube_text()[:-20], "cut off")
    yield Hostile("zero.obj", _obj("f 0 1 2"), "index value")
    yield Hostile("after.obj", _obj("f 1 2 9"), "index 8")
    yield Hostile("before.obj", _obj("f -9 1 2"), "index value")
    yield Hostile("huge.obj", _obj("f 1 2 99999999999999999999999"), "damaged")
    yield Hostile("two.obj", _obj("f 1 2"), None)
    yield Hostile("word.obj", _obj("f a b c"), "damaged")
    yield Hostile("lone.obj", _obj("v 1 2"), "not finite")
    yield Hostile("other.obj", _obj("call other.obj"), "curved surfaces (call)")
    yield Hostile("curve.obj", _obj("curv 0 1 1 2 3"), "curved surface")
    yield Hostile("prose.obj", _obj("and so on"), None)
    yield Hostile("python.obj", _obj("f 1 2 0_3"), "damaged")
    yield Hostile("python-v.obj", cube_obj().replace(b"v 20.0", b"v 2_0.0", 1), "damaged")
    yield Hostile("slashes.obj", _obj("f 1/1/1/1 2 3"), None)
    yield Hostile("wide.obj", _obj("f" + " 1" * 20_000), None)
    yield Hostile("next.obj", _obj("f 1 \\\n 2 3\nf 1 2 99"), "index 98")
    yield Hostile("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles")
    fan = "f " + " ".join(str(1 + i % 8) for i in range(100_000))
    yield Hostile("fan.obj", _obj(fan), None)
    huge = ply_header("ascii", vertices=4_000_000_000).encode() + b"0 0 0\n"
    yield Hostile("huge.ply", huge, "header promises")
    yield Hostile(
        "none.ply", cube_ply().split(b"3 0 1")[0].replace(b"face 12", b"face 0"), "no tri"
    )
    yield Hostile("minus.ply", ply_header("ascii", vertices=-3).encode(), "header promises")
    lists = ply_header("binary_little_endian", 1, 1).encode() + bytes(12) + b"\xff" + bytes(8)
    yield Hostile("lists.ply", lists, "cut off")
    yield Hostile("endless.ply", b"ply\n" + b"comment x\n" * 200_000, "no end")
    yield Hostile("order.ply", cube_ply().replace(b"ascii", b"octal"), "cut off")
    yield Hostile("kind.ply", cube_ply().replace(b"float x", b"text x"), "text")
    yield Hostile("index.ply", cube_ply().replace(b"3 0 1 3", b"3 0 1 8"), "names vertex 8")
    yield Hostile("below.ply", cube_ply().replace(b"3 0 1 3", b"3 0 1 -1"), "names vertex -1")
    yield Hostile("many.ply", cube_ply().replace(b"3 0 1 3", b"99999999 0 1 3"), None)
    yield Hostile("cut.ply", cube_ply("binary_big_endian")[:-3], "cut off")
    yield Hostile("more.ply", cube_ply() + b"3 0 1 2\n", "goes on after")
    yield Hostile("more-binary.ply", cube_ply("binary_big_endian") + b"xx", "longer than")
    yield Hostile("python.ply", cube_ply().replace(b"20.0", b"2_0.0", 1), "damaged")
    strips = b"element tristrips 0\nproperty list int int vertex_indices\nend_header"
    yield Hostile("strips.ply", cube_ply().replace(b"end_header", strips, 1), "strips")
    yield Hostile("few.ply", cube_ply()[:-9], "cut off")
    yield Hostile("no-x.ply", cube_ply().replace(b"float x", b"float q"), "damaged")
    plain = cube_arrays()
    yield Hostile("cut.npy", plain[:-8], "no arrays")
    yield Hostile("huge.npy", plain.replace(b"(12, 3, 3)", b"(9999999999, 3, 3)"), "no arrays")
    yield Hostile("pickle.npy", plain.replace(b"'<f8'", b"'|O' "), "no arrays")
    yield Hostile("flat.npy", plain.replace(b"(12, 3, 3)", b"(36, 3)   "), "no corners")
    yield Hostile("bomb.3mf", _bomb(), "unpacks to")
    yield Hostile("zeros.3mf", as_3mf(model("", ""), **{"3D/z": b"0" * 60_000_000}), "unpacks to")
    yield Hostile("laughs.3mf", _deep(30), "triangles")
    yield Hostile("deep.3mf", _deep(3), None)
    yield Hostile("lying.3mf", _lying_sizes(), "damaged")
    entity = '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + model("", "")
    yield Hostile("entity.3mf", as_3mf(entity), "document type")
    outside = {"../../evil.model": "x", "/etc/evil": "x", "C:\\evil": "x"}
    yield Hostile("outside.3mf", as_3mf(model("", ""), **outside), "leads elsewhere")
    yield Hostile("names.3mf", archive({f"{i}": b"" for i in range(10_500)}), "entries")
    yield Hostile("nan.3mf", _with("nan 0 0 0 1 0 0 0 1 0 0 0"), "transform")
    lost = MESH.replace('x="20.0"', 'x="nan"', 1)
    lost = model(f'<object id="1" type="model">{lost}</object>', '<item objectid="1"/>')
    yield Hostile("nan-vertex.3mf", as_3mf(lost), "3mf")
    yield Hostile("broken.3mf", as_3mf("<model"), "3mf")
    yield Hostile("short.3mf", _with("1 0 0 0 1"), "transform")
    yield Hostile("far.3mf", _with("1e30 0 0 0 1 0 0 0 1 0 0 0"), "as large as")
    yield Hostile("beyond.3mf", _with("1e999 0 0 0 1 0 0 0 1 0 0 0"), "not finite")
    yield Hostile("flat.3mf", _with("0 0 0 0 0 0 0 0 0 0 0 0"), None)
    loop = '<object id="1" type="model"><components><component objectid="1"/></components></object>'
    yield Hostile("loop.3mf", as_3mf(model(loop, '<item objectid="1"/>')), "in each other")
    empty = "<mesh><vertices/><triangles/></mesh>"
    few, many = "triangles", "places more than"
    yield Hostile("spaced.3mf", _multiply('<component\nobjectid = "{}"/>'), few)
    yield Hostile("quoted.3mf", _multiply("<component a='>' objectid='{}'/>"), few)
    long = f'<component a="{"0" * 3000}" objectid="{{}}"/>'
    yield Hostile("long.3mf", _multiply(long), few)
    yield Hostile("hollow.3mf", _multiply('<component objectid="{}"/>', empty), many)
    yield Hostile("elsewhere.3mf", _elsewhere(), few)
    yield Hostile("items.3mf", _of_cubes('<item objectid="1"/>' * 60_000), many)
    objects = "".join(f'<object id="{i}"/>' for i in range(2, 60_000))
    yield Hostile("objects.3mf", _of_cubes("", objects), "more than 50000 objects")
    tall = model("<a>" * 500_000, "")
    yield Hostile("tall.3mf", as_3mf(tall), "nested")
    names = "".join(f"<a{i}/>" for i in range(200_000))
    yield Hostile("words.3mf", _of_cubes("", names), "too many names")
    yield Hostile("tag.3mf", _of_cubes("", f'<a b="{"x" * 3_000_000}"/>'), "tag of more than")
    twice = f'<object id="1" type="model">{MESH}</object>'
    yield Hostile("twice.3mf", _of_cubes("", twice), "two objects")
    yield Hostile("absent.3mf", _of_cubes('<item objectid="5"/>'), "object 5")
    beam = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
    needs = _of_cubes('<item objectid="1"/>', head=f'xmlns:b="{beam}" requiredextensions="b"')
    yield Hostile("beams.3mf", needs, "beamlattice")
    yield Hostile("cubits.3mf", as_3mf(model("", "").replace("millimeter", "cubit")), "cubit")
    yield Hostile("below.3mf", as_3mf(model(
        f'<object id="1">{MESH.replace(chr(34) + "7" + chr(34), chr(34) + "-7" + chr(34))}</object>',
        '<item objectid="1"/>')), "vertex -7")  # fmt: skip
    body = zipfile.ZipFile(io.BytesIO(cube_3mf()))
    same = [(n, body.read(n)) for n in body.namelist()]
    again = [*same, ("3D/3DMODEL.model", b"<model/>")]
    yield Hostile("again.3mf", _pack(again), "two entries")
    yield Hostile("lzma.3mf", _pack(same, zipfile.ZIP_LZMA), "packed in a way")
    wrong = MESH.replace('v1="0"', 'v1="4000000000"')
    cube = f'<object id="1" type="model">{wrong}</object>'
    yield Hostile("index.3mf", as_3mf(model(cube, '<item objectid="1"/>')), "vertex 4000000000")
    yield Hostile("bare.3mf", archive({"a.txt": b"hello"}), "3MF")
    yield Hostile("cut.3mf", cube_3mf()[:-40], "3MF")
    yield Hostile("plain.3mf", b"not an archive", "3MF")
    square = "[[0,0,0],[9,0,0],[9,9,0]]"
    yield Hostile("deep.json", b"[" * 200_000, "JSON")
    yield Hostile("digits.json", _knots(f"[[{'9' * 6000},0,0],[1,0,0],[1,1,0]]"), "JSON")
    yield Hostile("big.json", _knots("[[1e400,0,0],[1,0,0],[1,1,0]]"), "not finite")
    yield Hostile("long.json", _knots(f"[[{10**400},0,0],[1,0,0],[1,1,0]]"), "points")
    yield Hostile("nan.json", _knots("[[NaN,0,0],[1,0,0],[1,1,0]]"), "not finite")
    yield Hostile("inf.json", _knots("[[Infinity,0,0],[1,0,0],[1,1,0]]"), "not finite")
    yield Hostile("far.json", _knots("[[1e7,0,0],[1,0,0],[1,1,0]]"), "beyond")
    yield Hostile("text.json", _knots('[["1","2","3"],["1","0","0"],["1","1","0"]]'), "numbers")
    yield Hostile("truth.json", _knots("[[true,false,true],[true,true,true]]"), "numbers")
    yield Hostile("truths.json", _knots("[[true,0,0],[9,0,0],[9,9,0]]"), "numbers")
    repeated = _knots(square, radius_mm="1").replace(b'"schema"', b'"radius_mm": 2, "schema"')
    yield Hostile("again.json", repeated, "radius_mm twice")
    many_knots = ", ".join([f'{{"points": {square}}}'] * 1001)
    yield Hostile("many.json", f'{{"schema": 1, "knots": [{many_knots}]}}'.encode(), "1001 knots")
    yield Hostile("flat.json", _knots("[1,2,3]"), "points")
    yield Hostile("ragged.json", _knots("[[1,2,3],[1,2],[3,4,5]]"), "points")
    yield Hostile("twice.json", _knots("[[0,0,0],[0,0,0],[1,1,0]]"), "coincide")
    yield Hostile(
        "closed.json", _knots("[[0,0,0],[9,0,0],[9,9,0],[0,0,0]]"), "points 3 and 0 coincide"
    )
    yield Hostile("plane.json", _knots("[[0,0],[1,0],[0,1]]"), "point 0 is not")
    yield Hostile("few.json", _knots("[[0,0,0],[1,0,0]]"), "at least 3")
    yield Hostile("word.json", _knots('"abc"'), None)
    yield Hostile("number.json", b'{"schema": 1, "knots": [7]}', "knot 0 has no points")
    yield Hostile("inch.json", _knots(square, unit='"inch"'), "unit")
    yield Hostile("empty.json", b"", "JSON")
    yield Hostile("zero.json", _knots(square, radius_mm="0"), "radius_mm")
    yield Hostile("nan-radius.json", _knots(square, radius_mm="NaN"), "radius_mm")
    yield Hostile("word-radius.json", _knots(square, radius_mm='"2"'), "radius_mm")
    for key, value in (("closed", b"0"), ("type", b"3")):
        keyed = _knots(square).replace(b'"points"', b'"%s": %s, "points"' % (key.encode(), value))
        yield Hostile(f"{key}-key.json", keyed, key)
    yield Hostile("radius.json", _knots(square, radius_mm="-1"), "radius_mm")
    yield Hostile("girth.json", _knots(square, radius_mm="9" * 400), "radius_mm")
    yield Hostile("utf.json", b'{"schema": 1, "\xff": 2}', "UTF-8")
    yield Hostile("schema.json", b'{"schema": 7}', "schema")
    yield Hostile("list.json", b"[]", "object")
    yield Hostile("none.json", b'{"schema": 1, "knots": []}', "at least one")
    yield Hostile("pole.json", _knots("[[0,0,0],[0,0,0]]", closed="5"), "points")
    yield Hostile("text.toml", b"schema = 1\n[piece", "TOML")
    yield Hostile("digits.toml", _scene(f"[piece]\ntube_radius_mm = {'9' * 5000}"), "too long")
    yield Hostile("big.toml", _scene(f"[piece]\ntube_radius_mm = {'9' * 400}"), "tube_radius_mm")
    yield Hostile("nan.toml", _scene("[piece]\ntube_radius_mm = nan"), "tube_radius_mm")
    yield Hostile("deep.toml", b"a = " + b"[" * 100_000, "nested too deep")
    yield Hostile("pose.toml", _scene("[pose]\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]"), "matrix")
    yield Hostile("mirror.toml", _scene(
        "[pose]\nmatrix = [[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "rigid")  # fmt: skip
    yield Hostile("hex.toml", f"schema = 0x{'f' * 10_000}".encode(), "schema")
    yield Hostile("hex2.toml", _scene(f"[piece]\nclearance_mm = 0x{'f' * 10_000}"), "clearance_mm")
    row = f"[0x{'f' * 10_000}, 0, 0, 0]"
    yield Hostile("hex3.toml", _scene(f"[pose]\nmatrix = [{row}, {row}, {row}, {row}]"), "matrix")
    yield Hostile("dots.toml", b"a" + b".a" * 400_000 + b" = 1", "key of more than")
    yield Hostile("dots2.toml", b'"a,"' + b'."a,"' * 150_000 + b" = 1", "key of more than")
    tiny = "[[views]]\nframe_width_mm = 1e-300"
    yield Hostile("tiny.toml", _scene(tiny), "frame_width_mm")
    for n, (says, text) in enumerate(_IMPOSSIBLE):
        yield Hostile(f"impossible-{n}.toml", _scene(text), says)
    yield Hostile("schema.toml", b"schema = 2", "schema")
    yield Hostile("views.toml", b"schema = 1\nviews = []", "views")
    yield Hostile("views2.toml", b"schema = 1\nviews = [1, 2]", "view")
    yield Hostile("utf.toml", b"schema = 1 # \xff", "UTF-8")
