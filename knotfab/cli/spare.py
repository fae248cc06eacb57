"""A build's process that has loaded everything beforehand, and waits for its call on standard input."""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import time

from knotfab.doctor import run_loops
from knotfab.report.report_html import load_template


def load() -> None:
    """Load what every build needs, to the page of its report."""
    for name in ("knotfab.pipeline", "knotfab.piece", "knotfab.preview.survey", "trimesh"):
        importlib.import_module(name)
    run_loops()
    load_template()


def wait_for_call() -> None:
    """Load what a build needs, read its arguments, a list as a line of JSON, and run the command line."""
    load()
    line = sys.stdin.readline()
    if not line.strip():  # the studio ended
        return
    began = time.perf_counter()
    sys.argv = ["knotfab", *json.loads(line)]
    from knotfab.cli.app import main

    main(began=began)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        wait_for_call()
