"""Times of a studio that reads a picture without end, or builds: to answer another, and to end on Ctrl-C.

python -m benchmarks.studio_times
"""

from __future__ import annotations

import gzip
import json
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.cookiejar import CookieJar
from urllib.error import URLError
from urllib.request import HTTPCookieProcessor, OpenerDirector, Request, build_opener

ROUNDS = 5
AIMS_S = {"answers another request": 1.0, "ends after Ctrl-C": 3.0}
ENDLESS = gzip.compress(b" " * 3_000_000 + b"<svg xmlns='http://www.w3.org/2000/svg'/>")
NESTED = (
    f"<svg xmlns='http://www.w3.org/2000/svg'><style>x {'g ' * 12}rect{{fill:red}}</style>"
    f"{'<g>' * 40}<rect width='9' height='9'/>{'</g>' * 40}</svg>"
).encode()


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


def drop(page: OpenerDirector, address: str, picture: bytes) -> None:
    """Hand a picture in that is never read, and wait until the studio is at it."""

    def hand_in() -> None:
        with suppress(URLError, OSError):
            page.open(Request(f"{address}/api/pictures?name=it.svg", picture))

    threading.Thread(target=hand_in, daemon=True).start()
    time.sleep(3.0)


def begin_build(page: OpenerDirector, address: str) -> None:
    """Let the studio build a letter finely, and wait until its search runs."""
    for path, body in (
        ("text", {"text": "A"}),
        ("choose", {"name": "A"}),
        ("settings", {"accuracy": "fine"}),
        ("build", {}),
    ):
        page.open(Request(f"{address}/api/{path}", json.dumps(body).encode())).read()
    while b'"search"' not in page.open(f"{address}/api/state").read():
        time.sleep(0.1)


def main() -> None:
    worst = dict.fromkeys(AIMS_S, 0.0)
    for picture in (ENDLESS, NESTED, None):
        with open_studio() as (studio, page, address):
            if picture is None:
                begin_build(page, address)
            else:
                drop(page, address, picture)
            for _ in range(ROUNDS):
                began = time.perf_counter()
                page.open(f"{address}/api/state").read()
                answered = time.perf_counter() - began
                worst["answers another request"] = max(worst["answers another request"], answered)
            began = time.perf_counter()
            studio.send_signal(signal.SIGINT)
            studio.wait(60)
            ended = time.perf_counter() - began
            worst["ends after Ctrl-C"] = max(worst["ends after Ctrl-C"], ended)
    for what, seconds in worst.items():
        print(f"{what}: {seconds:.2f} s at most; the aim is {AIMS_S[what]:g} s")


if __name__ == "__main__":
    main()
