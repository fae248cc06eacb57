"""A batch: one record a picture, nothing built twice, nothing stopped by a neighbour that fails.

Builds are played by a script, which does what the picture's text says; a real one is in `test_batch_builds`.
"""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest
from played_builds import PYTHON, count, draw, write_player

from knotfab.batch import worker
from knotfab.batch.run import batch, count_jobs
from knotfab.batch.tasks import list_tasks
from knotfab.errors import InputError
from knotfab.options import BuildOptions


@pytest.fixture
def played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a line a run is kept, of builds that a script plays."""
    script, runs = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    return runs


def options(tmp_path: Path, **more: object) -> BuildOptions:
    return BuildOptions(out=tmp_path / "out", quiet=True, **more)  # type: ignore[arg-type]


def test_one_that_fails_does_not_stop_the_others(played: Path, tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="wrong", c="fail", d="kill", e="pass")
    records = batch([str(pictures)], options(tmp_path), jobs=2)
    assert [r["name"] for r in records] == ["a", "b", "c", "d", "e"]
    assert [r["exit_code"] for r in records] == [0, 2, 1, 128 + signal.SIGKILL, 0]
    assert [r["iou"] for r in records] == [0.95, None, 0.95, None, 0.95]
    assert records[1]["error"].endswith("no picture. Draw one.")
    assert "killed" in records[3]["error"]
    assert json.loads((tmp_path / "out" / "batch.json").read_text()) == records
    page = (tmp_path / "out" / "index.html").read_text()
    assert "2 of 5" in page and 'href="c/rejected/report.html"' in page
    assert 'src="a/compare-front.png"' in page
    assert count(played) == {"a": 1, "b": 1, "c": 1, "d": 2, "e": 1}


def test_started_again_only_what_is_missing_or_changed_is_built(
    played: Path, tmp_path: Path
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="fail", c="kill", d="pass")
    first = batch([str(pictures)], options(tmp_path), jobs=2)
    (pictures / "c.png").write_text("pass")
    (tmp_path / "out" / "d" / "report.json").unlink()
    second = batch([str(pictures)], options(tmp_path), jobs=2)
    assert count(played) == {"a": 1, "b": 1, "c": 3, "d": 2}
    assert second[:2] == first[:2] and second[2]["exit_code"] == 0
    batch([str(pictures)], options(tmp_path, seed=3), jobs=2)
    assert count(played) == {"a": 2, "b": 2, "c": 4, "d": 3}


def test_a_scene_that_changed_is_built_anew_and_options_reach_the_build(
    played: Path, tmp_path: Path
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass")
    scene = tmp_path / "scene.toml"
    for seed in (1, 2):
        scene.write_text(f"[search]\nseed = {seed}\n")
        asked = options(tmp_path, scene=scene, mount="wall", skip=("slicer", "legibility"))
        batch([str(pictures / "a.png")], asked)
    lines = (played / "a.runs").read_text().splitlines()
    assert len(lines) == 2
    assert f"--scene={scene} --mount=wall --skip=slicer --skip=legibility" in lines[0]


def test_wrong_calls_are_refused_before_anything_is_built(played: Path, tmp_path: Path) -> None:
    one, two = (draw(tmp_path / n, same="pass") for n in ("one", "two"))
    (tmp_path / "none").mkdir()
    for pictures, jobs, reason in (
        ([str(one), str(two)], 1, "its folder would be same"),
        ([str(tmp_path / "none")], 1, "holds no pictures"),
        ([], 1, "no picture is given"),
        ([str(one)], 0, "not a positive number"),
    ):
        with pytest.raises(InputError, match=reason):
            batch(pictures, options(tmp_path), jobs=jobs)
    assert count(played) == {}
    assert count_jobs() >= 1


def test_an_interrupted_batch_ends_its_builds_and_goes_on_later(
    played: Path, tmp_path: Path
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="wait", c="pass")
    program = (
        "import sys; from knotfab.batch import worker; from knotfab.batch.run import batch;"
        "from knotfab.options import BuildOptions; from pathlib import Path;"
        f"sys.executable = {str(tmp_path / 'played')!r};"
        f"batch([{str(pictures)!r}], BuildOptions(out=Path({str(tmp_path / 'out')!r})), jobs=1)"
    )
    child = subprocess.Popen([PYTHON, "-c", program], stderr=subprocess.PIPE)
    waiting = time.monotonic() + 60
    while not (played / "b.runs").exists() and time.monotonic() < waiting:
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    begun = time.monotonic()
    child.communicate(timeout=50)
    assert time.monotonic() - begun < 40  # it did not wait for the build
    records = json.loads((tmp_path / "out" / "batch.json").read_text())
    assert [r["name"] for r in records] == ["a"]
    (pictures / "b.png").write_text("pass")
    assert [r["exit_code"] for r in batch([str(pictures)], options(tmp_path))] == [0, 0, 0]
    assert count(played) == {"a": 1, "b": 2, "c": 1}


def test_a_parcel_builds_what_the_task_would(played: Path, tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="fail")
    scene = tmp_path / "scene.toml"
    scene.write_text("[search]\nseed = 4\n")
    tasks = list_tasks([str(pictures)], options(tmp_path, scene=scene))
    for task, code in zip(tasks, (0, 1), strict=True):
        record, result = worker.build_parcel(worker.pack_task(task))
        assert (record["exit_code"], record["key"]) == (code, task.key)
        assert record["picture"] == task.picture
        worker.unpack_result(record, result, tmp_path / "out" / task.name)
    assert (tmp_path / "out" / "a" / "report.json").is_file()
    assert (tmp_path / "out" / "b" / "rejected" / "report.json").is_file()
    assert not (tmp_path / "out" / "b" / "report.json").exists()
