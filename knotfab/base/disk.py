"""Reading, locking and writing files and folders, within the limits that a caller sets."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, TextIO

from knotfab.base.errors import why_of
from knotfab_formats import disk
from knotfab_formats.errors import InputError

# Windows has no such locks
_fcntl: Any = importlib.import_module("fcntl") if os.name == "posix" else None
MOST_TEXT = 64 * 2**20  # bytes of a file of settings or knots


def at_home(path: str | Path) -> Path:
    """Expand a leading ~ to the home folder, unless a file has that very name or there is no home."""
    return Path(path) if os.path.lexists(path) else Path(os.path.expanduser(path))


def own_folder(variable: str, usual: Callable[..., Path], homeless: str | None = None) -> Path:
    """Return the folder that the environment's `variable` names, else the user's folder that `usual` gives.

    Args:
        homeless: the path to use where there is no home; by default one that can hold nothing.
    """
    own = os.environ.get(variable)
    if own:
        return at_home(own)
    try:
        return usual("knotfab", appauthor=False)
    except RuntimeError:  # no HOME, and no user
        return Path(homeless) if homeless else Path(os.devnull, "knotfab")


def read_file(
    path: Path,
    what: str,
    noun: str = "file",
    most: int = MOST_TEXT,
    *,
    missing: str = "Check the path.",
    too_large: str = "Name another one.",
) -> bytes:
    """Read a file after checking that it is a regular file of acceptable size.

    Args:
        what, noun: its name and its kind in errors.
        most: limit on its size, bytes.
        missing, too_large: the remedies for a missing and for a larger file.

    Raises:
        InputError: there is none, it may not be read, or it is not a regular file, or too large.
    """
    try:
        state = path.stat()
        if stat.S_ISDIR(state.st_mode):
            raise InputError(what, "it is a directory", f"Name a {noun} in it.")
        if not stat.S_ISREG(state.st_mode):
            raise InputError(what, "it is not a regular file", f"Name a {noun}.")
        data = b""
        if state.st_size <= most:
            with path.open("rb") as file:
                data = file.read(most + 1)
        size = max(state.st_size, len(data))
        if size > most:
            told = f"{size / 2**20:.0f} MiB" if size >= 2**20 else f"{size / 2**10:.0f} KiB"
            why = f"the file has {told}, too much for a {noun}"
            raise InputError(what, why, too_large)
        return data
    except FileNotFoundError as error:
        raise InputError(what, "there is no such file", missing) from error
    except PermissionError as error:
        raise InputError(
            what, "it may not be read", "Change its permissions (chmod u+r) or copy it."
        ) from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise InputError(what, f"it cannot be read ({why_of(error)})", "Check the path.") from error


def read_text(path: Path, what: str, noun: str = "file", missing: str = "Check the path.") -> str:
    """Read a UTF-8 text file, with or without a byte order mark.

    Raises:
        InputError: as `read_file`; or it is not UTF-8.
    """
    data = read_file(path, what, noun, missing=missing)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(what, "it is not a UTF-8 text", f"Save the {noun} as UTF-8.") from error


def hold(folder: Path, wait: bool = False) -> int | None:
    """Lock a folder for this process until the returned file is closed or the process ends.

    Returns:
        None where the system has no such locks.

    Raises:
        BlockingIOError: another process holds it, and `wait` is False.
        OSError: there is no such folder.
    """
    if _fcntl is None:
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        _fcntl.flock(handle, _fcntl.LOCK_EX | (0 if wait else _fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(handle)
        raise
    except OSError:  # some network's file system
        os.close(handle)
        return None
    except BaseException:
        os.close(handle)
        raise
    return handle


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock during the block, after waiting for whoever else holds it."""
    handle = hold(folder, wait=True)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


@contextlib.contextmanager
def temporary_folder(prefix: str, place: Path | None = None) -> Iterator[Path]:
    """Yield a private folder that is removed after the block; first remove what killed processes left.

    Args:
        prefix: how the folder's name begins, and the names of those left behind.
        place: its parent; by default the system's folder for temporary files.
    """
    place = Path(tempfile.gettempdir()) if place is None else place
    for left in place.glob(f"{prefix}*"):
        with contextlib.suppress(OSError):  # it belongs to a living process, or may not be changed
            _remove_orphan(left)
    made = tempfile.TemporaryDirectory(prefix=prefix, dir=place, ignore_cleanup_errors=True)
    with made as own, locked(Path(own)):
        yield Path(own)


def _remove_orphan(folder: Path) -> None:
    """Remove a folder that no process holds."""
    found = folder.lstat()
    # a younger folder may belong to a process that has not locked it yet
    if not stat.S_ISDIR(found.st_mode) or time.time() - found.st_mtime < 60.0:
        return
    handle = hold(folder)
    if handle is not None:
        try:
            shutil.rmtree(folder)
        finally:
            os.close(handle)


# Writing one file.


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, and through no link (`knotfab_formats.disk`).

    Raises:
        InputError: it cannot be written.
    """
    try:
        disk.write_whole(path, content)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(
            f"--out {path}", f"it cannot be written ({reason})", "Choose another place."
        ) from error


def open_stream(path: str | Path, mode: Literal["w", "a"]) -> TextIO:
    """Open a file that grows line by line, to be read meanwhile; a terminal or a pipe by a link too.

    Raises:
        OSError: it cannot be written, or it is a link to a file (ELOOP).
        ValueError: the path holds a null character.
    """
    path = Path(path)
    flags = os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if mode == "w" else os.O_APPEND)
    if not path.is_symlink() or path.is_file() or not path.exists():
        flags |= getattr(os, "O_NOFOLLOW", 0)
    return open(os.open(path, flags, 0o666), mode, encoding="utf-8")
