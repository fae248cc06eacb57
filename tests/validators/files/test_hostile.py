"""Strangers' files are refused in one sentence; sound ones of every format are read alike."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import read_knots, read_scene
from tests.corpus.cube_files import MESH, as_3mf, cube_obj, model, seeds
from tests.corpus.examine import examine, read_mesh
from tests.corpus.fuzzed import fuzz_file
from tests.corpus.hostile import handmade


def volume(path: Path) -> float:
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("name", [n for n in seeds() if n.split(".")[1] not in ("json", "toml")])
def test_every_format_reads_the_same_cube(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(seeds()[name])
    mesh = read_mesh(path)
    assert mesh.vertices.shape == (8, 3) and mesh.faces.shape == (12, 3)
    assert volume(path) == pytest.approx(8000.0, rel=1e-6)
    other = tmp_path / "cube.unknown"  # the content tells
    other.write_bytes(seeds()[name])
    assert volume(other) == pytest.approx(8000.0, rel=1e-6)


@pytest.mark.slow
def test_hostile_files_get_one_sentence(tmp_path: Path) -> None:
    for file in handmade():
        place = tmp_path / "place"
        place.mkdir()
        outcome = examine(file, place)
        if file.says is None:
            assert outcome.kind in ("pass", "fail", "refused"), (file.name, outcome.said)
        else:
            assert outcome.kind == "refused" and file.says in outcome.said, (file.name, outcome)
        assert {p.name for p in place.iterdir()} <= {file.name, "failures.png"}
        shutil.rmtree(place)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4))
def test_fuzzed_files_end_in_a_verdict_or_a_sentence(block: int, tmp_path: Path) -> None:
    # seeds among the 10,000 of make validator-table
    for seed in range(15 * block, 15 * (block + 1)):
        outcome = examine(fuzz_file(seed), tmp_path)
        assert outcome.kind in ("pass", "fail", "refused"), (seed, outcome)


def test_fuzzing_repeats_itself() -> None:
    assert fuzz_file(7) == fuzz_file(7) != fuzz_file(8)


def test_what_is_no_plain_file_is_refused_without_waiting(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.stl"
    os.mkfifo(pipe)
    loop = tmp_path / "loop.stl"
    loop.symlink_to(loop)
    for path in (pipe, loop, tmp_path, Path("/dev/zero"), tmp_path / "none.stl"):
        for read in (read_mesh, read_knots, read_scene):
            with pytest.raises(BadFile, match=path.name):
                read(path)


def test_faces_that_are_wrong_reach_the_checks(tmp_path: Path) -> None:
    """Equal faces, and one with a corner twice, are not repaired away."""
    path = tmp_path / "a.obj"
    path.write_bytes(cube_obj() + b"f 1 2 4\nf 1 1 2\n")
    assert len(read_mesh(path).faces) == 14


def test_a_3mf_has_its_units_transforms_and_components(tmp_path: Path) -> None:
    mesh = seeds()["cube.3mf"]
    assert mesh[:2] == b"PK"
    cube = f'<object id="1" type="model">{MESH}</object>'
    pair = (
        '<object id="2" type="model"><components><component objectid="1"/><component objectid="1" '
        'transform="1 0 0 0 1 0 0 0 1 50 0 0"/></components></object>'
    )
    twice = model(cube + pair, '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 7"/>')
    path = tmp_path / "a.3mf"
    path.write_bytes(as_3mf(twice))
    read = read_mesh(path)
    assert len(read.faces) == 24 and read.vertices.max(axis=0) == pytest.approx([70, 20, 27])
    for unit, mm in (("inch", 25.4), ("centimeter", 10.0)):
        path.write_bytes(as_3mf(twice.replace("millimeter", unit)))
        assert read_mesh(path).vertices.max(axis=0) == pytest.approx(mm * np.array([70, 20, 27]))


def test_open_curves_are_read(tmp_path: Path) -> None:
    path = tmp_path / "k.json"
    path.write_text(
        '{"schema": 1, "knots": [{"closed": false, "points": [[0,0,0],[3,0,0],[3,4,0]]},'
        ' {"points": [[0,0,9],[3,0,9],[3,4,9]]}]}'
    )
    curves = read_knots(path)
    assert curves.closed == (False, True) and curves.types == ("open", "unknot")
    assert curves.lengths_mm == (7.0, 12.0)
