"""Strangers' OBJ and PLY are read as they stand: polygons, indices from the end, doubles, byte orders."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from knotfab import InputError, validate_part
from knotfab_validators.check import BadFile
from knotfab_validators.geometry.mesh import enclosed_volume
from tests.corpus.files import cube_obj, cube_ply
from tests.corpus.judge import read_mesh


def prism(corners: list[tuple[float, float]]) -> bytes:
    """An OBJ of a prism 10 mm high over a polygon, each face one polygon."""
    n = len(corners)
    lines = [f"v {x} {y} {z}" for z in (0, 10) for x, y in corners]
    lines.append("f " + " ".join(str(k) for k in range(n, 0, -1)))
    lines.append("f " + " ".join(str(n + k) for k in range(1, n + 1)))
    lines += [f"f {k + 1} {(k + 1) % n + 1} {n + (k + 1) % n + 1} {n + k + 1}" for k in range(n)]
    return "\n".join([*lines, ""]).encode()


COMB = [(0, 0), (60, 0), (60, 9), *((60 - k, 9 if k % 2 else 1) for k in range(1, 60)), (0, 9)]
SPIRAL = [
    ((20 + 3 * t + wide) * np.cos(t), (20 + 3 * t + wide) * np.sin(t))
    for wide, way in ((4.0, 1), (0.0, -1))
    for t in np.linspace(0, 11, 60)[::way]
]
BESIDE = [(0, 0), (5, 0), (10, 0), (10, 4), (6, 4), (6, 8), (10, 8), (10, 12), (0, 12), (0, 6)]


@pytest.mark.parametrize("corners", [COMB, SPIRAL, BESIDE], ids=["comb", "spiral", "in line"])
@pytest.mark.parametrize("turn", range(3))
def test_concave_polygons_are_cut_into_triangles_that_fill_them(
    tmp_path: Path, corners: list[tuple[float, float]], turn: int
) -> None:
    (tmp_path / "a.obj").write_bytes(prism(corners[turn:] + corners[:turn]))
    mesh = read_mesh(tmp_path / "a.obj")
    x, y = np.array(corners).T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert enclosed_volume(mesh) == pytest.approx(10 * area)
    caps = mesh.faces[np.ptp(mesh.vertices[mesh.faces][:, :, 2], axis=1) == 0]
    assert mesh.normals[1].sum() == pytest.approx(
        2 * area + 10 * np.hypot(x - np.roll(x, 1), y - np.roll(y, 1)).sum()
    )
    assert len(caps) == 2 * (len(corners) - 2)


def test_polygons_become_fans(tmp_path: Path) -> None:
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [line for line in cube_obj().decode().splitlines() if not line.startswith("f")]
    lines += ["f " + " ".join(f"{i + 1}/9/{i + 2}" for i in quad) for quad in quads]
    (tmp_path / "q.obj").write_text("\n".join(lines))
    relative = [line for line in lines if not line.startswith("f")]
    relative += ["f " + " ".join(f"{i - 8}//" for i in quad) for quad in quads]
    (tmp_path / "r.obj").write_text("\n".join(relative).replace("f -8//", "f \\\n-8//"))
    head = cube_ply().decode().split("3 0 1 3")[0].replace("face 12", "face 6")
    rows = [f"4 {a} {b} {c} {d}" for a, b, c, d in quads]
    (tmp_path / "q.ply").write_text(head + "\n".join(rows))
    for name in ("q.obj", "r.obj", "q.ply"):
        assert len(read_mesh(tmp_path / name).faces) == 12
        assert enclosed_volume(read_mesh(tmp_path / name)) == pytest.approx(8000.0)


@pytest.mark.parametrize("binary", [False, True])
def test_concave_polygons_of_a_ply_are_cut_too(binary: bool, tmp_path: Path) -> None:
    """An L-shaped prism of 700 mm², 10 mm high, each face one polygon that begins at a bad corner (k18)."""
    plan = [(10, 10), (10, 40), (0, 40), (0, 0), (40, 0), (40, 10)]
    points = [(x, y, z) for z in (0, 10) for x, y in plan[1:] + plan[:1]]
    rings = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11]]
    rings += [[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    kind = "binary_little_endian" if binary else "ascii"
    head = f"ply\nformat {kind} 1.0\nelement vertex 12\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, p)) for p in points] + [
        f"{len(r)} {' '.join(map(str, r))}" for r in rings
    ]
    body = "\n".join(rows).encode()
    if binary:
        body = b"".join(struct.pack("<3f", *p) for p in points)
        body += b"".join(struct.pack(f"<B{len(r)}i", len(r), *r) for r in rings)
    (tmp_path / "l.ply").write_bytes(head.encode() + body)
    found = read_mesh(tmp_path / "l.ply")
    caps = [f for f in found.faces if np.ptp(found.vertices[f][:, 2]) == 0]
    areas = [
        np.linalg.norm(np.cross(*(found.vertices[f][1:] - found.vertices[f][0]))) / 2 for f in caps
    ]
    assert enclosed_volume(found) == pytest.approx(7000.0) and sum(areas) == pytest.approx(1400.0)


def test_a_polygon_that_crosses_itself_is_a_fan(tmp_path: Path) -> None:
    points = np.random.default_rng(0).random((90, 2))
    lines = [f"v {x} {y} 0" for x, y in points] + ["f " + " ".join(map(str, range(1, 91)))]
    (tmp_path / "tangle.obj").write_text("\n".join(lines))
    assert len(read_mesh(tmp_path / "tangle.obj").faces) == 88


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_with_more_than_is_asked_for(order: str, tmp_path: Path) -> None:
    """Colours, another element before the faces, and doubles; faces of different sizes are refused."""
    word = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{word}_endian 1.0\ncomment made by hand\nelement vertex 4\n"
        "property double x\nproperty uchar red\nproperty double y\nproperty double z\n"
        "element strip 2\nproperty list ushort float s\nproperty short k\n"
        "element face 2\nproperty uchar flag\nproperty list uint ushort vertex_index\nend_header\n"
    )
    corners = [(0, 0, 0), (1 + 1e-9, 0, 0), (1, 1, 0), (0, 1, 0)]
    body = b"".join(struct.pack(order + "dBdd", x, 7, y, z) for x, y, z in corners)
    body += 2 * struct.pack(order + "H2fh", 2, 1.5, 2.5, 3)
    for face in ((0, 1, 2, 3), (0, 3, 2, 1)):
        body += struct.pack(order + "BI4H", 1, 4, *face)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    mesh = read_mesh(tmp_path / "a.ply")
    assert len(mesh.faces) == 4 and np.array_equal(mesh.vertices.max(axis=0), [1.0 + 1e-9, 1, 0])
    triangle = struct.pack(order + "BI3H", 1, 3, 0, 1, 2)
    mixed = head.replace("face 2", "face 3").encode() + body + triangle
    (tmp_path / "b.ply").write_bytes(mixed)
    with pytest.raises(BadFile, match="different numbers of corners"):
        read_mesh(tmp_path / "b.ply")


def test_the_vertices_before_a_face_are_those_that_it_counts_back_from(tmp_path: Path) -> None:
    triangle = "v 0 0 {0}\nv 1 0 {0}\nv 0 1 {0}\nf -3 -2 -1\n"
    (tmp_path / "a.obj").write_text(triangle.format(0) + triangle.format(5))
    mesh = read_mesh(tmp_path / "a.obj")
    assert sorted(map(set, mesh.vertices[mesh.faces][:, :, 2].tolist()), key=max) == [{0}, {5}]


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["obj", "ply"])
def test_the_library_reads_them_and_refuses_what_is_broken(ending: str, tmp_path: Path) -> None:
    content = {"obj": cube_obj(), "ply": cube_ply()}[ending]
    (tmp_path / f"a.{ending}").write_bytes(content)
    assert validate_part(tmp_path / f"a.{ending}")["status"] == "pass"
    (tmp_path / f"b.{ending}").write_bytes(content.replace(b"20.0", b"twenty"))
    with pytest.raises(InputError, match=f"b.{ending}: it is damaged"):
        validate_part(tmp_path / f"b.{ending}")


def binary_ply(faces: list[tuple[int, ...]], comment: bytes = b"") -> bytes:
    """A binary PLY of a cube of 20 mm, its polygons as they are given."""
    corners = [(x, y, z) for x in (0, 20) for y in (0, 20) for z in (0, 20)]
    head = b"ply\nformat binary_little_endian 1.0\n" + comment + b"element vertex 8\n"
    head += b"".join(b"property float %c\n" % axis for axis in b"xyz")
    head += b"element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(faces)
    body = b"".join(struct.pack("<3f", *corner) for corner in corners)
    return head + body + b"".join(struct.pack(f"<B{len(f)}i", len(f), *f) for f in faces)


QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
MIXED: list[tuple[int, ...]] = [(0, 1, 3), (0, 3, 2), *QUADS[1:]]
LOOSE_PLY = {
    "quads": binary_ply([*QUADS]),
    "triangles and quads": binary_ply(MIXED),
    "a newline behind": binary_ply(MIXED) + b"\n",
    "a newline behind quads": binary_ply([*QUADS]) + b"\r\n",
    "a mark before": b"\xef\xbb\xbf" + binary_ply(MIXED),
    "a comment that names the end": binary_ply(MIXED, b"comment the end_header follows\n"),
}


@pytest.mark.parametrize("kind", LOOSE_PLY)
def test_every_kind_of_ply_that_was_read_is_read(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.ply").write_bytes(LOOSE_PLY[kind])
    assert abs(enclosed_volume(read_mesh(tmp_path / "a.ply"))) == pytest.approx(8000)
