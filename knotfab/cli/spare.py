"""A build's process that has loaded everything beforehand, and waits for its call on standard input."""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import time


def load() -> None:
    """Load what every build needs, to the drawing of its part."""
    for name in (
        "knotfab.pipeline",
        "knotfab.piece",
        "knotfab.preview.survey",
        "knotfab.report.shading",
        "trimesh",
    ):
        importlib.import_module(name)


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
