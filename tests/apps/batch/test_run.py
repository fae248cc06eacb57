"""A batch: one record a picture, nothing built twice, nothing stopped by a neighbour that fails.

Builds are played by a script, which does what the picture's text says.
"""

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from command import knotfab, small_disk
from PIL import Image
from played_runs import PYTHON, count, draw, write_player

from knotfab.apps.batch.run import batch, render_index
from knotfab.apps.batch.worker import Task, list_tasks, record_of
from knotfab.base.progress import Progress
from knotfab.cli.commands import app
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import prepare_build, require_same_picture
from knotfab_formats.errors import InputError


@pytest.fixture
def played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a line a run is kept, of builds that a script plays."""
    script, runs = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    return runs


def options(tmp_path: Path, **more: object) -> BuildOptions:
    return BuildOptions(out=tmp_path / "out", quiet=True, **more)  # type: ignore[arg-type]


ENDS = {
    "faithful": ((0, "faithful", "info"), ("pass", "passed, faithful")),
    "coarse": ((0, "coarse", "info"), ("warn", "passed, coarse")),
    "unsure": ((0, "good", "warn"), ("warn", "passed, good")),
    "failed": ((1, "coarse", "fail"), ("fail", "failed, coarse")),
}


@pytest.mark.parametrize("kind", ENDS)
def test_the_page_hides_nothing_behind_passed(kind: str, tmp_path: Path) -> None:
    (code, word, status), (colour, ended) = ENDS[kind]
    rows = [
        {"name": "likeness", "status": "info", "text": "97% alike"},
        {"name": "ink", "status": status, "text": "a: unsure"},
        {"name": "note", "status": "info", "text": "nothing that presses"},
    ]
    report = {"rows": rows, "verdict": {"word": word}}
    record = record_of(Task("a", "a.png", "a.png", (), ""), code, 1.0, "", report)
    page = render_index([record], tmp_path)
    assert f'<span class="{colour}">{ended}</span>' in page
    assert '<p class="info">97% alike</p>' in page and "nothing that presses" not in page
    assert (f'<p class="{status}">a: unsure</p>' in page) == (status != "info")


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


def test_a_build_without_a_report_has_no_earlier_figures(played: Path, tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="fail")
    assert batch([str(pictures)], options(tmp_path))[0]["iou"] == 0.95
    index = tmp_path / "out" / "index.html"
    assert "a/rejected/report.html" in index.read_text()
    (pictures / "a.png").write_text("crash")
    record = batch([str(pictures)], options(tmp_path))[0]
    assert (record["exit_code"], record["iou"], record["verdict"]) == (1, None, None)
    assert record["error"] == "out of ideas"
    assert "a/rejected" not in index.read_text()


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


def test_a_changed_scene_is_built_anew_with_its_options(played: Path, tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass")
    scene = tmp_path / "scene.toml"
    for seed in (1, 2):
        scene.write_text(f"[search]\nseed = {seed}\n")
        asked = options(tmp_path, scene=scene, mount="wall", skip=("slicer", "clearance"))
        batch([str(pictures / "a.png")], asked)
    lines = (played / "a.runs").read_text().splitlines()
    assert len(lines) == 2
    assert f"--mount=wall --scene={scene} --skip=slicer --skip=clearance" in lines[0]


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
    assert count(played) == {} and not (tmp_path / "out").exists()


def test_bad_input_is_one_sentence_each(played: Path, tmp_path: Path) -> None:
    one, two = (
        draw(tmp_path / n, **{name: "pass"}) for n, name in (("one", "cat"), ("two", "Cat"))
    )
    done = knotfab("batch", one, two, "--out", tmp_path / "out")
    assert done.code == 2 and done.out == "" and done.err.count("\n") == 1
    assert "its folder would be Cat, and so would that of" in done.err and "Rename" in done.err
    (tmp_path / "file").write_text("a person's")
    done = knotfab("batch", one, "--out", tmp_path / "file")
    assert done.code == 2 and done.err.count("\n") == 1 and "file" in done.err
    assert count(played) == {} and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_unreadable_picture_among_good_ones(played: Path, tmp_path: Path) -> None:
    """The real build's sentence is in its record, and the others are built."""
    pictures = draw(tmp_path / "pictures", a="pass", b="real", c="pass")
    done = knotfab("batch", pictures, "--out", tmp_path / "out", "--jobs", "2")
    assert done.code == 1 and "2 of 3 passed" in done.out
    records = json.loads((tmp_path / "out" / "batch.json").read_text())
    assert [r["exit_code"] for r in records] == [0, 2, 0]
    assert "b.png: it is not a picture" in records[1]["error"]
    assert not (tmp_path / "out" / "b").exists()


def test_a_full_disk_is_one_sentence(played: Path, tmp_path: Path) -> None:
    """Before anything is built, or as soon as a record cannot be written; earlier ones stay."""
    pictures = draw(tmp_path / "pictures", a="pass")
    later = draw(tmp_path / "later", b="fill")
    with small_disk(tmp_path / "out", "128k") as disk:
        call = ("batch", "--out", disk, "--jobs", "1", "--quiet")
        assert knotfab(*call, pictures).code == 0
        before = (disk / "batch.json").read_text()
        for _ in range(2):
            done = knotfab(*call, pictures, later)
            assert done.code == 2 and done.err.count("\n") == 1
            assert "cannot be written (No space left on device)" in done.err
            assert (disk / "batch.json").read_text() == before
        assert sorted(p.name for p in disk.iterdir()) == ["a", "b", "batch.json", "index.html"]
    assert count(played) == {"a": 1, "b": 1}


@pytest.mark.slow
def test_an_interrupted_batch_ends_its_builds_and_goes_on_later(
    played: Path, tmp_path: Path
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="wait", c="pass")
    program = (
        "import sys; from knotfab.apps.batch.run import batch;"
        "from knotfab.pipeline.options import BuildOptions; from pathlib import Path;"
        f"sys.executable = {str(tmp_path / 'played')!r};"
        f"batch([{str(pictures)!r}], BuildOptions(out=Path({str(tmp_path / 'out')!r})), jobs=1)"
    )
    child = subprocess.Popen([PYTHON, "-c", program], stderr=subprocess.PIPE)
    assert child.stderr is not None
    next(line for line in child.stderr if b"1/3 a " in line)  # its record is there
    while not (played / "b.runs").exists():  # b builds, and waits
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    child.communicate(timeout=120)
    records = json.loads((tmp_path / "out" / "batch.json").read_text())
    assert [r["name"] for r in records] == ["a"]
    (pictures / "b.png").write_text("pass")
    assert [r["exit_code"] for r in batch([str(pictures)], options(tmp_path))] == [0, 0, 0]
    assert count(played) == {"a": 1, "b": 2, "c": 1}


def test_file_names_are_never_options_nor_texts(
    played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    names = ("--events=victim.png", "-x.png", "text:abc.png", "~cat.png", "犬.png", "猫.png")
    for name in (*names, "victim.png"):
        (pictures / name).write_text("pass")
    monkeypatch.chdir(pictures)
    asked = options(tmp_path)
    records = batch(["."], asked, jobs=2)
    assert {r["exit_code"] for r in records} == {0} and len(records) == 7
    assert {r["name"] for r in records} >= {"text-abc", "cat", "犬", "猫"}
    assert (pictures / "victim.png").read_text() == "pass"
    assert [r["picture"] for r in batch(["./text:abc.png"], asked)] == ["./text:abc.png"]
    # each is one that the real command reads as that picture
    for source in (t.picture for t in list_tasks(["."], asked)):
        bound = app.parse_args(["build", "--out=o", "--quiet", "--", source])[1].arguments
        assert bound["pictures"] == (source,) and not source.startswith(("text:", "-", "~"))


def test_what_is_no_picture_in_a_folder_is_left_out(played: Path, tmp_path: Path) -> None:
    """Neither read nor waited for: a pipe would be read for ever."""
    pictures = draw(tmp_path / "pictures", a="pass", **{"._a": "of a system", ".hidden": "too"})
    os.mkfifo(pictures / "b.png")
    (pictures / "c.png").symlink_to("/dev/zero")
    (pictures / "d.png").mkdir()
    (pictures / "loop.png").symlink_to("loop.png")
    with (pictures / "e.png").open("wb") as file:
        file.truncate(5 * 2**30)  # bytes, of which a disk holds none
    said: list[str] = []
    tasks = list_tasks([str(pictures)], options(tmp_path), said.append)
    assert [Path(t.picture).name for t in tasks] == ["a.png", "e.png"]
    assert len(said) == 4 and all("is left out: it is no regular file" in s for s in said)


def test_batches_into_one_folder_keep_each_others_records(played: Path, tmp_path: Path) -> None:
    one, two = draw(tmp_path / "one", a="pass"), draw(tmp_path / "two", b="pass", c="wrong")
    batch([str(one)], options(tmp_path))
    batch([str(two)], options(tmp_path))
    kept = tmp_path / "out" / "batch.json"
    assert {r["name"] for r in json.loads(kept.read_text())} == {"a", "b", "c"}
    assert "a/report.html" in (kept.parent / "index.html").read_text()
    shutil.rmtree(tmp_path / "out" / "a")  # and what is gone is not told of
    batch([str(two)], options(tmp_path))
    assert {r["name"] for r in json.loads(kept.read_text())} == {"b", "c"}


@pytest.mark.slow
def test_a_damaged_record_is_none(played: Path, tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass")
    first = batch([str(pictures)], options(tmp_path))
    kept = tmp_path / "out" / "batch.json"
    whole = json.loads(kept.read_text())
    for damage in ("", "[null, {}, 1]", '{"a": 1}', "[" * 9999):
        kept.write_text(damage)
        again = batch([str(pictures)], options(tmp_path))
        assert again[0] | {"seconds": 0} == first[0] | {"seconds": 0}, damage[:20]
    for key in ("exit_code", "iou"):
        kept.write_text(json.dumps([{k: v for k, v in whole[0].items() if k != key}]))
        assert batch([str(pictures)], options(tmp_path))[0]["exit_code"] == 0


def test_a_batch_replaces_no_build_of_another_picture(played: Path, tmp_path: Path) -> None:
    """Of the same name, from another folder; nor does it build into a build's own folder."""
    one, two = draw(tmp_path / "one", a="pass"), draw(tmp_path / "two", a="pass")
    for folder, shade in ((one, 0), (two, 90)):
        picture = Image.new("L", (64, 64), 255)
        picture.paste(shade, (16, 16 + shade // 10, 48, 48))
        picture.save(folder / "a.png")
    built = tmp_path / "out" / "a"
    built.mkdir(parents=True)
    shutil.copy(one / "a.png", built / "given-front.png")
    (built / "report.json").write_text("{}")
    with pytest.raises(InputError, match=r"out/a: it holds what was built from another picture"):
        batch([str(two)], options(tmp_path), spare=require_same_picture)
    assert count(played) == {} and [p.name for p in (tmp_path / "out").iterdir()] == ["a"]
    with pytest.raises(InputError, match=r"it holds one build itself.*--force"):
        batch([str(two)], BuildOptions(out=built, quiet=True))
    with pytest.raises(InputError, match=r"holds the builds of a batch.*--force"):
        (tmp_path / "out" / "batch.json").write_text("[]")
        prepare_build([str(one / "a.png")], options(tmp_path), "", Progress("quiet"))
    assert len(batch([str(two)], options(tmp_path, force=True))) == 1
