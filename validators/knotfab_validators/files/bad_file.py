"""The one error that every reader refuses files with, and limits on what files may hold."""

from __future__ import annotations

import stat
from pathlib import Path

from knotfab_formats.errors import short

__all__ = ["DECIMAL_COMMA", "MOST_MM", "MOST_TRIANGLES", "BadFile", "read_bytes", "short"]

MOST_TRIANGLES = 20_000_000
"""The triangles that one file may have: more would not fit the memory of the machines meant for checks."""

MOST_MM = 1e7
"""Ten kilometres: coordinates beyond are nonsense or another unit, and squares of squares overflow."""

DECIMAL_COMMA = "its numbers have decimal commas, such as 1,5: export it with decimal points"


class BadFile(ValueError):
    """A file that cannot be read; the message is one sentence that names it."""


def read_bytes(path: Path, most: int) -> bytes:
    """Read the content of a regular file of at most `most` bytes; anything else would hang or never end.

    Raises:
        BadFile: it is a folder, a device or a pipe, is too large, or cannot be read.
    """
    try:
        about = path.stat()
        if stat.S_ISDIR(about.st_mode):
            raise BadFile(f"{path.name}: is a folder, not a file")
        if not stat.S_ISREG(about.st_mode):
            raise BadFile(f"{path.name}: is not a plain file")
        if about.st_size > most:
            raise BadFile(f"{path.name}: is larger than {most / 1e6:.6g} MB")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        why = getattr(error, "strerror", None) or error
        raise BadFile(f"{path.name}: cannot be read ({why})") from error
