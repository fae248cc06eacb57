"""Triangles of STL files, binary and text, are read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from validator_parts import circle, tube

from knotfab_validators.files.mesh import read_mesh
from tests.corpus.files import encode
from tests.corpus.parts import Body


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
