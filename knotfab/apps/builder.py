"""The worker process of batch and studio: runs whole builds by the command line's own `main`.

It builds one picture after another, with all modules loaded and validators running. A request is
{"arguments": those of `knotfab`}, the answer {"code": exit code, "said": standard error}. If the arguments
ask for events, these are sent before the answer.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import Any, TextIO

from knotfab.cli.app import main, set_environment
from knotfab.pipeline.verifier import load_early


def prepare() -> Iterator[None]:
    """Load what every build needs, in steps, down to the template of the report."""
    set_environment()
    with load_early(keep=True):
        pass
    for name in ("knotfab.pipeline.build", "knotfab.pipeline.finish", "knotfab.design.survey"):
        importlib.import_module(name)
        yield
    from knotfab.apps.doctor import run_loops
    from knotfab.report.page import load_template

    run_loops()
    yield
    load_template()


def answer(request: dict[str, Any], told: TextIO) -> dict[str, Any]:
    """Run `knotfab ARGUMENTS` in this process. SIGTERM ends it as Ctrl-C would."""
    code: int | str | None = 130
    sys.argv = ["knotfab", *request["arguments"]]
    outer, own = sys.stdout, os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        sys.stdout = told
        try:
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            with load_early(keep=True):
                main(request["arguments"], began=time.perf_counter())
        except SystemExit as left:
            code = left.code
        except KeyboardInterrupt:  # before `main` handles it
            pass
        finally:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            sys.stdout = outer
            sys.stderr.flush()
            os.dup2(own, 2)
            os.close(own)
            gc.unfreeze()  # `main` freezes, as its process is about to end
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
        said.seek(0)
        heard = said.read().decode("utf-8", "replace")
    return {"code": code if isinstance(code, int) else int(code is not None), "said": heard}
