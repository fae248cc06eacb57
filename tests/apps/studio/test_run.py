"""The end of a studio with its build, and what its page makes of the ways to read a picture."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.studio_times import begin_build, open_studio

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")


# tests/apps/studio/test_server.py interrupts a studio at rest, tests/cli/test_summary.py a builder's build
@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="the signal is that of other systems")
def test_ctrl_c_ends_a_studio_and_its_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """`make studio-times` prints how soon."""
    monkeypatch.setenv("KNOTFAB_JOBS", "1")
    with open_studio() as (studio, page, address):
        begin_build(page, address)
        found = subprocess.run(["pgrep", "-P", str(studio.pid)], capture_output=True, text=True)
        children = [int(line) for line in found.stdout.split()]
        studio.send_signal(signal.SIGINT)
        assert studio.wait(60) == 0 and children
        assert not any(Path(f"/proc/{child}").exists() for child in children)
