"""Serve the studio on this machine alone, open it, and end every process with it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable, Coroutine
from pathlib import Path

import uvicorn

from knotfab.base.disk import at_home
from knotfab.base.errors import InputError
from knotfab.files.folder import OutputFolder
from knotfab.studio.broadcast import Broadcast
from knotfab.studio.server import make_app
from knotfab.studio.session import Studio

__all__ = ["open_in_browser", "run_studio", "serve"]

_HOST = "127.0.0.1"


def run_studio(port: int, open_page: bool, folder: Path) -> None:
    """Serve until Ctrl-C.

    Args:
        port: 0 for any that is free. folder: where pictures and builds are kept.

    Raises:
        InputError: the port is taken, or the folder cannot be written.
    """
    with OutputFolder(folder):  # says so now if it cannot be written
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
    """Serve until Ctrl-C, or until that has come to its end.

    Args:
        announce: told of the address, its token in it, once it is answered at.

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
        # where nobody (nohup) wants it otherwise, it closes with its terminal, and ends its build
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
            signal.signal(signal.SIGHUP, lambda *_: server.leave())
        with contextlib.suppress(KeyboardInterrupt):  # it has tidied up, and passes the signal on
            asyncio.run(server.serve(sockets=[listening]))


def open_in_browser(address: str) -> None:
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


class _Server(uvicorn.Server):
    """The server, which says when it is ready, and ends when `until` does."""

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

    def leave(self) -> None:
        self.should_exit = True


def _bind(port: int) -> socket.socket:
    listening = socket.socket()
    if os.name != "nt":  # there it would let two studios share a port
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
