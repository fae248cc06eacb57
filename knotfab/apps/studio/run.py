"""Serve the studio, or the page of `knotfab build --watch`, to this machine alone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Coroutine
from pathlib import Path
from types import FrameType
from typing import TextIO

import uvicorn

from knotfab.apps.studio.broadcast import Broadcast, Event
from knotfab.apps.studio.server import make_app
from knotfab.apps.studio.session import Studio
from knotfab.base.disk import at_home
from knotfab.base.folder import OutputFolder
from knotfab.base.limited import end_copies
from knotfab_formats.errors import InputError

_HOST = "127.0.0.1"


def run_studio(port: int, open_page: bool, folder: Path) -> None:
    """Serve the studio until Ctrl-C.

    Args:
        port: 0 for any free one.
        folder: where pictures and builds are kept.

    Raises:
        InputError: the port is taken, or the folder cannot be written.
    """
    with OutputFolder(folder):  # refuses a folder that cannot be written
        pass
    folder = at_home(folder).resolve()

    def announce(address: str) -> None:
        print(f"knotfab studio: {address}\nBuilds go to {folder}. Ctrl-C ends it.", flush=True)
        if open_page:
            open_in_browser(address)

    serve(Studio(folder), port, announce)
    with contextlib.suppress(OSError):  # the terminal may be gone
        print("\nThe studio is closed.", flush=True)


def serve(
    studio: Broadcast,
    port: int,
    announce: Callable[[str], None],
    until: Callable[[], Coroutine[None, None, None]] | None = None,
) -> None:
    """Serve until Ctrl-C, or until the coroutine `until` ends.

    Args:
        announce: is called with the address, including its token, once the server is ready.

    Raises:
        InputError: the port is taken.
    """
    with _bind(port) as listening:
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(24)
        hosts = (f"{_HOST}:{port}", f"localhost:{port}")
        app = make_app(studio, token, hosts)
        config = uvicorn.Config(
            app, log_level="error", ws_max_size=2**16, timeout_graceful_shutdown=3
        )
        server = _Server(config, lambda: announce(f"http://{_HOST}:{port}/?token={token}"), until)
        # unless started by nohup, it ends with its terminal, and its build too
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
            signal.signal(signal.SIGHUP, lambda *_: server.leave())
        with contextlib.suppress(KeyboardInterrupt):  # it has tidied up, and passes the signal on
            asyncio.run(_serve(server, listening))


async def _serve(server: uvicorn.Server, listening: socket.socket) -> None:
    try:
        await server.serve(sockets=[listening])
    finally:
        end_copies()  # threads that wait for them would keep the process


def open_in_browser(address: str) -> None:
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


class _Server(uvicorn.Server):
    """A server that calls `when_ready`, and ends when `until` does."""

    def __init__(
        self,
        config: uvicorn.Config,
        when_ready: Callable[[], None],
        until: Callable[[], Coroutine[None, None, None]] | None,
    ) -> None:
        super().__init__(config)
        self.when_ready, self.until = when_ready, until
        self.waiting: asyncio.Task[None] | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.when_ready()
        if self.until is not None:
            self.waiting = asyncio.create_task(self.until())
            self.waiting.add_done_callback(lambda _: self.leave())

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        end_copies()  # requests that wait for them are answered, and keep nothing
        super().handle_exit(sig, frame)

    def leave(self) -> None:
        self.should_exit = True


def _bind(port: int) -> socket.socket:
    listening = socket.socket()
    if os.name != "nt":  # where it would let two studios share a port
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or "it is no port"
        raise InputError(
            f"--port {port}", reason.lower(), "Leave it out for any that is free."
        ) from error
    return listening


_GRACE_S = 10  # for a reloaded page to come back after the build's end
_UNKNOWN = "The build ended without a result; the terminal says why."


class WatchedBuild(Broadcast):
    """A build of the command line, which can only be watched. `out` is its folder."""

    watching = True

    def __init__(self, out: Path) -> None:
        super().__init__()
        self.begin(out, out.name)

    async def follow(self, events: TextIO, grace_s: int = _GRACE_S) -> None:
        """Pass the events on until they end, and then wait until the last tab is closed."""
        end: Event = {}
        while line := await asyncio.to_thread(events.readline):
            with contextlib.suppress(ValueError):  # cut off when its build died
                event = json.loads(line)
                end = event if event["event"] == "end" else end
                self.hear(event)
        self.end(end.get("exit_code", 2), "" if end else _UNKNOWN)
        self.tell_state()
        alone = 0
        while alone < grace_s:
            await asyncio.sleep(1)
            alone = 0 if self.listeners else alone + 1


def watch(out: Path, events: TextIO, grace_s: int = _GRACE_S) -> None:
    """Show a build in the browser by its events, until they end and the last tab is closed."""
    studio = WatchedBuild(out)

    def announce(address: str) -> None:
        print(address, flush=True)
        open_in_browser(address)

    serve(studio, 0, announce, lambda: studio.follow(events, grace_s))


if __name__ == "__main__":
    watch(Path(sys.argv[1]), sys.stdin, *(int(grace) for grace in sys.argv[2:]))
