"""A part's files as the validators read them, and small good files of every kind: a cube, a square knot."""

import io
import json
import struct
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from PIL import Image, ImageDraw

from knotfab.picture.raster import encode_mask
from knotfab_validators.arrays import Mask

from .curves import Array
from .parts import Body

DEFAULT_VIEW = {
    "name": "front", "kind": "shadow", "picture": "front.png", "frame_width_mm": 120.0,
    "frame_height_mm": 120.0, "light_distance_mm": 500.0, "light_diameter_mm": 2.0,
    "wall_distance_mm": 60.0, "wall_tilt_deg": 0.0, "azimuth_deg": 0.0,
}  # fmt: skip
UP = np.array([0.0, 1.0, 0.0])
OVERSAMPLED = 4  # a pixel's side in samples when a shadow is drawn


@dataclass(frozen=True)
class Part:
    """What a case's folder is made from; lengths in mm, all in part coordinates.

    `scene` holds the tables of scene.toml, `pictures` the masks (H, W) it names; `raw` are files
    that are written as they are, in place of those made from the rest.
    """

    body: Body | None
    knots: tuple[Array, ...] = ()
    types: tuple[str, ...] = ()
    radius: float | None = None
    closed: bool = True
    scene: Mapping[str, Any] | None = None
    pictures: Mapping[str, Mask] = field(default_factory=dict)
    format: str = "stl"
    raw: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Files:
    """The files of a case; None stands for those that it does not have."""

    part: Path | None
    knots: Path | None
    scene: Path | None


def write(part: Part, folder: Path) -> Files:
    """Write a part's files into a folder that exists."""
    names: dict[str, bytes] = {}
    if part.body is not None:
        names[_part_name(part.format)] = encode(part.body, part.format)
    if part.knots:
        names["knots.json"] = _knots_json(part)
    if part.scene is not None:
        names["scene.toml"] = tomli_w.dumps(dict(part.scene)).encode()
    for name, mask in part.pictures.items():
        names[name] = encode_mask(np.asarray(mask, dtype=bool))
    names.update(part.raw)
    for name, content in names.items():
        (folder / name).write_bytes(content)
    found = [folder / name for name in names if name.startswith("part.")]
    return Files(
        part=found[0] if found else None,
        knots=folder / "knots.json" if "knots.json" in names else None,
        scene=folder / "scene.toml" if "scene.toml" in names else None,
    )


def _part_name(form: str) -> str:
    return f"part.{form.partition('-')[0]}"


def _knots_json(part: Part) -> bytes:
    pairs = zip(part.types, part.knots, strict=True)
    knots = [{"closed": part.closed, "type": t, "points": k.tolist()} for t, k in pairs]
    data: dict[str, Any] = {"schema": 1, "unit": "mm", "knots": knots}
    if part.radius is not None:
        data["radius_mm"] = part.radius
    return json.dumps(data).encode()


def encode(body: Body, form: str) -> bytes:
    """The bytes of a mesh file: stl, stl-text, obj, ply, ply-binary, 3mf or 3mf-inch."""
    if form == "stl":
        return _stl(body)
    if form in ("3mf", "3mf-inch"):
        return _threemf(body, "millimeter" if form == "3mf" else "inch")
    if form == "stl-text":
        return "\n".join(["solid part", *_facets(body), "endsolid part", ""]).encode()
    if form == "obj":
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in body.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in body.faces + 1]
        return "\n".join([*lines, ""]).encode()
    if form in ("ply", "ply-binary"):
        return _ply(body, binary=form == "ply-binary")
    raise ValueError(f"no such format: {form}")


def _stl(body: Body) -> bytes:
    record = np.zeros(len(body.faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = body.vertices[body.faces]
    return bytes(80) + np.array(len(body.faces), dtype="<u4").tobytes() + record.tobytes()


def _facets(body: Body) -> list[str]:
    lines = []
    for corners in body.vertices[body.faces]:
        lines.append("facet normal 0 0 0\nouter loop")
        lines += [f"vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
        lines.append("endloop\nendfacet")
    return lines


def _ply(body: Body, *, binary: bool) -> bytes:
    head = (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\n"
        f"element vertex {len(body.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(body.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if binary:
        record = np.zeros(len(body.faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
        record["n"], record["i"] = 3, body.faces
        return head + body.vertices.astype("<f4").tobytes() + record.tobytes()
    lines = [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in body.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in body.faces]
    return head + "\n".join([*lines, ""]).encode()


def _threemf(body: Body, unit: str) -> bytes:
    points = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in body.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in body.faces)
    mesh = f"<mesh><vertices>{points}</vertices><triangles>{faces}</triangles></mesh>"
    content = model(f'<object id="1" type="model">{mesh}</object>', '<item objectid="1"/>')
    return as_3mf(content.replace("millimeter", unit))


def shadow(body: Body, view: Mapping[str, Any], pixels: tuple[int, int], pose: Array) -> Mask:
    """The shadow (H, W) that a body in part coordinates casts in a view, by drawing its triangles.

    Projected as docs/conventions.md says; nothing of the body may lie behind the wall.

    Args:
        pixels: width and height of the picture. pose: (4, 4), from part to scene.
    """
    azimuth, tilt = np.radians(view["azimuth_deg"]), np.radians(view["wall_tilt_deg"])
    axis = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    up = np.cos(tilt) * UP + np.sin(tilt) * axis
    light, wall = view["light_distance_mm"] * axis, -view["wall_distance_mm"] * axis
    lamp = view.get("light_right_mm", 0.0) * right + view.get("light_up_mm", 0.0) * UP
    points, light = body.vertices @ pose[:3, :3].T + pose[:3, 3], light + lamp
    ray = points - light
    normal = np.cross(right, up)
    onto = light + ray * ((wall - light) @ normal / (ray @ normal))[:, None] - wall
    width, height = (side * OVERSAMPLED for side in pixels)
    u = (onto @ right / view["frame_width_mm"] + 0.5) * width - 0.5
    v = (0.5 - onto @ up / view["frame_height_mm"]) * height - 0.5
    sheet = Image.new("L", (width, height), 0)
    draw = ImageDraw.Draw(sheet)
    for triangle in np.column_stack([u, v])[body.faces]:
        draw.polygon([(float(x), float(y)) for x, y in triangle], fill=255)
    small = sheet.resize(pixels, Image.Resampling.BOX)
    mask: Mask = np.asarray(small) >= 128
    return mask


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


def ply_header(form: str, faces: int = len(FACES), vertices: int = len(CORNERS)) -> str:
    return (
        f"ply\nformat {form} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def cube_ply(form: str = "ascii") -> bytes:
    head = ply_header(form).encode()
    if form == "ascii":
        rows = ["{} {} {}".format(*c) for c in CORNERS] + ["3 {} {} {}".format(*f) for f in FACES]
        return head + "\n".join([*rows, ""]).encode()
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(f"{order}3f", *c) for c in CORNERS)
    return head + body + b"".join(struct.pack(f"{order}B3i", 3, *f) for f in FACES)


def cube_arrays() -> bytes:
    packed = io.BytesIO()
    np.save(packed, np.array(CORNERS)[np.array(FACES)])
    return packed.getvalue()


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


def rewrite_archive(content: bytes, change: Callable[[dict[str, bytes]], object]) -> bytes:
    """Change the entries of an archive by name; names are written as they are, a backslash too."""
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        entries = {name: file.read(name) for name in file.namelist()}
    change(entries)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in entries.items():
            info = zipfile.ZipInfo()
            info.filename, info.compress_type = name, zipfile.ZIP_DEFLATED
            file.writestr(info, data)
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
        "cube.npy": cube_arrays(),
        "knots.json": square_knots(),
        "scene.toml": plain_scene(),
    }
