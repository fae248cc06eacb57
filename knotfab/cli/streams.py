"""Standard output and error that fail nobody: signs that a console lacks, readers that go, full disks."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import sys
import unicodedata

from knotfab.base.errors import shown

__all__ = ["guard_streams", "why_unsaid"]

_PLAIN = {
    "°": " deg", "×": "x", "…": "...", "–": "-", "—": "-", "−": "-", "·": ".", "•": "*", "“": '"', "”": '"',
    "‘": "'", "’": "'", "„": '"', "│": "|", "─": "-", "━": "-", "╸": "-", "╺": "-", "→": "->", "←": "<-",
    "±": "+-", "≤": "<=", "≥": ">=", "µ": "u",
}  # fmt: skip
_ERRORS = "knotfab-plain"
_unsaid: list[OSError] = []  # why standard output could not be written


def _in_plain_signs(error: UnicodeError) -> tuple[str | bytes, int]:
    """Replace signs that an encoding lacks by plain ones, or else by their number."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    plain = ""
    for sign in error.object[error.start : error.end]:
        like = unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
        plain += (
            _PLAIN.get(sign) or like or shown(sign).encode("ascii", "backslashreplace").decode()
        )
    return plain, error.end


class _Patient(io.FileIO):
    """A file descriptor that goes on where it can be written no more: what is said then is lost."""

    def write(self, data: object) -> int:
        """Write, or note why not, and from then on write to nowhere."""
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError as error:
            if self.fileno() == 1 and not isinstance(error, BrokenPipeError):
                _unsaid.append(error)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return memoryview(data).nbytes  # type: ignore[arg-type]


def guard_streams() -> None:
    """Let no word of this process end it.

    A console gets "3" for "³" where it lacks that. A reader that stops reading, as `| head -1` does, changes
    neither work nor exit code. Where the disk under standard output is full, `why_unsaid` knows.
    """
    with contextlib.suppress(OSError):
        while (spare := os.open(os.devnull, os.O_RDWR)) <= 2:  # one that was closed is nowhere
            pass
        os.close(spare)
    codecs.register_error(_ERRORS, _in_plain_signs)
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper) and stream is getattr(sys, f"__{name}__"):
            if stream.isatty():
                stream.reconfigure(errors=_ERRORS)
                continue
            stream.flush()
            patient = io.BufferedWriter(_Patient(number, "wb", closefd=False))
            guarded = io.TextIOWrapper(
                patient, stream.encoding, _ERRORS, line_buffering=number == 2
            )
            setattr(sys, name, guarded)


def why_unsaid() -> str | None:
    """Say why some of standard output was lost, in a sentence; None where nothing was, or nobody listens."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    if not _unsaid:
        return None
    reason = _unsaid.pop().strerror
    return (
        f"standard output: it cannot be written ({reason}). Free some space; the command has ended."
    )
