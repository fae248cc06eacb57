"""Errors that a user can act on: each names the thing, the reason and the remedy.

KnotfabError                    (exit code 2 unless a subclass says otherwise)
 ├── InputError            2    the picture, scene or call is wrong
 ├── SceneError            1    the scene cannot be met (infeasible), or a required check failed
 └── MachineError          3    this machine lacks something a required check needs
"""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager

from knotfab_formats.errors import InputError, KnotfabError, shown

# an option in a sentence, with its value where one follows and the sentence does not go on
OPTION = re.compile(
    r"--([a-z][a-z-]*)"
    r"""(?:[ =](?!(?:and|or|is|if|to|for|takes|names|keeps)\b)("[^"]*"|[^\s,;()]*[^\s,;().:]))?"""
)
# faults that a call cannot mend by naming another file
_OF_MACHINE = {
    "ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EIO", "EMFILE", "ENFILE", "ENOMEM", "EAGAIN", "ESTALE",
}  # fmt: skip
_LACKS_MEMORY = re.compile(
    "start new thread|cannot allocate memory|bad_alloc|out of memory|memory allocation|failed to map"
)
_MORE_MEMORY = "Close other programs, use --accuracy draft, or a machine with 4 GB or more."


def why_of(error: OSError | ValueError) -> str:
    """Return the system's reason for an error with a file, in words."""
    said = error.strerror if isinstance(error, OSError) else None
    return shown(said or error)


class SceneError(KnotfabError):
    """The scene cannot be met: the message says which constraint binds, and where."""

    exit_code = 1


class MachineError(KnotfabError):
    """This machine lacks something that a required step needs."""

    exit_code = 3


@contextmanager
def needs_extra(what: str, extra: str) -> Iterator[None]:
    """Turn a failed import into the error that `what` needs `knotfab[extra]` installed.

    Raises:
        MachineError: a package is missing.
    """
    try:
        yield
    except ImportError as error:
        why = f"it needs {error.name or extra}, which is not installed"
        raise MachineError(what, why, f"pip install 'knotfab[{extra}]'") from error


def explain_error(error: Exception) -> KnotfabError | None:
    """Explain an error of the machine or the input and its remedy; None for a fault of the program."""
    if isinstance(error, KnotfabError):
        return error
    if isinstance(error, MemoryError) or _LACKS_MEMORY.search(str(error).lower()):
        return MachineError("the memory", "this machine has no more that it may use", _MORE_MEMORY)
    if isinstance(error, RecursionError):
        return InputError("the input", "something in it is nested too deep", "Make it simpler.")
    if isinstance(error, OSError):
        return _explain_os(error)
    if isinstance(error, ValueError) and str(error).startswith("embedded null"):
        return InputError("a path", "it holds a null character", "Check the call.")
    if isinstance(error, ImportError):
        return MachineError(
            f"the library {error.name or 'that is needed'}",
            f"it cannot be loaded ({shown(error)})",
            "knotfab doctor says what this machine lacks.",
        )
    return None


def _explain_os(error: OSError) -> KnotfabError:
    try:
        os.getcwd()
    except OSError:
        remedy = "Go to a folder that is there, and call again."
        return InputError("the current folder", "it has been removed", remedy)
    what = "the system" if error.filename is None else os.fsdecode(error.filename)
    name = errno.errorcode.get(error.errno or 0, "")
    if name in _OF_MACHINE or error.filename is None:
        remedy = (
            "Free some space, or choose another disk." if name != "EMFILE" else "Raise ulimit -n."
        )
        return MachineError(what, f"it fails ({why_of(error)})", remedy)
    remedy = "Check the path, and who may read and write it."
    return InputError(what, f"it cannot be used ({why_of(error)})", remedy)


def keep_traceback(error: Exception, verbose: bool = False) -> KnotfabError:
    """Report an unforeseen error, and keep its traceback in a file, or show it where `verbose`."""
    import tempfile
    import traceback

    whole = "".join(traceback.format_exception(error))
    place = "with what stands above"
    if verbose:
        import sys

        sys.stderr.write(whole)
    else:
        try:
            with tempfile.NamedTemporaryFile(
                "w",
                prefix="knotfab-",
                suffix=".txt",
                delete=False,
                encoding="utf-8",
                errors="replace",
            ) as file:
                file.write(whole)
            place = f"with {file.name}"
        except OSError:
            place = "with what the same call says with --verbose"
    said = shown(" ".join(str(error).split()))
    return MachineError(
        "a mistake of knotfab's own",
        f"{type(error).__name__}{f' ({said[:200]})' if said else ''}; earlier results stay as they were",
        f"Please report it where you got knotfab from, {place}, and the call",
    )


# Numbers and lengths as people write them: `180`, `180mm`, `18 cm`, `7in`, `1,5`. Errors give mm.

_UNITS_MM = {"": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0}
_UNITS_MM |= dict.fromkeys(("in", "inch", "inches", '"', "″"), 25.4)
_PLAIN = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:e[+-]?\d+)?"
_LENGTH = re.compile(rf"({_PLAIN})\s*(\D*)", re.IGNORECASE)
# "1,500" is 1.5 to some readers and 1500 to others
_TWO_WAYS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


def read_number(what: str, text: str) -> float:
    """Parse a number with a decimal point or comma.

    Args:
        what: names it in the message, such as `--threshold 0,3`.

    Raises:
        InputError: it is not a number, or is ambiguous.
    """
    plain = text.strip()
    if not re.fullmatch(_PLAIN, plain, re.IGNORECASE):
        raise InputError(what, "it is no number", "Give one such as 0.5.")
    point = plain.replace(",", ".")
    if _TWO_WAYS.fullmatch(plain):
        why = f"{plain} may be {float(point):g} or {plain.replace(',', '')}"
        raise InputError(what, why, "Write it without a comma.")
    return float(point)


def read_length(what: str, text: str, remedy: str = "") -> float:
    """Parse a length with or without a unit (mm, cm, m, in) into mm.

    Args:
        remedy: how the error's sentence ends.

    Raises:
        InputError: the text is not a length.
    """
    remedy = remedy or "Give millimetres, or a length with its unit, such as 180, 18cm or 7in."
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise InputError(what, "it is no length", remedy)
    number, unit = found.groups()
    if unit.strip().lower() not in _UNITS_MM:
        raise InputError(what, f"there is no unit {unit.strip()}", "Use mm, cm, m or in.")
    value = read_number(what, number) * _UNITS_MM[unit.strip().lower()]
    if not math.isfinite(value):
        raise InputError(what, "it is no length", remedy)
    return value
