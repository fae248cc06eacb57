"""The solid modeller is loaded beside the search, and only when a mount asks for it."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from knotfab.mount.prefetch import prefetch_modeller
assert "cadquery" not in sys.modules
thread = prefetch_modeller()
thread.join()
assert "cadquery" in sys.modules
"""


@pytest.mark.slow
def test_it_is_loaded_in_a_thread() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_goes_wrong_is_left_to_the_stage_that_needs_it() -> None:
    broken = "import sys; sys.modules['cadquery'] = None" + SCRIPT.split("thread.join()")[
        0
    ].replace('assert "cadquery" not in sys.modules', "")
    done = subprocess.run(
        [sys.executable, "-c", broken + "thread.join()"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
