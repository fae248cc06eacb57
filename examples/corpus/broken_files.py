"""Files that no reader may take: not finite, cut off, empty, lying about themselves, or of another kind."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .case import READ, Broken, knotted, with_scene
from .curves import circle
from .files import Part, encoded
from .parts import Body, box

NAN, INF = float("nan"), float("inf")


def broken_files() -> Iterator[Broken]:
    """Faults that the readers must name in a sentence."""
    yield from _not_finite()
    yield from _meshes()
    yield from _knots()
    yield from _scenes()


def _refused(name: str, file: str, content: bytes, says: str) -> Broken:
    """A mesh file that must be refused, with a word that its sentence must have."""
    return Broken(name, lambda: Part(None, raw={file: content}), READ, says=says)


def _not_finite() -> Iterator[Broken]:
    forms = {
        "stl": "STL",
        "stl-text": "text STL",
        "obj": "OBJ",
        "ply": "PLY",
        "ply-binary": "binary PLY",
    }
    for form, name in forms.items():
        for value in (NAN, INF, -INF):
            yield _refused(
                f"{value} in a {name} file",
                f"part.{form.partition('-')[0]}",
                encoded(_poisoned(value), form),
                "part.",
            )
    yield _refused("nan in a 3MF file", "part.3mf", encoded(_poisoned(NAN), "3mf"), "3mf")


def _meshes() -> Iterator[Broken]:
    stl = encoded(_body(), "stl")
    text, obj, ply = (encoded(_body(), f) for f in ("stl-text", "obj", "ply"))
    binary, zipped = encoded(_body(), "ply-binary"), encoded(_body(), "3mf")
    faces = len(_body().faces)
    contents: dict[str, tuple[str, bytes, str]] = {
        "an empty file": ("part.stl", b"", "empty"),
        "an STL file without a face": ("part.stl", bytes(84), "no triangles"),
        "a text STL file without a face": ("part.stl", b"solid x\nendsolid x\n", "no triangles"),
        "an OBJ file without a face": ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", ""),
        "a PLY file without a face": (
            "part.ply",
            encoded(Body(_body().vertices, _body().faces[:0]), "ply"),
            "",
        ),
        "an STL file cut off": ("part.stl", stl[: len(stl) // 2], "cut off"),
        "an STL file cut off by a byte": ("part.stl", stl[:-1], "cut off"),
        "an STL file that promises 4 billion faces": (
            "part.stl",
            stl[:80] + b"\xff\xff\xff\xff" + stl[84:],
            "",
        ),
        "an STL file that promises one face more": (
            "part.stl",
            stl[:80] + struct.pack("<I", faces + 1) + stl[84:],
            "",
        ),
        "an STL file of the header alone": ("part.stl", stl[:84], ""),
        "a text STL file cut off": ("part.stl", text[: len(text) // 2], "cut off"),
        "a text STL file with words for numbers": (
            "part.stl",
            text.replace(b"vertex 2 ", b"vertex two ", 1),
            "",
        ),
        "an OBJ file with an index too large": ("part.obj", obj + b"f 1 2 999999\n", ""),
        "an OBJ file with the index 0": ("part.obj", obj + b"f 0 1 2\n", ""),
        "an OBJ file with an index too far back": ("part.obj", obj + b"f -1 -2 -999999\n", ""),
        "an OBJ file with words for numbers": ("part.obj", b"v a b c\n" + obj, ""),
        "a PLY file cut off": ("part.ply", ply[: len(ply) // 2], ""),
        "a binary PLY file cut off": ("part.ply", binary[:-7], ""),
        "a PLY file with an index too large": (
            "part.ply",
            ply.rsplit(b"\n", 2)[0] + b"\n3 0 1 999\n",
            "",
        ),
        "a PLY file of which the head is cut off": ("part.ply", ply[:60], ""),
        "a 3MF file cut off": ("part.3mf", zipped[: len(zipped) // 2], ""),
        "a 3MF file without a model": ("part.3mf", _zip({"readme.txt": b"nothing"}), ""),
        "a 3MF file with a broken model": ("part.3mf", _zip({"3D/3dmodel.model": b"<model"}), ""),
        "a web page": ("part.stl", b"<!DOCTYPE html><html><body>404</body></html>" * 9, ""),
        "a picture": ("part.stl", b"\x89PNG\r\n\x1a\n" + bytes(200), ""),
        "random bytes": ("part.stl", np.random.default_rng(0).bytes(5000), ""),
    }
    for name, (file, content, says) in contents.items():
        yield _refused(name, file, content, says)


def _knots() -> Iterator[Broken]:
    points = circle(30.0, 24).tolist()
    knot = {"closed": True, "type": "unknot", "points": points}
    good = {"schema": 1, "unit": "mm", "radius_mm": 3.0, "knots": [knot]}

    def but(**changes: object) -> bytes:
        return json.dumps({**good, **changes}).encode()

    def of(**changes: object) -> bytes:
        return but(knots=[{**knot, **changes}])

    contents = {
        "that is not finite": of(points=[[NAN, 0, 0], *points]),
        "with an infinite point": of(points=[*points, [0, INF, 0]]),
        "with a point twice": of(points=[*points[:5], points[4], *points[5:]]),
        "whose last point is the first": of(points=[*points, points[0]]),
        "of two points": of(points=points[:2]),
        "in the plane": of(points=[p[:2] for p in points]),
        "of words": of(points=[["a", "b", "c"]] * 5),
        "without a knot": but(knots=[]),
        "of another schema": but(schema=2),
        "in inches": but(unit="inch"),
        "with a radius below 0": but(radius_mm=-3.0),
        "with a radius of 0": but(radius_mm=0.0),
        "with a radius that is not finite": but(radius_mm=NAN),
        "that is no JSON": b"{",
        "that is a list": b"[]",
        "that is empty": b"",
    }
    for name, content in contents.items():
        yield Broken(
            f"a knots.json {name}",
            partial(_with, "knots.json", content),
            READ,
            says="knots.json",
        )


def _scenes() -> Iterator[Broken]:
    contents = {
        "that is no TOML": b"[piece\n",
        "of another schema": b"schema = 2\n",
        "with a negative clearance": b"[piece]\nclearance_mm = -1.0\n",
        "with a clearance that is not finite": b"[piece]\nclearance_mm = nan\n",
        "with an unknown region": b'[region]\nkind = "pyramid"\n',
        "with a region of no size": b"[region]\nsize_mm = [0.0, 1.0, 1.0]\n",
        "with a pose that shears": b"[pose]\nmatrix=[[1,1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n",
        "with a pose that mirrors": b"[pose]\nmatrix=[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n",
        "without a picture": b'[[views]]\npicture = "missing.png"\n',
    }
    for name, content in contents.items():
        yield Broken(
            f"a scene.toml {name}",
            partial(_with, "scene.toml", content),
            READ,
        )
    yield Broken(
        "a picture that is none",
        lambda: replace(with_scene(_part()), raw={"front.png": b"GIF89a and nothing more"}),
        READ,
        says="front.png",
    )
    yield Broken(
        "a part behind the light",
        lambda: with_scene(_part(), view={"light_distance_mm": 1.0}),
        READ,
        says="light",
    )


def _body() -> Body:
    return box((2, 2, 0), (27, 22, 12))


def _part() -> Part:
    return knotted(circle())


def _with(name: str, content: bytes) -> Part:
    """A good part beside a file of this content."""
    return replace(_part(), raw={name: content})


def _poisoned(value: float) -> Body:
    body = _body()
    vertices = body.vertices.copy()
    vertices[3, 1] = value
    return Body(vertices, body.faces)


def _zip(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()
