"""Small good files of every kind that the validators read: a cube, a square knot, a plain scene."""

import io
import json
import struct
import zipfile

import numpy as np

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
