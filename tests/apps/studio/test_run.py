"""The end of a studio with its build, and what its page makes of the ways to read a picture."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.cookiejar import CookieJar
from pathlib import Path
from urllib.request import HTTPCookieProcessor, OpenerDirector, Request, build_opener

import pytest

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")


@contextmanager
def open_studio() -> Iterator[tuple[subprocess.Popen[str], OpenerDirector, str]]:
    """Yield a studio in a folder of its own, a page that it knows, and its address."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "-m", "knotfab", "studio", "--no-open", "--out", folder]
        with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as studio:
            assert studio.stdout is not None
            found = re.search(r"(http\S+)/\?token=\S+", studio.stdout.readline())
            assert found is not None
            page = build_opener(HTTPCookieProcessor(CookieJar()))
            page.addheaders = [("Origin", found[1])]
            page.open(found[0]).read()
            try:
                yield studio, page, found[1]
            finally:
                studio.kill()


def begin_build(page: OpenerDirector, address: str) -> None:
    """Let the studio build a letter finely, and wait until its search runs."""
    for path, body in (("text", {"text": "A"}), ("settings", {"accuracy": "fine"}), ("build", {})):
        page.open(Request(f"{address}/api/{path}", json.dumps(body).encode())).read()
    while b'"search"' not in page.open(f"{address}/api/state").read():
        time.sleep(0.1)


# tests/apps/studio/test_server.py interrupts a studio at rest, tests/cli/test_summary.py a builder's build
@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="the signal is that of other systems")
def test_ctrl_c_ends_a_studio_and_its_build(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KNOTFAB_JOBS", "1")
    with open_studio() as (studio, page, address):
        begin_build(page, address)
        found = subprocess.run(["pgrep", "-P", str(studio.pid)], capture_output=True, text=True)
        children = [int(line) for line in found.stdout.split()]
        studio.send_signal(signal.SIGINT)
        assert studio.wait(60) == 0 and children
        assert not any(Path(f"/proc/{child}").exists() for child in children)
