"""Serve the studio to this machine alone, by routes and a socket."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import cache, partial
from inspect import isawaitable
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from pydantic import ConfigDict, TypeAdapter, ValidationError, validate_call
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from knotfab.apps.studio import pages
from knotfab.apps.studio.pages import RequestGuard
from knotfab.apps.studio.pictures import (
    LARGEST_BYTES,
    TooLargeError,
    keep_picture,
    keep_text,
    too_large,
)
from knotfab.apps.studio.session import Studio
from knotfab.base.disk import at_home
from knotfab.base.errors import explain_error, keep_traceback
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


def serve(studio: Studio, port: int, announce: Callable[[str], None]) -> None:
    """Serve until Ctrl-C.

    Args:
        announce: is called with the address, including its token, once the server is ready.

    Raises:
        InputError: the port is taken.
    """
    with _bind(port) as listening:
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(24)
        app = make_app(studio, token, port)
        config = uvicorn.Config(
            app, log_level="error", ws_max_size=2**16, timeout_graceful_shutdown=3
        )
        server = _Server(config, lambda: announce(f"http://{_HOST}:{port}/?token={token}"))
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
    """A server that calls `when_ready`."""

    def __init__(self, config: uvicorn.Config, when_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self.when_ready = when_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.when_ready()

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


_LARGEST_JSON = 64 * 2**10  # bytes of a call
# up to this size a refused body is read to its end, since otherwise the browser ignores the reply
_DRAINED_BYTES = 2 * 2**30
Answer = Callable[[Request], Awaitable[Response]]


def make_app(studio: Studio, token: str, port: int) -> Starlette:
    """Make the application.

    Args:
        token: must be in the first address that a browser opens.
        port: names the cookie.
    """
    shown: dict[str, Answer] = {
        "/": pages.show_page,
        "/static/{name}": pages.show_static,
        "/api/state": _show_state,
        "/api/choices": pages.show_choices,
        "/files/{where:path}/{name}": pages.show_file,
        "/pictures/{name}.png": pages.show_picture,
        "/preview/{panel:int}.png": pages.show_panel,
    }
    changing: dict[str, Answer] = {f"/api/{name}": partial(_call, name) for name in CALLS}
    changing["/api/pictures"] = _add_picture
    app = Starlette(
        routes=[
            *(Route(path, _answered(answer), methods=["GET"]) for path, answer in shown.items()),
            *(
                Route(path, _answered(answer), methods=["POST"])
                for path, answer in changing.items()
            ),
            WebSocketRoute("/live", _follow),
        ],
        middleware=[Middleware(RequestGuard, token=token, port=port)],
        exception_handlers={HTTPException: _explain_http},
        lifespan=_live,
    )
    app.state.studio = studio
    return app


@contextlib.asynccontextmanager
async def _live(app: Starlette) -> AsyncIterator[None]:
    await app.state.studio.open()
    try:
        yield
    finally:
        await app.state.studio.close()


def _answered(answer: Answer) -> Answer:
    """Wrap a handler so that every error becomes a sentence for the page."""

    async def answered(request: Request) -> Response:
        try:
            return await answer(request)
        except Exception as error:
            told = explain_error(error) or keep_traceback(error)
            code = 413 if isinstance(told, TooLargeError) else 500 if told.exit_code == 3 else 422
            return JSONResponse({"sentence": str(told).strip()}, code)

    return answered


async def _show_state(request: Request) -> Response:
    return JSONResponse(request.app.state.studio.describe())


async def _add_picture(request: Request) -> Response:
    studio: Studio = request.app.state.studio
    name = request.query_params.get("name", "picture")
    data = await _read_body(request, LARGEST_BYTES, name)
    async with studio.adding:
        kept = await asyncio.to_thread(keep_picture, data, name, studio.picture_folder)
        studio.add_picture(kept)
    return JSONResponse({"name": kept.name})


async def _call(name: str, request: Request) -> Response:
    act = CALLS[name]
    body = await _read_body(request, _LARGEST_JSON, "the call")
    studio = request.app.state.studio
    try:
        given = _OBJECT.validate_json(body or b"{}")
        done = act(studio, given) if act is Studio.set else _checked(act)(studio, **given)
        found = await done if isawaitable(done) else {}
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(str(part)[:40] for part in first["loc"])
        why = first["msg"].replace("\n", " ")
        why = f"{where}: {why[:1].lower()}{why[1:]}" if where else why[:1].lower() + why[1:]
        raise InputError("the call", why, "Load the page again.") from error
    return JSONResponse(found)


async def _read_body(request: Request, largest: int, what: str) -> bytes:
    """Read a request's body.

    Raises:
        InputError: it is larger than `largest`, or was cut off.
    """
    what = what[:80]
    told = request.headers.get("content-length", "")
    if told.isdecimal() and (len(told) > 12 or int(told) > _DRAINED_BYTES):
        raise too_large(what, largest)
    parts, size = [], 0
    try:
        async for part in request.stream():
            size += len(part)
            if size <= largest:
                parts.append(part)
            elif size > _DRAINED_BYTES:
                break
    except ClientDisconnect as error:
        raise InputError(what, "it broke off on its way", "Hand it in again.") from error
    if size > largest:
        raise too_large(what, largest)
    return b"".join(parts)


async def _follow(socket: WebSocket) -> None:
    """Send a tab all messages until it is closed; what it sends is ignored."""
    studio: Studio = socket.app.state.studio
    await socket.accept()
    listener = studio.listen()

    async def send() -> None:
        while True:
            for text in await listener.next():
                await socket.send_text(text)

    sending = asyncio.create_task(send())
    try:
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass
    finally:
        studio.listeners.discard(listener)
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await sending


async def _explain_http(_: Request, error: Exception) -> Response:
    code = error.status_code if isinstance(error, HTTPException) else 400
    return PlainTextResponse("The studio has nothing at this address.", code)


async def _add_text(studio: Studio, text: str) -> dict[str, Any]:
    async with studio.adding:
        font = str(studio.settings.values.get("font", "")) or None
        kept = await asyncio.to_thread(keep_text, text, studio.picture_folder, font)
        studio.add_picture(kept)
    return {"name": kept.name}


# what the page may call below /api/; the keys of a call's body are the parameters
CALLS: dict[str, Callable[..., Any]] = {
    "text": _add_text,
    "settings": Studio.set,
    "build": Studio.press,
    "stop": Studio.stop,
    "open": Studio.open_build,
}


_OBJECT = TypeAdapter(dict[str, Any])


@cache
def _checked(act: Callable[..., Any]) -> Callable[..., Any]:
    """Return `act` with its arguments checked, as they come from a page."""
    return validate_call(config=ConfigDict(strict=True, arbitrary_types_allowed=True))(act)
