"""The child's side of every worker: `python -P serve.py MODULE [WORD …]` answers lines of JSON.

MODULE has `answer(request, told)`, which returns a dict and may write lines of JSON to `told` before.
It may have `begin(*words)`, which runs before any answer, and `prepare(*words)`, which loads what answers
need, a step at each `yield`: steps run while no request waits, so that a parent can start this process
early. `knotfab.base.pool` starts and feeds it, and learns which libraries had a part in an answer. This
file imports only the formats, since it also runs the validators, which share no code with the maker.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from queue import SimpleQueue
from typing import Any

from knotfab_formats.libraries import (
    defer_idle_modules,
    leave_out_settings_of_matplotlib,
    recording,
)


def main(module: str, *words: str) -> None:
    """Answer requests with a module until the parent closes the pipe or dies."""
    # Libraries in C++ write to standard output as they like: the answers have a stream of their own.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    leave_out_settings_of_matplotlib()
    defer_idle_modules()
    gc.set_threshold(20_000, 20, 20)  # the libraries make a million things that stay
    requests: SimpleQueue[bytes] = SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_listen, args=(requests, busy), daemon=True).start()
    try:
        service: Any = importlib.import_module(module)
        if hasattr(service, "begin"):
            service.begin(*words)
        steps: Iterator[object] = iter(
            service.prepare(*words) if hasattr(service, "prepare") else ()
        )
        while True:
            while requests.empty() and next(steps, steps) is not steps:
                pass
            busy.clear()
            line = requests.get()
            busy.set()
            if not line:
                break
            with recording() as parts:
                found = service.answer(json.loads(line), answers)
            answer = {"answer": found, "parts": parts}
            with contextlib.suppress(BrokenPipeError):
                answers.write(json.dumps(answer, default=lambda array: array.tolist()) + "\n")
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # the thread that listens would keep the interpreter from ending
    gc.freeze()  # a parent waits for the end: what is left is not looked through for it


def _listen(requests: SimpleQueue[bytes], busy: threading.Event) -> None:
    """Queue each request; once no more can come, end the process if it still works on an answer."""
    with open(0, "rb", closefd=False) as lines:
        for line in lines:
            requests.put(line)
    requests.put(b"")
    if busy.is_set():
        os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main(*sys.argv[1:])
