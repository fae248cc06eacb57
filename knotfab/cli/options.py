"""The files that a call of the command line names."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, TextIO

from knotfab.base.disk import at_home
from knotfab.base.errors import InputError, needs_extra

__all__ = ["open_events", "open_page"]


@contextmanager
def open_events(name: str | None) -> Iterator[TextIO | None]:
    """Open the events of a build: nowhere, standard output for "-", or a file.

    Raises:
        InputError: the file cannot be written.
    """
    if name is None or name == "-":
        yield None if name is None else sys.stdout
        return
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open(name, "w", encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"--events {name}", "it cannot be written", "Name a file.") from error
        yield file


@contextmanager
def open_page(
    out: Path, say: Callable[[str], None], grace_s: int | None = None
) -> Iterator[tuple[IO[str], subprocess.Popen[str]]]:
    """A page in the browser that shows a build into `out`: where its events go, and the process it is of.

    That stays while a tab is open.

    Args:
        say: told the page's address, from a thread.
        grace_s: after the build's end, in which a page that is loaded anew may come back.

    Raises:
        MachineError: the studio's extra is not installed.
    """
    with needs_extra("--watch", "studio"):
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    command = [sys.executable, "-P", "-m", "knotfab.studio.watch", str(at_home(out).absolute())]
    child = subprocess.Popen(
        command if grace_s is None else [*command, str(grace_s)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, encoding="utf-8", start_new_session=True,
    )  # fmt: skip
    assert child.stdin is not None and child.stdout is not None
    told = child.stdout

    def announce() -> None:
        with told:
            address = told.readline().strip()
        if address:
            say(f"Watch it at {address}")

    threading.Thread(target=announce, daemon=True).start()
    try:
        yield child.stdin, child
    finally:
        with suppress(OSError):
            child.stdin.close()
