"""Moves of a finished build into its folder: all or none, even if the process is killed halfway."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import hmac
import json
import os
import re
import secrets
import shutil
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from knotfab.base.disk import hold, locked, own_folder

REJECTED = "rejected"
HIDDEN = ".knotfab-"
_DO, _UNDO, _SEAL = "moves.json", "undo.json", "seal"
_PLAIN = re.compile(r"[^./\\:\0-\x1f][^/\\:\0-\x1f]*")  # a name of this folder, on every system
# files that Windows has everywhere
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)\s*(\.|\Z)")
_PASSING = secrets.token_bytes(32)  # the secret of a process whose user can keep none

# from a place in the hidden folder (None: nothing comes) to one in DIR
Step = tuple[str | None, str]


def move_all(folder: Path, hidden: Path, steps: Sequence[Step]) -> None:
    """Move files from `hidden`, a folder in `folder`, to their places, and what they replace to hidden/old.

    Raises:
        OSError: one cannot be moved; those before it were undone.
    """
    if not all(map(_is_plain, steps)):
        raise ValueError(f"no plain names: {steps}")
    draft = hidden / "draft"
    text = json.dumps(steps)
    draft.write_text(json.dumps([_sign(hidden, text), text]), encoding="utf-8")
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
    """Return whether a hidden folder is still needed: its moves could be neither finished nor undone."""
    return (hidden / _DO).exists() or (hidden / _UNDO).exists()


def mend(folder: Path) -> None:
    """Finish the moves that killed processes began in `folder`, and remove what else they left there."""
    with contextlib.suppress(OSError):
        if any(name.startswith(HIDDEN) for name in os.listdir(folder)):
            with locked(folder):
                mend_locked(folder)


def mend_locked(folder: Path) -> None:
    """Do what `mend` does; the caller holds the folder's lock."""
    for hidden in sorted(folder.glob(f"{HIDDEN}*")):
        with contextlib.suppress(OSError):  # it belongs to a living process, or may not be changed
            if not stat.S_ISDIR(hidden.lstat().st_mode):
                continue
            handle = hold(hidden)
            if handle is None:
                continue
            try:
                if _is_sealed(hidden):
                    _mend_one(folder, hidden)
                    remove(hidden)
                else:
                    hidden.rmdir()  # where nothing is in it: its process was killed as it made it
            finally:
                os.close(handle)


def seal(hidden: Path) -> None:
    """Mark a hidden folder, just made, as this user's own."""
    (hidden / _SEAL).write_text(_sign(hidden, ""), encoding="ascii")


def remove(hidden: Path) -> None:
    """Remove a hidden folder, its seal last, so that leftovers of a killed process are recognised."""
    for path in hidden.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != _SEAL:
            path.unlink()
    shutil.rmtree(hidden)


def _is_sealed(hidden: Path) -> bool:
    """Return whether this user's build made a hidden folder that contains no link."""
    for name, kind in ((_SEAL, stat.S_ISREG), ("new", stat.S_ISDIR), ("old", stat.S_ISDIR)):
        path = hidden / name
        if os.path.lexists(path) and not kind(path.lstat().st_mode):
            return False
    if not (hidden / _SEAL).is_file():
        return False
    with (hidden / _SEAL).open("rb") as file:
        return hmac.compare_digest(file.read(200), _sign(hidden, "").encode())


def _sign(hidden: Path, text: str) -> str:
    """Sign a text for this folder, as only this user can."""
    from platformdirs import user_state_path

    secret = _kept_secret(own_folder("KNOTFAB_STATE", user_state_path) / "moves.key")
    where = [os.path.realpath(hidden), hidden.stat().st_ino, text]
    return hmac.new(secret, json.dumps(where).encode(), hashlib.sha256).hexdigest()


@functools.cache
def _kept_secret(place: Path) -> bytes:
    """Return the secret kept in a file, created if missing; this process's if none can be kept."""
    with contextlib.suppress(OSError):
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            draft = place.with_name(f"moves-{secrets.token_hex(8)}.key")
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            with os.fdopen(os.open(draft, flags, 0o600), "wb") as out:
                out.write(_PASSING)
            with contextlib.suppress(FileExistsError):  # another process was faster
                os.link(draft, place)
            draft.unlink()
        found = place.read_bytes()
        if len(found) == len(_PASSING):
            return found
    return _PASSING


def _read_steps(hidden: Path, name: str) -> list[Step]:
    """Read the moves that this user's build recorded; return none if the file holds anything else."""
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        said, text = json.loads((hidden / name).read_text("utf-8"))
        if hmac.compare_digest(said, _sign(hidden, text)):
            steps = json.loads(text)
            if all(map(_is_plain, steps)):
                return [(source, name) for source, name in steps]
    return []


def _is_plain(step: Any) -> bool:
    """Return whether a step leads from a hidden folder's new files to a name in its own folder."""
    source, name = step
    if not isinstance(name, str) or not _PLAIN.fullmatch(name) or _DEVICES.match(name):
        return False
    return source is None or source == (f"new/{name}" if name != REJECTED else "new")


def _mend_one(folder: Path, hidden: Path) -> None:
    if (hidden / _DO).is_file():
        steps = _read_steps(hidden, _DO)
        try:
            for step in steps:
                _do(folder, hidden, step)
            sync(folder)
        except OSError:
            _undo(folder, hidden, steps)
        (hidden / _DO).unlink(missing_ok=True)
    elif (hidden / _UNDO).is_file():
        _undo(folder, hidden, _read_steps(hidden, _UNDO))


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
    """Put earlier files back, and new ones into the hidden folder."""
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
    """Keep a file under a second name to restore it; it is moved where links are unsupported."""
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
    """Flush a file, or a folder's entries, to the disk."""
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
