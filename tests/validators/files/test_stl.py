"""Triangles of STL files, binary and text, are read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from validator_parts import Array, circle, tube

from knotfab_validators.files.mesh import read_mesh


def binary_stl(corners: Array) -> bytes:
    record = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = corners
    return b"solid".ljust(80) + np.uint32(len(corners)).tobytes() + record.tobytes()


@pytest.fixture
def corners() -> Array:
    vertices, faces = tube(circle(30) + 100, 3.0, 8)
    return np.asarray(vertices.astype(np.float32)[faces])


def test_binary_stl_gives_its_triangles_and_joins_equal_corners(
    tmp_path: Path, corners: Array
) -> None:
    (tmp_path / "part.stl").write_bytes(binary_stl(corners))
    mesh = read_mesh(tmp_path / "part.stl")
    assert np.array_equal(mesh.vertices[mesh.faces], corners.astype(np.float64))
    assert len(mesh.vertices) == 30 * 8
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.int64


def test_text_stl_gives_the_same(tmp_path: Path, corners: Array) -> None:
    lines = ["solid part"]
    for triangle in corners:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x!s} {y!s} {z!s}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    (tmp_path / "part.stl").write_text("\n".join([*lines, "endsolid part", ""]))
    mesh = read_mesh(tmp_path / "part.stl")
    np.testing.assert_allclose(mesh.vertices[mesh.faces], corners, rtol=1e-6)
    assert len(mesh.vertices) == 30 * 8
