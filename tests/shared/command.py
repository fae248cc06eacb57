"""The command line called in this process, and small pictures for it to read."""

import contextlib
import io
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from knotfab.base import moves
from knotfab.base.folder import OutputFolder
from knotfab.cli.app import main


@dataclass(frozen=True)
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str


def knotfab(*arguments: str | Path) -> Done:
    """Run `knotfab ARGUMENTS` without a process of its own; nothing but SystemExit may come out."""
    out, err = io.StringIO(), io.StringIO()
    code: object = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(a) for a in arguments])
        except SystemExit as left:
            code = left.code
    assert isinstance(code, int)
    return Done(code, out.getvalue(), err.getvalue())


def refuse(code: int, *arguments: str | Path) -> str:
    """The one line that a wrong call leaves on stderr."""
    done = knotfab(*arguments)
    assert done.code == code, done
    assert done.out == ""
    assert done.err.startswith("knotfab: ") and done.err.count("\n") == 1, done.err
    assert done.err.rstrip()[-1] not in ":,;"
    return done.err


def picture(path: Path, ink: NDArray[np.bool_]) -> Path:
    """Write `ink` (H, W) as black on white."""
    Image.fromarray(np.where(ink, 0, 255).astype(np.uint8)).save(path)
    return path


def square(size: int = 64) -> NDArray[np.bool_]:
    """A square in the middle of a frame of `size` pixels."""
    ink = np.zeros((size, size), dtype=bool)
    ink[size // 4 : -size // 4, size // 4 : -size // 4] = True
    return ink


def killed_build(folder: Path, **files: str) -> Path:
    """Leave files as a build does that is killed before it moves the first; its hidden folder."""
    out = OutputFolder(folder).__enter__()
    for name, content in files.items():
        out.write(name.replace("__", "."), content)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, contextlib.suppress(KeyboardInterrupt):
        patch.setattr(moves, "_do", killed)
        patch.setattr(moves, "_undo", killed)
        out.commit()
    assert out._held is not None
    os.close(out._held)
    return out.work.parent


@contextlib.contextmanager
def small_disk(place: Path, size: str) -> Iterator[Path]:
    """A tmpfs of `size` mounted at `place`; the test is skipped where none can be mounted."""
    mount = shutil.which("mount")
    if os.geteuid() != 0 or mount is None:
        pytest.skip("mounting a small tmpfs needs root")
    place.mkdir()
    call = [mount, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    mounted = subprocess.run(call, capture_output=True)
    if mounted.returncode:
        pytest.skip(f"a tmpfs cannot be mounted: {mounted.stderr.decode().strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)
