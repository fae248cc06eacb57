"""A process that has loaded what builds need, and forks one for each call: many builds load it once.

Beside it stand validators, a process of their own as ever, that verify the parts of its builds one after the
other.

Request, a line of JSON on standard input: {"arguments": [...], "environment": {...}}, those of `knotfab`, and
"asked": whatever tells it from others.
Answer: {"code", "said", "asked"}: the exit code, negative a signal's number, and what went to standard error.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping, Sequence
from typing import IO

from knotfab.base.pool import Workers
from knotfab.cli.spare import load
from knotfab.verify.verifier import borrow, stand_by

_ENDS_WITH_PARENT = 1  # Linux, prctl: the signal that is sent when the parent ends


def main() -> None:
    """Build what is asked, one after the other, until nothing more is; asked to end, end the build first."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    with stand_by() as validators:
        load()
        _answer_calls(validators, answers)


def _answer_calls(validators: Workers, answers: IO[str]) -> None:
    """Fork a build for each line of standard input, and wait for it."""
    running: list[int] = []
    asked_to_end: list[int] = []

    def end(number: int, _: object) -> None:
        asked_to_end.append(number)
        for pid in running:
            os.kill(pid, signal.SIGTERM)  # it tidies up
        if not running:
            sys.exit(128 + number)

    signal.signal(signal.SIGTERM, end)
    for line in iter(sys.stdin.readline, ""):
        asked = json.loads(line)
        lent = validators.lend()
        with tempfile.TemporaryFile() as said:
            # until it is known whom to pass it to
            signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGTERM,))
            pid = os.fork()
            if pid == 0:
                os.close(answers.fileno())
                borrow(lent)
                _become(asked["arguments"], asked["environment"], said)
            running.append(pid)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM,))
            _, status = os.waitpid(pid, 0)
            running.clear()
            said.seek(0)
            heard = said.read().decode("utf-8", "replace")
        code = os.waitstatus_to_exitcode(status)
        if code < 0:  # nobody waits for what they verify now
            lent.terminate()
            lent.wait()
        answer = {"code": code, "said": heard, "asked": asked["asked"]}
        print(json.dumps(answer), file=answers, flush=True)
        if asked_to_end:
            return


def _become(arguments: Sequence[str], environment: Mapping[str, str], said: IO[bytes]) -> None:
    """Be `knotfab ARGUMENTS`, in a child that was forked, to its end."""
    code = 1
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM,))
        with contextlib.suppress(OSError, AttributeError):  # a stem that is killed takes it along
            ctypes.CDLL(None).prctl(_ENDS_WITH_PARENT, signal.SIGTERM)
        nothing = os.open(os.devnull, os.O_RDWR)
        for number, file in enumerate((nothing, nothing, said.fileno())):
            os.dup2(file, number)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = ["knotfab", *arguments]
        from knotfab.cli.app import main as run

        run(list(arguments), began=time.perf_counter())
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    main()
