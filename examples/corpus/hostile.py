"""Files from strangers, made to do harm or merely broken: each must end in one clear sentence."""

from __future__ import annotations

import io
import json
import random
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["HANDMADE", "Hostile", "cube_3mf", "fuzzed", "seeds"]

CORNERS = [(x, y, z) for x in (0.0, 20.0) for y in (0.0, 20.0) for z in (0.0, 20.0)]
FACES = [
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
]
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?><Types '
    'xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default '
    'Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?><Relationships '
    'xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship '
    'Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
MESH = "".join(
    [
        "<mesh><vertices>",
        *(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CORNERS),
        "</vertices><triangles>",
        *(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in FACES),
        "</triangles></mesh>",
    ]
)


@dataclass(frozen=True)
class Hostile:
    """A file's name (its ending chooses the reader) and content, and a word of the refusal.

    `says` is None where any verdict or refusal will do, as long as there is one.
    """

    name: str
    content: bytes
    says: str | None


def cube_stl() -> bytes:
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(c for i in face for c in CORNERS[i]), 0) for face in FACES
    )
    return b"cube".ljust(80) + struct.pack("<I", len(FACES)) + body


def cube_text() -> bytes:
    lines = ["solid cube"]
    for face in FACES:
        corners = "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    return "\n".join([*lines, "endsolid cube\n"]).encode()


def cube_obj() -> bytes:
    lines = ["# a cube", *("v {} {} {}".format(*c) for c in CORNERS)]
    lines += ["f {} {} {}".format(*(i + 1 for i in face)) for face in FACES]
    return "\n".join([*lines, ""]).encode()


def _ply_header(form: str, faces: int = len(FACES), vertices: int = len(CORNERS)) -> str:
    return (
        f"ply\nformat {form} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def cube_ply(form: str = "ascii") -> bytes:
    head = _ply_header(form).encode()
    if form == "ascii":
        rows = ["{} {} {}".format(*c) for c in CORNERS] + ["3 {} {} {}".format(*f) for f in FACES]
        return head + "\n".join([*rows, ""]).encode()
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(f"{order}3f", *c) for c in CORNERS)
    return head + body + b"".join(struct.pack(f"{order}B3i", 3, *f) for f in FACES)


def model(resources: str, build: str) -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" xmlns="{CORE}">'
        f"<resources>{resources}</resources><build>{build}</build></model>"
    )


def archive(entries: dict[str, str | bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in entries.items():
            file.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED, 6)
    return packed.getvalue()


def as_3mf(content: str, **more: str | bytes) -> bytes:
    return archive(
        {
            "[Content_Types].xml": TYPES,
            "_rels/.rels": RELATIONS,
            "3D/3dmodel.model": content,
            **more,
        }
    )


def cube_3mf() -> bytes:
    cube = f'<object id="1" type="model">{MESH}</object>'
    return as_3mf(model(cube, '<item objectid="1"/>'))


def square_knots() -> bytes:
    points = [[0, 0, 5], [40, 0, 5], [40, 40, 5], [0, 40, 5]]
    knot = {"closed": True, "type": "unknot", "points": points}
    return json.dumps({"schema": 1, "unit": "mm", "radius_mm": 2.0, "knots": [knot]}).encode()


def plain_scene() -> bytes:
    return (
        b"schema = 1\n[piece]\ntube_radius_mm = 2.0\n"
        b'[region]\nkind = "sphere"\nsize_mm = [90.0, 90.0, 90.0]\n'
        b"[[views]]\nframe_width_mm = 180.0\n[pose]\n"
        b"matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"
    )


def seeds() -> dict[str, bytes]:
    """Good files, small ones, that fuzzing starts from."""
    return {
        "cube.stl": cube_stl(),
        "text.stl": cube_text(),
        "cube.obj": cube_obj(),
        "ascii.ply": cube_ply(),
        "little.ply": cube_ply("binary_little_endian"),
        "big.ply": cube_ply("binary_big_endian"),
        "cube.3mf": cube_3mf(),
        "knots.json": square_knots(),
        "scene.toml": plain_scene(),
    }


def _deep(levels: int) -> bytes:
    """Components of components: twice as many cubes at every level."""
    objects = [f'<object id="1" type="model">{MESH}</object>']
    for i in range(2, levels + 2):
        twice = f'<component objectid="{i - 1}"/>' * 2
        objects.append(f'<object id="{i}" type="model"><components>{twice}</components></object>')
    return as_3mf(model("".join(objects), f'<item objectid="{levels + 1}"/>'))


def _bomb() -> bytes:
    vertices = '<vertex x="0" y="0" z="0"/>' * 4_000_000
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


def _knots(points: str, **keys: str) -> bytes:
    more = "".join(f', "{key}": {value}' for key, value in keys.items())
    return f'{{"schema": 1, "knots": [{{"points": {points}}}]{more}}}'.encode()


def _scene(text: str) -> bytes:
    return b"schema = 1\n" + text.encode()


def _obj(face: str) -> bytes:
    return cube_obj() + face.encode() + b"\n"


def _handmade() -> Iterator[Hostile]:
    stl = cube_stl()
    yield Hostile("empty.stl", b"", "empty")
    yield Hostile("noise.stl", random.Random(1).randbytes(5000), "not an STL")
    yield Hostile("noise.bin", random.Random(2).randbytes(5000), "not an STL, OBJ, PLY or 3MF")
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
        yield Hostile(f"{word}.ply", rest, says)
    yield Hostile("words.stl", cube_text().replace(b"20.0", b"twenty", 1), "three numbers")
    yield Hostile("open.stl", cube_text()[:-20], "cut off")
    yield Hostile("zero.obj", _obj("f 0 1 2"), "line 22")
    yield Hostile("after.obj", _obj("f 1 2 9"), "line 22 names vertex 9")
    yield Hostile("before.obj", _obj("f -9 1 2"), "names vertex -9")
    yield Hostile("huge.obj", _obj("f 1 2 99999999999999999999999"), "cannot be")
    yield Hostile("two.obj", _obj("f 1 2"), "2 corners")
    yield Hostile("word.obj", _obj("f a b c"), "no index")
    yield Hostile("lone.obj", _obj("v 1 2"), "2 numbers")
    yield Hostile("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles")
    fan = "f " + " ".join(str(1 + i % 8) for i in range(100_000))
    yield Hostile("fan.obj", _obj(fan), None)
    huge = _ply_header("ascii", vertices=4_000_000_000).encode() + b"0 0 0\n"
    yield Hostile("huge.ply", huge, "more than the file can hold")
    yield Hostile("minus.ply", _ply_header("ascii", vertices=-3).encode(), "more than")
    lists = _ply_header("binary_little_endian", 1, 1).encode() + bytes(12) + b"\xff" + bytes(8)
    yield Hostile("lists.ply", lists, "cut off")
    yield Hostile("endless.ply", b"ply\n" + b"comment x\n" * 200_000, "no end")
    yield Hostile("order.ply", cube_ply().replace(b"ascii", b"octal"), "broken line")
    yield Hostile("kind.ply", cube_ply().replace(b"float x", b"text x"), "broken line")
    yield Hostile("index.ply", cube_ply().replace(b"3 0 1 3", b"3 0 1 8"), "names vertex 8")
    yield Hostile("below.ply", cube_ply().replace(b"3 0 1 3", b"3 0 1 -1"), "names vertex -1")
    yield Hostile("many.ply", cube_ply().replace(b"3 0 1 3", b"99999999 0 1 3"), "list of")
    yield Hostile("cut.ply", cube_ply("binary_big_endian")[:-3], "cut off")
    yield Hostile("few.ply", cube_ply()[:-9], "cut off")
    yield Hostile("no-x.ply", cube_ply().replace(b"float x", b"float q"), "no plain x")
    yield Hostile("bomb.3mf", _bomb(), "unpacks to")
    yield Hostile("zeros.3mf", as_3mf(model("", ""), **{"3D/z": b"0" * 300_000_000}), "unpacks to")
    yield Hostile("laughs.3mf", _deep(30), "triangles")
    yield Hostile("deep.3mf", _deep(3), None)
    yield Hostile("lying.3mf", _lying_sizes(), "damaged")
    entity = '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + model("", "")
    yield Hostile("entity.3mf", as_3mf(entity), "document type")
    outside = {"../../evil.model": "x", "/etc/evil": "x", "C:\\evil": "x"}
    yield Hostile("outside.3mf", as_3mf(model("", ""), **outside), None)
    yield Hostile("names.3mf", archive({f"{i}": b"" for i in range(10_500)}), "entries")
    yield Hostile("nan.3mf", _with("nan 0 0 0 1 0 0 0 1 0 0 0"), None)
    yield Hostile("far.3mf", _with("1e30 0 0 0 1 0 0 0 1 0 0 0"), None)
    yield Hostile("flat.3mf", _with("0 0 0 0 0 0 0 0 0 0 0 0"), None)
    loop = '<object id="1" type="model"><components><component objectid="1"/></components></object>'
    yield Hostile("loop.3mf", as_3mf(model(loop, '<item objectid="1"/>')), "3MF")
    wrong = MESH.replace('v1="0"', 'v1="4000000000"')
    cube = f'<object id="1" type="model">{wrong}</object>'
    yield Hostile("index.3mf", as_3mf(model(cube, '<item objectid="1"/>')), "3MF")
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
    yield Hostile("far.json", _knots("[[1e9,0,0],[1,0,0],[1,1,0]]"), "beyond")
    yield Hostile("text.json", _knots('[["1","2","3"],["1","0","0"],["1","1","0"]]'), "numbers")
    yield Hostile("truth.json", _knots("[[true,false,true],[true,true,true]]"), "numbers")
    yield Hostile("flat.json", _knots("[1,2,3]"), "points")
    yield Hostile("ragged.json", _knots("[[1,2,3],[1,2],[3,4,5]]"), "points")
    yield Hostile("twice.json", _knots("[[0,0,0],[0,0,0],[1,1,0]]"), "coincide")
    yield Hostile("radius.json", _knots(square, radius_mm="-1"), "radius_mm")
    yield Hostile("girth.json", _knots(square, radius_mm="9" * 400), "radius_mm")
    yield Hostile("utf.json", b'{"schema": 1, "\xff": 2}', "UTF-8")
    yield Hostile("schema.json", b'{"schema": 7}', "schema")
    yield Hostile("list.json", b"[]", "object")
    yield Hostile("none.json", b'{"schema": 1, "knots": []}', "at least one")
    yield Hostile("pole.json", _knots("[[0,0,0],[0,0,0]]", closed="5"), "points")
    yield Hostile("text.toml", b"schema = 1\n[piece", "TOML")
    yield Hostile("digits.toml", _scene(f"[piece]\ntube_radius_mm = {'9' * 5000}"), "TOML")
    yield Hostile("big.toml", _scene(f"[piece]\ntube_radius_mm = {'9' * 400}"), "tube_radius_mm")
    yield Hostile("nan.toml", _scene("[piece]\ntube_radius_mm = nan"), "tube_radius_mm")
    yield Hostile("deep.toml", b"a = " + b"[" * 100_000, "TOML")
    yield Hostile("pose.toml", _scene("[pose]\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]"), "matrix")
    yield Hostile("mirror.toml", _scene(
        "[pose]\nmatrix = [[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "rigid")  # fmt: skip
    yield Hostile("views.toml", b"schema = 1\nviews = []", "views")
    yield Hostile("views2.toml", b"schema = 1\nviews = [1, 2]", "view")
    yield Hostile("utf.toml", b"schema = 1 # \xff", "UTF-8")


HANDMADE = _handmade
"""() -> the files made by hand, one after the other."""

TOKENS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"-0", b"0", b"-1", b"1e400"),
    *(b"4294967296", b"18446744073709551616", b"9" * 300, b"", b"x", b"1e7", b"0x10", b"[[", b"]]"),
)


def fuzzed(seed: int) -> Hostile:
    """One of the good files, changed at random; the same for the same seed."""
    rng = random.Random(seed)
    name, good = rng.choice(sorted(seeds().items()))
    content = bytearray(good)
    if name.endswith("3mf") and rng.random() < 0.7:  # inside the archive, not the archive
        with zipfile.ZipFile(io.BytesIO(good)) as file:
            entries: dict[str, str | bytes] = {n: file.read(n) for n in file.namelist()}
        inner = rng.choice(["3D/3dmodel.model", "3D/3dmodel.model", *entries])
        before = entries[inner]
        assert isinstance(before, bytes)
        changed = bytearray(before)
        for _ in range(rng.randint(1, 4)):
            _change(changed, rng)
        return Hostile(name, archive({**entries, inner: bytes(changed)}), None)
    for _ in range(rng.randint(1, 4)):
        _change(content, rng)
    return Hostile(name, bytes(content), None)


def _change(content: bytearray, rng: random.Random) -> None:
    """Flip, cut, insert, swap, double, or put another number for one."""
    if not content:
        return
    at = rng.randrange(len(content))
    kind = rng.randrange(8)
    if kind == 0:
        content[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        content[at] = rng.randrange(256)
    elif kind == 2:
        del content[at:]
    elif kind == 3:
        content[at:at] = rng.randbytes(rng.choice((1, 4, 50)))
    elif kind == 4:
        del content[at : at + rng.choice((1, 4, 50))]
    elif kind == 5:
        other, size = rng.randrange(len(content)), rng.choice((1, 4, 50))
        content[at : at + size] = content[other : other + size]
    elif kind == 6 and len(content) >= 4:
        at = min(at, len(content) - 4)
        content[at : at + 4] = struct.pack("<I", rng.choice((0, 1, 2**31, 2**32 - 1, 0x7FC00000)))
    else:
        words = bytes(content).split()
        if words:
            word = rng.choice(words)
            changed = bytes(content).replace(word, rng.choice(TOKENS), rng.choice((1, 1, -1)))
            content[:] = changed[: 4 * len(content) + 4000]
