"""The command line called in this process, and small pictures for it to read."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

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


def picture(path: Path, ink: NDArray[np.bool_]) -> Path:
    """Write `ink` (H, W) as black on white."""
    Image.fromarray(np.where(ink, 0, 255).astype(np.uint8)).save(path)
    return path


def square(size: int = 64) -> NDArray[np.bool_]:
    """A square in the middle of a frame of `size` pixels."""
    ink = np.zeros((size, size), dtype=bool)
    ink[size // 4 : -size // 4, size // 4 : -size // 4] = True
    return ink
