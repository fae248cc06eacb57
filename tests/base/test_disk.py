"""What is read is asked for kind and size first; nobody needs a home; a lock is one's own."""

import os
import pwd
import time
from pathlib import Path

import pytest
from command import knotfab

from knotfab.base.disk import at_home, hold, own_folder, read_file, read_text, temporary_folder
from knotfab_formats.errors import InputError


def test_kind_and_size_are_asked_before_a_file_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")  # whose reader would wait for ever
    (tmp_path / "loop").symlink_to("loop")
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(5 * 2**30)
    for name, why in {
        "pipe": "not a regular file",
        "/dev/zero": "not a regular file",
        "": "it is a directory",
        "loop": "cannot be read",
        "sparse": "the file has 5120 MiB, too much for a file",
        "none": "there is no such file",
        "a" * 300: "cannot be read",
        "nul\0l": "cannot be read",
    }.items():
        with pytest.raises(InputError, match=why):
            read_file(tmp_path / name, name)
    (tmp_path / "marked").write_bytes(b"\xef\xbb\xbftext")
    assert read_text(tmp_path / "marked", "it") == "text"
    assert read_file(tmp_path / "marked", "it", most=7) == b"\xef\xbb\xbftext"
    with pytest.raises(InputError, match="too much"):
        read_file(tmp_path / "marked", "it", most=6)


def test_nobody_needs_a_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`docker run -u 1234` gives no HOME, and its user no line in the list of users."""

    def none(_: object) -> None:
        raise KeyError("uid not found")

    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "KNOTFAB_DATA"):
        monkeypatch.delenv(name, raising=False)
    for name in ("getpwuid", "getpwnam"):
        monkeypatch.setattr(pwd, name, none)
    monkeypatch.chdir(tmp_path)
    done = knotfab("printers")
    assert done.code == 0 and "$KNOTFAB_DATA/printers/NAME.toml" in done.out
    done = knotfab("preview", "~cat.png")
    assert done.code == 2 and "~cat.png: there is no such file" in done.err
    assert os.listdir(tmp_path) == []  # and none named "~"


def test_a_file_that_is_called_like_a_home_is_that_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/someone")
    assert at_home("~/a.png") == Path("/home/someone/a.png")
    assert at_home("~nobody-of-that-name.png") == Path("~nobody-of-that-name.png")
    (tmp_path / "~").touch()
    assert at_home("~") == Path("~")
    monkeypatch.setenv("OF_MINE", str(tmp_path))
    assert own_folder("OF_MINE", lambda *_, **__: Path("unused")) == tmp_path


def test_a_folder_is_held_by_one(tmp_path: Path) -> None:
    first = hold(tmp_path)
    assert first is not None
    with pytest.raises(BlockingIOError):
        hold(tmp_path)
    os.close(first)
    second = hold(tmp_path)
    assert second is not None
    os.close(second)


@pytest.mark.skipif(os.name == "nt", reason="there are no such locks")
def test_folders_of_killed_processes_go_and_of_living_stay(tmp_path: Path) -> None:
    old = time.time() - 3600
    killed, alive, young, other = (tmp_path / n for n in ("tool-a", "tool-b", "tool-c", "else"))
    for folder in (killed, alive, young, other):
        folder.mkdir()
        (folder / "file").write_text("")
        if folder != young:
            os.utime(folder, (old, old))
    (tmp_path / "tool-link").symlink_to(other)
    held = hold(alive)
    with temporary_folder("tool-", tmp_path) as own:
        assert own.parent == tmp_path and own.is_dir()
        assert not killed.exists() and alive.exists() and young.exists() and other.exists()
        os.utime(own, (old, old))
        with temporary_folder("tool-", tmp_path):
            assert own.is_dir()
    assert not own.exists()
    os.close(held or 0)
