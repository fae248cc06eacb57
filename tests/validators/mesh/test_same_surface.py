"""The 3MF beside an STL: the same surface in any order, or another one, and where."""

from __future__ import annotations

from collections.abc import Callable
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
from tests.corpus.files import encode, write
from tests.corpus.forged_3mf import Change, forge_3mf, forged_3mf
from tests.corpus.parts import Body

VERTICES, FACES = tube(trefoil(150) + 60.0, 3.0, 16)
MESH = Mesh(VERTICES, FACES)


def reordered() -> Mesh:
    rng = np.random.default_rng(1)
    order = rng.permutation(len(VERTICES))
    faces = np.argsort(order)[FACES[rng.permutation(len(FACES))]]
    turned = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
    return Mesh(VERTICES[order], np.take_along_axis(faces, turned, axis=1))


@pytest.mark.parametrize("other", [MESH, reordered()])
def test_order_and_rounding_make_no_difference(other: Mesh) -> None:
    rounded = Mesh(other.vertices.astype(np.float32).astype(np.float64), other.faces)
    found = compare_surfaces(MESH, rounded)
    assert found.faces == 0 and found.away_mm < 1e-5


@pytest.mark.parametrize("factor", [0.9, 1.1])
@pytest.mark.parametrize("other", [MESH, reordered()])
def test_one_vertex_may_be_off_by_a_thousandth(other: Mesh, factor: float) -> None:
    vertices = other.vertices.copy()
    vertices[77, 2] += factor * LIMIT_MM
    found = compare_surfaces(MESH, Mesh(vertices, other.faces))
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
    assert compare_surfaces(MESH, make()).faces == count


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
    beside.write_bytes(forge_3mf(beside.read_bytes(), change))
    found = check_same_3mf(read_mesh(part), part)
    assert (found.status, found.required) == ("fail", True), name
