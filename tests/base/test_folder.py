"""The output folder appears whole or not at all, whatever goes wrong."""

import errno
import json
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import command
import pytest
from command import killed_build, knotfab, picture, square

from knotfab.base.errors import MachineError
from knotfab.base.folder import OutputFolder
from knotfab.base.moves import REJECTED, _kept_secret, _sign, mend
from knotfab_formats.errors import InputError


def listing(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if not p.is_dir()
    } | {str(p.relative_to(folder)) + "/": b"" for p in folder.rglob("*") if p.is_dir()}


def build(folder: Path, **files: str) -> None:
    with OutputFolder(folder) as out:
        for name, content in files.items():
            out.write(name.replace("__", "."), content)
        out.commit()


def test_commit_creates_parents_and_replaces_an_earlier_build(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    build(folder, knots__json="one", note="kept")
    (folder / "mine.txt").write_text("user")
    build(folder, knots__json="two")
    assert listing(folder) == {"knots.json": b"two", "note": b"kept", "mine.txt": b"user"}


def test_files_of_an_earlier_build_that_would_contradict_go(tmp_path: Path) -> None:
    build(tmp_path, report__json="{}", part__3mf="old", knots__json="old")
    for name in (
        "part.glb",
        "plate-2.3mf",
        "part-colours.3mf",
        "part-colours-01.3mf",
        "slicer.ini",
    ):
        (tmp_path / name).write_text("old")
    for name in ("setup.pdf", "setup.svg", "drill-template.pdf", "drill-template-a4.pdf"):
        (tmp_path / name).write_text("old")
    for name in ("plate-notes.txt", "setup.txt", "drill-template.txt"):
        (tmp_path / name).write_text("user")
    build(tmp_path, report__json="{ }", knots__json="new")
    users = {"plate-notes.txt", "setup.txt", "drill-template.txt"}
    assert set(listing(tmp_path)) == {"report.json", "knots.json", *users}


def test_an_earlier_rejected_build_goes_with_one_that_passes(tmp_path: Path) -> None:
    with OutputFolder(tmp_path) as out:
        out.write("report.json", "failed")
        out.reject()
    build(tmp_path, report__json="passed")
    assert listing(tmp_path) == {"report.json": b"passed"}
    (tmp_path / REJECTED).mkdir()
    (tmp_path / REJECTED / "mine.txt").write_text("user")  # no build's
    build(tmp_path, report__json="passed")
    assert (tmp_path / REJECTED / "mine.txt").read_text() == "user"


def test_without_a_report_nothing_is_taken_for_an_earlier_build(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text("user")
    build(tmp_path, knots__json="new")
    assert set(listing(tmp_path)) == {"part.stl", "knots.json"}


def test_nothing_appears_before_commit(tmp_path: Path) -> None:
    with OutputFolder(tmp_path) as out:
        out.write("knots.json", "new")
        assert [p for p in tmp_path.iterdir() if not p.name.startswith(".")] == []
    assert listing(tmp_path) == {}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, InputError, SystemExit])
def test_any_failure_leaves_what_was_there(tmp_path: Path, error: type[BaseException]) -> None:
    build(tmp_path, knots__json="good")
    before = listing(tmp_path)
    arguments = ("what", "why", "remedy") if error is InputError else ()
    with pytest.raises(error), OutputFolder(tmp_path) as out:
        out.write("knots.json", "half")
        raise error(*arguments)
    assert listing(tmp_path) == before


def test_failure_removes_the_folders_it_made(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path / "new" / "deep"):
        raise KeyboardInterrupt
    assert listing(tmp_path) == {}


def test_reject_leaves_the_good_result_and_replaces_the_rejected(tmp_path: Path) -> None:
    build(tmp_path, knots__json="good")
    for content in ("bad", "worse"):
        with OutputFolder(tmp_path) as out:
            out.write("knots.json", content)
            if content == "bad":
                out.write("extra.png", "x")
            out.reject()
    assert listing(tmp_path) == {
        "knots.json": b"good",
        f"{REJECTED}/": b"",
        f"{REJECTED}/knots.json": b"worse",
    }


@pytest.mark.parametrize("failing", [1, 2, 3])
def test_a_move_that_fails_undoes_those_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    build(tmp_path, report__json="old", part__stl="old", plate__3mf="old")
    before = listing(tmp_path)
    real, calls = os.replace, []

    def replace(source: Path, target: Path) -> None:
        calls.append(target)
        if len(calls) == failing:
            raise OSError(errno.EIO, "Input/output error")
        real(source, target)

    with pytest.raises(MachineError, match="Input/output error"), OutputFolder(tmp_path) as out:
        for name in ("knots.json", "part.stl", "report.json"):
            out.write(name, "new")
        monkeypatch.setattr(os, "replace", replace)
        out.commit()
    assert listing(tmp_path) == before


def test_a_directory_in_the_way_is_not_removed(tmp_path: Path) -> None:
    (tmp_path / "part.stl").mkdir()
    (tmp_path / "part.stl" / "mine").write_text("user")
    before = listing(tmp_path)
    with pytest.raises(MachineError, match=r"part\.stl is a directory"):
        build(tmp_path, knots__json="new", part__stl="new")
    assert listing(tmp_path) == before


def test_rejects_a_path_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("user")
    with pytest.raises(InputError, match=r"it is a file.*--out") as caught:
        OutputFolder(tmp_path / "out").__enter__()
    assert caught.value.exit_code == 2
    with pytest.raises(InputError, match="part of this path is a file"):
        OutputFolder(tmp_path / "out" / "deeper").__enter__()
    assert listing(tmp_path) == {"out": b"user"}


def test_rejects_a_file_where_failed_builds_go(tmp_path: Path) -> None:
    (tmp_path / REJECTED).write_text("user")
    with pytest.raises(InputError, match="failed builds go there"):
        OutputFolder(tmp_path).__enter__()
    assert listing(tmp_path) == {REJECTED: b"user"}


def test_rejects_a_folder_that_may_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def deny(_: object) -> int:
        raise PermissionError(errno.EACCES, "Permission deny")

    monkeypatch.setattr("knotfab.base.folder.hold", deny)
    with pytest.raises(InputError, match=r"cannot be written \(Permission deny\).*--out"):
        OutputFolder(tmp_path / "new").__enter__()
    assert listing(tmp_path) == {}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_rejects_a_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    try:
        with pytest.raises(InputError, match="cannot be written"):
            OutputFolder(tmp_path / "new").__enter__()
    finally:
        tmp_path.chmod(0o755)


def test_full_disk_is_said_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build(tmp_path, knots__json="good")
    before = listing(tmp_path)

    def full(self: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    said = r"the disk is full.*untouched.*Free some space"
    with pytest.raises(MachineError, match=said) as caught, OutputFolder(tmp_path) as out:
        monkeypatch.setattr(Path, "write_bytes", full)
        out.write("knots.json", "new")
    monkeypatch.undo()
    assert caught.value.exit_code == 3
    assert listing(tmp_path) == before
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(MachineError, match="the disk is full"):
        OutputFolder(tmp_path).__enter__()  # noticed before any long work
    monkeypatch.undo()
    assert listing(tmp_path) == before


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 64 KiB."""
    with command.small_disk(tmp_path / "disk", "64k") as disk:
        yield disk


def test_a_disk_that_really_is_full(small_disk: Path) -> None:
    build(small_disk, knots__json="good")
    before = listing(small_disk)
    with pytest.raises(MachineError, match="the disk is full"), OutputFolder(small_disk) as out:
        out.write("part.stl", b"x" * 200_000)
    assert listing(small_disk) == before


def test_a_library_that_ignores_a_full_disk_is_caught(small_disk: Path) -> None:
    build(small_disk, knots__json="good")
    before = listing(small_disk)
    with pytest.raises(MachineError, match="the disk is full"), OutputFolder(small_disk) as out:
        with out.file("part.stl").open("wb", buffering=0) as file:
            while file.tell() < 200_000:
                try:
                    file.write(b"x" * 4096)
                except OSError:
                    break
        out.commit()
    assert listing(small_disk) == before


def test_without_posix_a_build_is_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has no statvfs, no geteuid, and no folder that can be opened."""
    opened, usage = os.open, shutil.disk_usage(tmp_path)

    def open_files(path: Path, flags: int, *more: int, **named: int) -> int:
        if os.path.isdir(path) and "dir_fd" not in named:  # which only rmtree gives
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        if Path(path).name == "knots.json":
            assert flags & os.O_RDWR  # a file synced there must be open for writing
        return opened(path, flags, *more, **named)

    for name in ("statvfs", "geteuid"):
        monkeypatch.delattr(os, name)
    monkeypatch.setattr("knotfab.base.disk._fcntl", None)
    monkeypatch.setattr(os, "open", open_files)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    build(tmp_path / "out", knots__json="good", note="kept")
    build(tmp_path / "out", knots__json="new")
    assert listing(tmp_path / "out") == {"knots.json": b"new", "note": b"kept"}
    usage = usage._replace(free=0)
    with pytest.raises(MachineError, match="the disk is full"):
        build(tmp_path / "out", knots__json="full")
    assert listing(tmp_path / "out") == {"knots.json": b"new", "note": b"kept"}


def test_work_is_only_there_while_open(tmp_path: Path) -> None:
    out = OutputFolder(tmp_path)
    with pytest.raises(RuntimeError):
        out.file("x")


def test_a_living_build_keeps_its_hidden_folder(tmp_path: Path) -> None:
    with OutputFolder(tmp_path) as out:
        out.write("knots.json", "new")
        dead = killed_build(tmp_path, note="of one that was killed")
        build(tmp_path, note="of another")
        assert out.file("knots.json").exists() and not dead.exists()
        out.commit()
    assert listing(tmp_path) == {"knots.json": b"new", "note": b"of another"}


@pytest.mark.slow
def test_two_builds_into_one_folder_do_not_mix(tmp_path: Path) -> None:
    def write(content: str) -> None:
        for _ in range(20):
            with OutputFolder(tmp_path) as out:
                for name in ("knots.json", "part.stl", "report.json"):
                    out.write(name, content)
                out.commit()

    threads = [threading.Thread(target=write, args=(c,)) for c in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = listing(tmp_path)
    assert set(found) == {"knots.json", "part.stl", "report.json"} and len({*found.values()}) == 1


@pytest.mark.parametrize("when", ["while it writes", "before it is moved"])
def test_a_folder_that_is_removed_meanwhile_is_no_success(tmp_path: Path, when: str) -> None:
    said = "removed while the build"
    with pytest.raises(MachineError, match=said) as caught, OutputFolder(tmp_path / "out") as out:
        out.write("knots.json", "new")
        shutil.rmtree(tmp_path / "out")
        if when == "while it writes":
            out.write("part.stl", "new")
        out.commit()
    assert caught.value.exit_code == 3 and not (tmp_path / "out").exists()


@pytest.mark.parametrize("code", [errno.EROFS, errno.EFBIG, errno.EIO])
def test_a_disk_that_fails_is_said_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    """The write that fails is ours, or that of a library with other words for it."""
    build(tmp_path, knots__json="good")
    before = listing(tmp_path)

    def fail(self: Path, data: bytes) -> int:
        raise OSError(code, os.strerror(code), *([str(self)] if code == errno.EIO else []))

    for own in (True, False):
        with pytest.raises(MachineError, match=os.strerror(code)), OutputFolder(tmp_path) as out:
            monkeypatch.setattr(Path, "write_bytes", fail)
            if own:
                out.write("knots.json", "new")
            raise RuntimeError("Error writing stream")
        monkeypatch.undo()
        assert listing(tmp_path) == before


# Moves that came with a folder, which a stranger wrote, are not done; those of a killed build are.


STEPS: dict[str, Callable[[Path], list[object]]] = {
    "absolute": lambda aside: [["new/evil", str(aside / "victim")]],
    "absolute, from anywhere": lambda aside: [[str(aside / "victim"), "part.stl"]],
    "upwards": lambda aside: [["new/evil", "../aside/victim"]],
    "upwards, from the hidden folder": lambda aside: [["../../aside/victim", "part.stl"]],
    "by a link": lambda aside: [["new/evil", "link/victim"]],
    "nested": lambda aside: [["new/evil", "deep/mine"]],
    "the other way round": lambda aside: [["new/evil", "deep\\mine"]],
    "another's file": lambda aside: [["evil", "mine"]],
    "removed": lambda aside: [[None, "mine"]],
    "a device": lambda aside: [["new/evil", "CON"], ["new/evil", "nul.txt"]],
    "a stream": lambda aside: [["new/evil", "mine:evil"]],
    "a null character": lambda aside: [["new/evil", "mine\0"]],
    "nothing": lambda aside: [["new/evil", ""], ["new/evil", "."], ["new/evil", ".."]],
    "no steps": lambda aside: [["new/evil"], 3, None, {"new/evil": "mine"}],
    "plain": lambda aside: [["new/mine", "mine"]],
}


def strangers_folder(place: Path, steps: list[object], wrap: Callable[[str], object]) -> Path:
    """A folder of somebody else, with moves in it, beside a file of the user."""
    for folder in (
        "aside",
        "from afar/deep",
        "from afar/.knotfab-x/new",
        "from afar/.knotfab-x/old",
    ):
        (place / folder).mkdir(parents=True)
    (place / "aside" / "victim").write_text("user")
    folder = place / "from afar"
    (folder / "link").symlink_to(place / "aside")
    for name in ("mine", "deep/mine", "report.json"):
        (folder / name).write_text("user")
    for name in ("evil", "new/evil", "new/mine", "old/victim", "old/mine"):
        (folder / ".knotfab-x" / name).write_text("evil")
    for name in ("moves.json", "undo.json"):
        (folder / ".knotfab-x" / name).write_text(json.dumps(wrap(json.dumps(steps))))
    return folder


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.slow
def test_moves_that_a_stranger_wrote_do_nothing(tmp_path: Path, kind: str) -> None:
    """They come as once written, under made-up seals, and under one of this user for another folder."""
    ours = killed_build(tmp_path / "ours", note="new")
    seal, signed = (ours / "seal").read_text(), json.loads((ours / "moves.json").read_text())
    wraps: list[tuple[str | None, Callable[[str], object]]] = [
        (None, json.loads), ("", lambda text: ["", text]), ("0" * 64, lambda text: ["0" * 64, text]),
        (seal, lambda text: [signed[0], text]), (seal, lambda _: signed),
    ]  # fmt: skip
    for number, (mark, wrap) in enumerate(wraps):
        place = tmp_path / f"{number}"
        folder = strangers_folder(place, STEPS[kind](place / "aside"), wrap)
        if mark is not None:
            (folder / ".knotfab-x" / "seal").write_text(mark)
        before = listing(place)
        mend(folder)
        assert listing(place) == before
        with OutputFolder(folder) as out:
            out.write("mine", "new")
            out.commit()
        assert listing(place) == before | {"from afar/mine": b"new"}


@pytest.mark.parametrize("kind", STEPS)
def test_moves_under_a_true_seal_stay_in_their_folder(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "place"
    folder = strangers_folder(place, STEPS[kind](place / "aside"), json.loads)
    hidden = folder / ".knotfab-x"
    text = (hidden / "moves.json").read_text()
    (hidden / "seal").write_text(_sign(hidden, ""))
    (hidden / "moves.json").write_text(json.dumps([_sign(hidden, text), text]))
    mend(folder)
    found = listing(place)
    assert found["aside/victim"] == b"user" == found["from afar/deep/mine"]
    own = {"plain": b"evil", "removed": None}  # such moves a build may write down
    assert found.get("from afar/mine") == own.get(kind, b"user")
    assert not any(name.casefold().startswith(("from afar/con", "from afar/nul")) for name in found)


@pytest.mark.parametrize("link", [".knotfab-x", "new", "old", "seal"])
def test_links_in_place_of_a_hidden_folder_are_not_followed(tmp_path: Path, link: str) -> None:
    hidden = killed_build(tmp_path / "out", part__stl="new")
    (tmp_path / "out" / "part.stl").write_text("old")
    at = hidden if link == ".knotfab-x" else hidden / link
    at.rename(tmp_path / "elsewhere")
    at.symlink_to(tmp_path / "elsewhere")
    before = listing(tmp_path)
    mend(tmp_path / "out")
    assert listing(tmp_path) == before


def test_moves_of_a_user_without_a_place_for_the_secret_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("KNOTFAB_STATE", str(tmp_path / "file" / "deeper"))
    build(tmp_path / "out", note="new")
    assert listing(tmp_path / "out") == {"note": b"new"}
    killed_build(tmp_path / "out", note="newer")
    monkeypatch.setattr("knotfab.base.moves._PASSING", b"of the next process")
    _kept_secret.cache_clear()
    before = listing(tmp_path)
    mend(tmp_path / "out")
    assert listing(tmp_path) == before
    _kept_secret.cache_clear()


def test_no_command_does_moves_that_a_stranger_wrote(tmp_path: Path) -> None:
    folder = strangers_folder(tmp_path, STEPS["absolute"](tmp_path / "aside"), json.loads)
    picture(folder / "cat.png", square(8))
    before = listing(tmp_path)
    cat, scene = folder / "cat.png", folder / "scene.toml"
    for call in (
        ("printers", folder), ("preview", cat), ("preview", folder), ("validate", folder),
        ("validate", f"--scene={scene}"), ("shadow", folder / "part.stl", "--scene", scene),
        ("compare", cat, folder), ("build", cat, "--wrong"), ("build", "--scene", scene),
        ("batch", folder, "--wrong"), ("tradeoff", cat, "--wrong"), ("studio", "--out", folder, "--wrong"),
    ):  # fmt: skip
        knotfab(*call)
        assert listing(tmp_path) == before, call
