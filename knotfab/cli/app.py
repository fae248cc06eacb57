"""Run a command: interrupts, error sentences, guarded streams, and the exit codes of the contract.

Nothing heavy is imported before interrupts are handled.
"""

from __future__ import annotations

import atexit
import codecs
import contextlib
import gc
import io
import os
import signal
import sys
import time
import unicodedata
from typing import Any

from knotfab_formats.errors import shown
from knotfab_formats.libraries import leave_out_settings_of_matplotlib


def main(arguments: list[str] | None = None, began: float | None = None) -> None:
    """Run the command line, and exit with its code.

    Args:
        arguments: by default those of the process.
        began: `time.perf_counter()` at which its times begin; by default the start of the process.
    """
    asked: list[int] = []

    def interrupt(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    code = 0
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # all end it as Ctrl-C does
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, interrupt)
        code = _run(arguments, began)
    except (Exception, KeyboardInterrupt) as error:
        # numba's compiler swallows an interrupt in its callbacks, and fails a step later
        if asked or isinstance(error, KeyboardInterrupt):
            stays = str(error) if isinstance(error, KeyboardInterrupt) else ""
            print(f"knotfab: interrupted; {stays or 'nothing was changed'}", file=sys.stderr)
            code = 130
        else:
            code = _print_error(error)

    why = why_unsaid()
    if why is not None:
        print(f"knotfab: {why}", file=sys.stderr)
        code = code or 3
    if arguments is None:
        atexit.register(_leave, code)
    gc.freeze()  # a last collection would take a second, and the process ends anyway
    sys.exit(code)


def _leave(code: int) -> None:
    """End the process with `code` after all other exit handlers, without Python's own ending.

    That would end by SIGINT after an interrupt while torch loads, and would let nanobind list what is still
    held: by an error's frames, or since the collector looked rarely while loops were compiled.
    """
    atexit.unregister(_leave)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


_LEAST_STACK = 1 << 20  # bytes


def set_environment() -> None:
    """Set environment variables that libraries read when they are first imported."""
    # products are small: threads that wait for each other cost time, ten times as much on a shared machine
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # searching all installed packages for plugins takes a tenth of a second
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    leave_out_settings_of_matplotlib()


def require_stack() -> None:
    """Require a stack on which compiled libraries do not crash without a word.

    Raises:
        MachineError: its limit is too low.
    """
    with contextlib.suppress(ImportError):  # Windows has no limits
        import resource

        held = resource.getrlimit(resource.RLIMIT_STACK)[0]
        if 0 <= held < _LEAST_STACK:
            from knotfab.base.errors import MachineError

            raise MachineError(
                "the stack of a process",
                f"its limit is {held // 1024} kB",
                "Raise it: ulimit -s 8192",
            )


def _run(arguments: list[str] | None, began: float | None) -> int:
    set_environment()
    # libraries load a tenth faster if their million permanent objects are seldom scanned
    gc.set_threshold(20_000, 20, 20)

    guard_streams()
    require_stack()
    from knotfab.cli.commands import app, build_help, call_clock

    if began is None and arguments is None:
        from knotfab.base.progress import process_age

        began = time.perf_counter() - process_age()
    call_clock.began = began
    from knotfab_formats.struck import pass_options, refuse_command

    words = sys.argv[1:] if arguments is None else arguments
    refuse_command(words)
    words = pass_options(words)
    build_help.every_option = "--help-all" in words
    words = ["--help" if word == "--help-all" else word for word in words]
    _refuse_dashes(words)
    _mend_named(words)
    code = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    return code if isinstance(code, int) else 0


def _refuse_dashes(arguments: list[str]) -> None:
    """Refuse an option whose hyphens a word processor turned into one long dash, unless it is a file."""
    from knotfab_formats.errors import InputError

    for word in arguments:
        bare = word.lstrip("-–—−")
        if word[:1] in tuple("–—−") and bare and not os.path.lexists(word):
            raise InputError(word, "it begins with a long dash", f"Write --{bare}")


def _mend_named(arguments: list[str]) -> None:
    """Finish the interrupted commits of killed builds in the folders that a call names."""
    from pathlib import Path

    from knotfab.base.moves import mend

    for word in arguments:
        place = word.partition("=")[2] if word.startswith("-") else word
        if os.path.lexists(place):
            mend(Path(place if os.path.isdir(place) else os.path.dirname(place) or "."))


def _print_error(error: Exception) -> int:
    """Print on standard error why the command ended, and return its exit code."""
    from knotfab.base.errors import explain_error, keep_traceback
    from knotfab_formats.errors import InputError

    if type(error).__module__.startswith("cyclopts"):
        print(f"knotfab: {_explain_misuse(error)} See: knotfab --help", file=sys.stderr)
        return InputError.exit_code
    known = explain_error(error) or keep_traceback(
        error, "-v" in sys.argv or "--verbose" in sys.argv
    )
    print(f"knotfab: {known}", file=sys.stderr)
    return known.exit_code


def _explain_misuse(error: Any) -> str:
    """Return cyclopts's complaint as a sentence, with suggestions for an option that was abbreviated."""
    if "-" in sys.argv[1:]:
        return "- (standard input) is not read: name a file, or write text:… for a word."
    token = getattr(error, "token", None)
    if type(error).__name__ == "UnknownOptionError" and token is not None:
        typed = (token.keyword or token.value).partition("=")[0]
        names = [name for one in error.argument_collection or () for name in one.names]
        begun = sorted({name for name in names if name.startswith(typed)})
        if begun and len(typed) > 2:
            return f"Unknown option: {typed}. Did you mean {' or '.join(begun)}?"
        from knotfab.pipeline.options import BuildOptions

        if typed.strip("-").replace("-", "_") in BuildOptions.__dataclass_fields__:
            return f"{typed} is an option of knotfab build, not of this command."
    said = str(error).strip()
    return said if said[-1:] in ".?!" else f"{said}."


# standard streams that never end the process

_PLAIN = {
    "°": " deg", "×": "x", "…": "...", "–": "-", "—": "-", "−": "-", "·": ".", "•": "*", "“": '"', "”": '"',
    "‘": "'", "’": "'", "„": '"', "│": "|", "─": "-", "━": "-", "╸": "-", "╺": "-", "→": "->", "←": "<-",
    "±": "+-", "≤": "<=", "≥": ">=", "µ": "u",
}  # fmt: skip
_ERRORS = "knotfab-plain"
_unsaid: list[OSError] = []  # why standard output could not be written


def _in_plain_signs(error: UnicodeError) -> tuple[str | bytes, int]:
    """Replace characters that an encoding lacks by plain ones, or else by their code."""
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
    """A file that redirects itself to nowhere when it can no longer be written."""

    def write(self, data: object) -> int:
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
    """Make standard output and error safe to print to.

    Characters that a console lacks are replaced ("³" by "3"). A reader that stops reading, as `| head -1`
    does, changes neither work nor exit code. After a full disk, `why_unsaid` tells the reason.
    """
    with contextlib.suppress(OSError):
        while (spare := os.open(os.devnull, os.O_RDWR)) <= 2:  # reopen closed standard streams
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
    """Say why part of standard output was lost; None if nothing was, or if its reader left."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    if not _unsaid:
        return None
    reason = _unsaid.pop().strerror
    return (
        f"standard output: it cannot be written ({reason}). Free some space; the command has ended."
    )
