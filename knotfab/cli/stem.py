"""A process that has loaded what builds need, and forks one for each call: many builds load it once.

Request, a line of JSON on standard input: {"command": [...], "arguments": [...], "environment": {...}}.
`arguments` are those of `knotfab`; `command` is what runs them where a process cannot fork.
Answer: {"code", "said"}: the exit code, negative a signal's number, and what went to standard error.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping, Sequence
from typing import IO, Any

from knotfab.cli.spare import load

NO_FORK = "KNOTFAB_NO_FORK"
# what Apple's frameworks start when they are loaded does not live on in a child
FORKS = hasattr(os, "fork") and sys.platform != "darwin" and NO_FORK not in os.environ


def main() -> None:
    """Build what is asked, one after the other, until nothing more is; asked to end, end the build first."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    if FORKS:
        load()
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
        with tempfile.TemporaryFile() as said:
            code = _build(asked, said, running)
            said.seek(0)
            heard = said.read().decode("utf-8", "replace")
        print(json.dumps({"code": code, "said": heard}), file=answers, flush=True)
        if asked_to_end:
            return


def _build(asked: dict[str, Any], said: IO[bytes], running: list[int]) -> int:
    """The exit code of one build, whose process is in `running` while it runs."""
    if not FORKS:
        command = [*asked["command"], *asked["arguments"]]
        with subprocess.Popen(command, env=asked["environment"], stderr=said) as child:
            running.append(child.pid)
            code = child.wait()
            running.clear()
            return code
    # until it is known whom to pass it to
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGTERM,))
    pid = os.fork()
    if pid == 0:
        _become(asked["arguments"], asked["environment"], said)
    running.append(pid)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM,))
    _, status = os.waitpid(pid, 0)
    running.clear()
    return os.waitstatus_to_exitcode(status)


def _become(arguments: Sequence[str], environment: Mapping[str, str], said: IO[bytes]) -> None:
    """Be `knotfab ARGUMENTS`, in a child that was forked, to its end."""
    code = 1
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM,))
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
