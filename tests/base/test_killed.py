"""A build that is killed at any moment, or the mending of one, leaves one whole result."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from command import knotfab

from knotfab.base.folder import OutputFolder
from knotfab.base.moves import mend
from tests.base.test_folder import build, listing


def kill_at(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """End this process, as `kill -9` does, before it changes names on the disk for the `count`th time."""
    left = [count]

    def counted(real: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **named: object) -> object:
            left[0] -= 1
            if left[0] == 0:
                os._exit(9)
            return real(*arguments, **named)

        return call

    for name in ("replace", "link", "unlink", "rmdir"):
        monkeypatch.setattr(os, name, counted(getattr(os, name)))


def in_a_child(work: Callable[[], object]) -> int:
    """Its exit code; nothing that it leaves open outlives it."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def old_files(folder: Path) -> None:
    build(folder, report__json="old", part__stl="old", part__glb="old")
    (folder / "mine.txt").write_text("user")
    with OutputFolder(folder) as out:
        out.write("report.json", "failed before")
        out.reject()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs to fork")
@pytest.mark.parametrize("passes", [True, False])
@pytest.mark.slow
def test_a_build_killed_at_any_moment_leaves_one_whole_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, passes: bool
) -> None:
    def write(folder: Path) -> None:
        with OutputFolder(folder) as out:
            for name in ("knots.json", "part.stl", "report.json"):
                out.write(name, "new")
            (out.commit if passes else out.reject)()

    monkeypatch.setattr(os, "fsync", lambda _: None)
    old_files(tmp_path / "old")
    old_files(tmp_path / "new")
    write(tmp_path / "new")
    before, after = listing(tmp_path / "old"), listing(tmp_path / "new")
    assert before != after
    seen = []
    for count in range(1, 60):
        folder = tmp_path / f"{count}"
        old_files(folder)

        def killed(folder: Path = folder, count: int = count) -> None:
            kill_at(count, monkeypatch)
            write(folder)

        code = in_a_child(killed)
        if count % 8:
            mend(folder)
        else:  # as the next command that names the folder, whatever it is
            assert knotfab("printers", folder / "part.stl").code == 2
        seen.append(listing(folder))
        assert seen[-1] in (before, after), f"mixed after {count}"
        if code == 0:
            break
    assert code == 0 and len(seen) > 8
    assert seen[0] == before and seen[-1] == after


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs to fork")
@pytest.mark.study
def test_mending_that_is_killed_is_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """This holds for mending that has to undo, too: something is in the way of a file."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    for way, count in ((way, count) for way in (False, True) for count in range(1, 10)):
        folder = tmp_path / f"{way}-{count}"
        old_files(folder)
        before = listing(folder)

        def killed(folder: Path = folder) -> None:
            with OutputFolder(folder) as out:
                for name in ("knots.json", "part.stl", "report.json"):
                    out.write(name, "new")
                kill_at(5, monkeypatch)
                out.commit()

        assert in_a_child(killed) == 9
        assert any(p.name.startswith(".knotfab-") for p in folder.iterdir())
        if way:
            (folder / "report.json").unlink()
            (folder / "report.json").mkdir()

        def mended(folder: Path = folder, count: int = count) -> None:
            kill_at(count, monkeypatch)
            mend(folder)

        in_a_child(mended)
        mend(folder)
        found = listing(folder)
        if way:
            assert found.pop("report.json/") == b"" and before["part.stl"] == found["part.stl"]
            assert set(found) == set(before) - {"report.json"}
        else:
            assert (found["part.stl"], found["report.json"]) == (b"new", b"new")
            assert "part.glb" not in found
