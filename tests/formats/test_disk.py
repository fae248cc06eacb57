"""A stranger's folder full of links: nothing is written through one, under its own name or a helper's."""

import errno
import os
from pathlib import Path

import pytest
import trimesh
from command import knotfab, picture, square

from knotfab.base.disk import open_stream
from knotfab_formats.disk import write_whole

SCENE = "[[views]]\npicture = 'a.png'\n"
CALLS = {
    # the links that stand in the folder, and the call that once wrote through one of them
    "preview": (["x.png", ".x.png.new"], ["preview", "a.png", "--out", "x.png"]),
    "validate": (["part-failures.png", "failures.png"], ["validate", "part.stl"]),
    "failures": (["f.png"], ["validate", "part.stl", "--failures", "f.png"]),
    "shadow": (
        ["x.png", ".x-new.png"],
        ["shadow", "part.stl", "--scene", "scene.toml", "--out", "x.png"],
    ),
    "events": (["x.jsonl"], ["build", "a.png", "--events", "x.jsonl"]),
}


@pytest.mark.parametrize("case", CALLS)
@pytest.mark.slow
def test_no_command_writes_through_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    links, call = CALLS[case]
    folder = tmp_path / "stranger"
    folder.mkdir()
    monkeypatch.chdir(folder)
    victim = tmp_path / "victim.txt"
    victim.write_text("mine")
    picture(Path("a.png"), square())
    Path("scene.toml").write_text(SCENE)
    cube = trimesh.creation.box((10, 10, 10))
    cube.faces = cube.faces[1:]  # open, so that a required check fails
    Path("part.stl").write_bytes(cube.export(file_type="stl"))
    for name in links:
        Path(name).symlink_to("../victim.txt")
    before = set(os.listdir())
    done = knotfab(*call)
    assert "mistake" not in done.err, done
    assert victim.read_text() == "mine"
    assert set(os.listdir()) == before  # no helper's file is left, and validate adds none
    if case in ("preview", "failures", "shadow"):
        assert (
            Path(call[-1]).read_bytes().startswith(b"\x89PNG") and not Path(call[-1]).is_symlink()
        )


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "deep" / "a.txt"
    write_whole(file, b"first")
    write_whole(file, b"second")
    assert file.read_bytes() == b"second" and list(file.parent.iterdir()) == [file]
    umask = os.umask(0)
    os.umask(umask)
    assert file.stat().st_mode & 0o777 == 0o666 & ~umask  # as any program's new file
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "folder", b"third")
    with pytest.raises(ValueError):
        write_whole(tmp_path / "nul\0l", b"third")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["deep", "folder"]


def test_a_stream_follows_links_to_terminals_alone(tmp_path: Path) -> None:
    for target in (tmp_path / "victim.txt", tmp_path / "none"):
        link = tmp_path / "link"
        link.symlink_to(target)
        with pytest.raises(OSError) as refused:
            open_stream(link, "w")
        assert refused.value.errno == errno.ELOOP and not target.exists()
        link.unlink()
    (tmp_path / "terminal").symlink_to("/dev/null")
    open_stream(tmp_path / "terminal", "w").close()
    for text in ("a\n", "b\n"):
        with open_stream(tmp_path / "journal", "a") as file:
            file.write(text)
    assert (tmp_path / "journal").read_text() == "a\nb\n"
