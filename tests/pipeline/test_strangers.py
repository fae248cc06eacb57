"""Strangers' OBJ and PLY are read as they stand, or refused where trimesh would read them wrongly."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from knotfab import InputError, validate_part
from knotfab.pipeline import verifier
from knotfab.pipeline.strangers import validate_files
from knotfab.pipeline.verifier import Files
from knotfab_validators.check import BadFile
from knotfab_validators.geometry.mesh import enclosed_volume
from tests.corpus.files import cube_obj, cube_ply, seeds
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


@pytest.mark.parametrize("turn", range(3))
def test_concave_polygons_are_refused_and_convex_ones_read(tmp_path: Path, turn: int) -> None:
    """A fan of triangles fills a convex polygon, and lies on itself in a concave one (k18)."""
    (tmp_path / "a.obj").write_bytes(prism(COMB[turn:] + COMB[:turn]))
    with pytest.raises(BadFile, match="polygons that are concave"):
        read_mesh(tmp_path / "a.obj")
    angles = np.arange(7) * 2 * np.pi / 7
    (tmp_path / "b.obj").write_bytes(prism([(9 * np.cos(a), 9 * np.sin(a)) for a in angles]))
    area = 0.5 * 7 * 81 * np.sin(2 * np.pi / 7)
    assert enclosed_volume(read_mesh(tmp_path / "b.obj")) == pytest.approx(10 * area, rel=1e-5)


def test_polygons_become_fans(tmp_path: Path) -> None:
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [line for line in cube_obj().decode().splitlines() if not line.startswith("f")]
    lines += ["f " + " ".join(f"{i + 1}/9/{i + 2}" for i in quad) for quad in quads]
    (tmp_path / "q.obj").write_text("\n".join(lines))
    (tmp_path / "r.obj").write_text("\n".join(lines).replace("f 1/9/2", "f \\\n1/9/2"))
    head = cube_ply().decode().split("3 0 1 3")[0].replace("face 12", "face 6")
    rows = [f"4 {a} {b} {c} {d}" for a, b, c, d in quads]
    (tmp_path / "q.ply").write_text(head + "\n".join(rows))
    for name in ("q.obj", "r.obj", "q.ply"):
        assert len(read_mesh(tmp_path / name).faces) == 12
        assert enclosed_volume(read_mesh(tmp_path / name)) == pytest.approx(8000.0)


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_with_more_than_is_asked_for(order: str, tmp_path: Path) -> None:
    """Colours, another element before the faces, and doubles; faces of different sizes are refused."""
    word = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{word}_endian 1.0\ncomment made by hand\nelement vertex 4\n"
        "property double x\nproperty uchar red\nproperty double y\nproperty double z\n"
        "element strip 2\nproperty list ushort float s\nproperty short k\n"
        "element face 1\nproperty uchar flag\nproperty list uint ushort vertex_index\nend_header\n"
    )
    corners = [(0, 0, 0), (1 + 1e-9, 0, 0), (1, 1, 0), (0, 1, 0)]
    body = b"".join(struct.pack(order + "dBdd", x, 7, y, z) for x, y, z in corners)
    body += 2 * struct.pack(order + "H2fh", 2, 1.5, 2.5, 3)
    body += struct.pack(order + "BI4H", 1, 4, 0, 1, 2, 3)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    mesh = read_mesh(tmp_path / "a.ply")
    assert len(mesh.faces) == 2 and np.array_equal(mesh.vertices.max(axis=0), [1.0 + 1e-9, 1, 0])
    triangle = struct.pack(order + "BI3H", 1, 3, 0, 1, 2)
    mixed = head.replace("face 1", "face 2").encode() + body + triangle
    (tmp_path / "b.ply").write_bytes(mixed)
    with pytest.raises(BadFile, match="different numbers of corners"):
        read_mesh(tmp_path / "b.ply")


def test_indices_that_count_back_are_refused(tmp_path: Path) -> None:
    """trimesh counts them from the end of the whole file."""
    triangle = "v 0 0 {0}\nv 1 0 {0}\nv 0 1 {0}\nf -3 -2 -1\n"
    (tmp_path / "a.obj").write_text(triangle.format(0) + triangle.format(5))
    with pytest.raises(BadFile, match="counts back"):
        read_mesh(tmp_path / "a.obj")


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
    "a newline behind": binary_ply([*QUADS]) + b"\n",
    "a line's end behind": binary_ply([*QUADS]) + b"\r\n",
    "a mark before": b"\xef\xbb\xbf" + binary_ply([*QUADS]),
}


@pytest.mark.parametrize("kind", LOOSE_PLY)
def test_binary_polygons_are_read_whatever_stands_about_them(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.ply").write_bytes(LOOSE_PLY[kind])
    assert abs(enclosed_volume(read_mesh(tmp_path / "a.ply"))) == pytest.approx(8000)


def test_binary_polygons_of_different_sizes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(binary_ply(MIXED))  # k57
    with pytest.raises(BadFile, match="different numbers of corners"):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.slow
def test_a_part_that_takes_too_much_to_measure_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The validators' own process is limited: by a part that asks for all the time, or all the memory."""
    lines = ["import numpy", "from knotfab_formats import limits", "limits.MEASURING = {}", "{}"]
    for limit, does, said in (
        ("0, 12.0", "while True: pass", "measuring it takes more than"),
        ("900, 0.5", "numpy.ones(2**30)", "a.stl: measuring it takes more than 0.5 GB"),
    ):
        (tmp_path / "a.stl").write_bytes(seeds()["cube.stl"])
        monkeypatch.setattr(verifier, "_MODULE", "greedy")
        source = "\n".join(lines).format(limit, f"def eat(*_):\n {does}")
        source += "\nfrom importlib import import_module\nfrom knotfab_validators import service\n"
        source += "import_module('knotfab_validators.validate').read_piece = eat\nanswer = service.answer\n"
        (tmp_path / "greedy.py").write_text(source)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
        with pytest.raises(InputError, match=said):
            validate_files(Files(tmp_path / "a.stl"))
