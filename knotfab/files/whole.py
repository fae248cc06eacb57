"""One file written whole or not at all."""

from __future__ import annotations

import contextlib
from pathlib import Path

from knotfab.base.disk import require_within
from knotfab.base.errors import InputError

__all__ = ["write_whole"]


def write_whole(path: Path, content: bytes) -> None:
    """Write beside, then move into place: never half a file.

    Raises:
        InputError: it cannot be written.
    """
    require_within(path, f"--out {path}")
    beside = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(content)
        beside.replace(path)
    except (OSError, ValueError) as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(
            f"--out {path}", f"it cannot be written ({reason})", "Choose another place."
        ) from error
