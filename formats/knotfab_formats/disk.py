"""The one way to write a file outside a private folder: whole or not at all, and through no link."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

# O_BINARY and O_NOFOLLOW are not everywhere: O_EXCL alone refuses a name that exists, links too
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL
_FLAGS = _NEW | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file in full beside its place, under a name that nobody can foresee, then move it there.

    A link in its place is replaced, and what it names stays as it is.

    Raises:
        OSError: it cannot be written; nothing is left behind.
        ValueError: the path holds a null character.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.parent / f".knotfab-{secrets.token_hex(8)}"
    handle = os.open(beside, _FLAGS, 0o666)
    try:
        with open(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise
