"""Moving what was built into its folder: all of it, or none, whatever ends the process in between.

The moves are written down before the first. Whoever uses the folder next finishes those that a killed process
left, or undoes them where they cannot be finished (`mend`). Each step may be done twice.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from knotfab.base.disk import hold, locked

__all__ = ["HIDDEN", "REJECTED", "Step", "is_moving", "mend", "mend_locked", "move_all", "sync"]

REJECTED = "rejected"
HIDDEN = ".knotfab-"
_DO, _UNDO = "moves.json", "undo.json"

# from a place in the hidden folder (None: nothing comes) to one in DIR
Step = tuple[str | None, str]


def move_all(folder: Path, hidden: Path, steps: Sequence[Step]) -> None:
    """Move files from `hidden`, a folder in `folder`, to their places, and what they replace to hidden/old.

    Raises:
        OSError: one cannot be moved; those before it were undone.
    """
    draft = hidden / "draft"
    draft.write_text(json.dumps(steps), encoding="utf-8")
    sync(draft)
    os.replace(draft, hidden / _DO)
    sync(hidden)
    try:
        for step in steps:
            _do(folder, hidden, step)
        sync(folder)
    except BaseException:
        _undo(folder, hidden, steps)
        raise
    (hidden / _DO).unlink()


def is_moving(hidden: Path) -> bool:
    """Tell whether a hidden folder is still needed: its moves could be neither finished nor undone."""
    return (hidden / _DO).exists() or (hidden / _UNDO).exists()


def mend(folder: Path) -> None:
    """Finish what killed processes were moving into `folder`, and remove what else they left there."""
    with contextlib.suppress(OSError):
        if any(name.startswith(HIDDEN) for name in os.listdir(folder)):
            with locked(folder):
                mend_locked(folder)


def mend_locked(folder: Path) -> None:
    """Do the same, by one who has locked `folder`."""
    for hidden in sorted(folder.glob(f"{HIDDEN}*")):
        with contextlib.suppress(OSError):  # another's who still lives, or nobody's to change
            handle = hold(hidden)
            if handle is None:
                continue
            try:
                _mend_one(folder, hidden)
                shutil.rmtree(hidden)
            finally:
                os.close(handle)


def _mend_one(folder: Path, hidden: Path) -> None:
    if (hidden / _DO).is_file():
        steps = json.loads((hidden / _DO).read_text("utf-8"))
        try:
            for step in steps:
                _do(folder, hidden, step)
            sync(folder)
        except OSError:
            _undo(folder, hidden, steps)
        (hidden / _DO).unlink(missing_ok=True)
    elif (hidden / _UNDO).is_file():
        _undo(folder, hidden, json.loads((hidden / _UNDO).read_text("utf-8")))


def _do(folder: Path, hidden: Path, step: Step) -> None:
    source, name = step
    kept = hidden / "old" / name
    if source is not None and not os.path.lexists(hidden / source):
        return  # it was moved before
    if os.path.lexists(folder / name) and not os.path.lexists(kept):
        _keep(folder / name, kept)
    if source is not None:
        os.replace(hidden / source, folder / name)
    elif name != REJECTED:
        (folder / name).unlink(missing_ok=True)


def _undo(folder: Path, hidden: Path, steps: Sequence[Step]) -> None:
    """Put back what was there; what was to be there goes back into the hidden folder."""
    if (hidden / _DO).is_file():
        os.replace(hidden / _DO, hidden / _UNDO)
    for source, name in reversed(steps):
        if source is not None and not os.path.lexists(hidden / source):
            with contextlib.suppress(FileNotFoundError):
                os.replace(folder / name, hidden / source)
        if os.path.lexists(hidden / "old" / name):
            os.replace(hidden / "old" / name, folder / name)
    sync(folder)
    (hidden / _UNDO).unlink()


def _keep(path: Path, aside: Path) -> None:
    """Give a second name for a file, so that it can be put back; a move where links are unknown."""
    if path.name == REJECTED:
        os.replace(path, aside)
        return
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{path.name} is a directory", str(path))
    try:
        os.link(path, aside, follow_symlinks=False)
    except (OSError, NotImplementedError):
        os.replace(path, aside)


def sync(path: Path) -> None:
    """Have the system write a file, or a folder's entries, to the disk."""
    folder = path.is_dir()
    try:
        handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    except PermissionError:
        if folder:  # Windows opens no folder
            return
        raise
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # folders on some file systems
            raise
    finally:
        os.close(handle)
