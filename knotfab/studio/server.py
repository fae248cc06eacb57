"""The studio's pages and sockets, as an ASGI application."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from knotfab.errors import InputError, KnotfabError
from knotfab.files.folder import REJECTED
from knotfab.report.report_html import VIEWER
from knotfab.scene.catalogue import materials, printers
from knotfab.studio.guard import REPORT_POLICY, RequestGuard
from knotfab.studio.pictures import LARGEST_BYTES, keep_picture, keep_text, too_large
from knotfab.studio.session import Studio, child_of

__all__ = ["make_app"]

_STATIC = Path(__file__).parent / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".json": "application/json",
    ".pdf": "application/pdf",
    ".3mf": "model/3mf",
    ".stl": "model/stl",
    ".glb": "model/gltf-binary",
}
_LARGEST_JSON = 64 * 2**10
_DRAINED = (
    8  # times what is allowed is read and dropped, so that a browser hears why it was refused
)
Handler = Callable[[Request], Awaitable[Response]]


def make_app(studio: Studio, token: str, hosts: tuple[str, ...]) -> Starlette:
    """The application.

    Args:
        token: what the address must have once. hosts: what the Host header may be, with the port.
    """
    # a picture is added after the other, so that each finds a name of its own
    adding = asyncio.Lock()

    async def page(_: Request) -> Response:
        return _serve(_STATIC / "index.html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        if name == "viewer.js":
            return _serve(VIEWER)
        known = {path.name: path for path in _STATIC.iterdir() if path.suffix != ".html"}
        return _serve(known[name]) if name in known else _lost()

    async def state(_: Request) -> Response:
        return JSONResponse(studio.describe())

    async def choices(_: Request) -> Response:
        made = [
            {"name": name, "process": p.process, "volume_mm": p.build_volume_mm}
            for name, p in printers().items()
        ]
        return JSONResponse({"printers": made, "materials": list(materials())})

    async def add_picture(request: Request) -> Response:
        name = request.query_params.get("name", "picture")
        data = await _read_body(request, LARGEST_BYTES, name)
        async with adding:
            kept = await asyncio.to_thread(keep_picture, data, name, studio.picture_folder)
            studio.add_picture(kept, request.query_params.get("beside") == "1")
        return JSONResponse({"name": kept.name})

    async def add_text(request: Request) -> Response:
        given = await _read_json(request)
        text = str(given.get("text", ""))
        async with adding:
            kept = await asyncio.to_thread(keep_text, text, studio.picture_folder)
            studio.add_picture(kept, given.get("beside") is True)
        return JSONResponse({"name": kept.name})

    async def choose(request: Request) -> Response:
        given = await _read_json(request)
        studio.choose([str(name) for name in given.get("names", [])])
        return JSONResponse({})

    async def set_(request: Request) -> Response:
        studio.set(await _read_json(request))
        return JSONResponse({})

    async def build(request: Request) -> Response:
        given = await _read_json(request)
        studio.press(go_on=given.get("go_on") is True)
        return JSONResponse({})

    async def stop(_: Request) -> Response:
        studio.stop()
        return JSONResponse({})

    async def picture(request: Request) -> Response:
        found = studio.pictures.get(request.path_params["name"])
        return _lost() if found is None else Response(found.shown, media_type="image/png")

    async def preview(_: Request) -> Response:
        if not studio.preview_png:
            return _lost()
        return Response(studio.preview_png, media_type="image/png")

    async def file(request: Request) -> Response:
        where, name = request.path_params["where"], request.path_params["name"]
        rejected = where.endswith(f"/{REJECTED}")
        folder = studio.folder_of(where.removesuffix(f"/{REJECTED}"))
        path = None if folder is None else _find(folder, name, rejected)
        return _lost() if path is None else _serve(path, whole=True)

    async def live(socket: WebSocket) -> None:
        await socket.accept()
        listener = studio.listen()

        async def send() -> None:
            while True:
                for text in await listener.next():
                    await socket.send_text(text)

        sending = asyncio.create_task(send())
        try:
            with contextlib.suppress(WebSocketDisconnect):
                while True:
                    await socket.receive_text()  # nothing is asked for here; it ends with the page
        finally:
            studio.listeners.discard(listener)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        await studio.open()
        try:
            yield
        finally:
            await studio.close()

    seen = [
        Route("/", page),
        Route("/static/{name}", static),
        Route("/api/state", state),
        Route("/api/choices", choices),
        Route("/files/{where:path}/{name}", file),
        WebSocketRoute("/live", live),
    ]
    changing = [
        Route("/api/pictures", add_picture, methods=["POST"]),
        Route("/api/text", add_text, methods=["POST"]),
        Route("/api/choose", choose, methods=["POST"]),
        Route("/api/settings", set_, methods=["POST"]),
        Route("/api/build", build, methods=["POST"]),
        Route("/api/stop", stop, methods=["POST"]),
        Route("/pictures/{name}.png", picture),
        Route("/preview.png", preview),
    ]
    return Starlette(
        routes=seen if studio.watching else [*seen, *changing],
        middleware=[Middleware(RequestGuard, token=token, hosts=hosts)],
        exception_handlers={
            KnotfabError: _explain,
            HTTPException: _explain_http,
            Exception: _explain_fault,
        },
        lifespan=lifespan,
    )


def _serve(path: Path, whole: bool = False) -> Response:
    """A file by its type; of a build (`whole`) what is no picture and no report is saved, not shown."""
    if not path.is_file():
        return _lost()
    kind = _TYPES.get(path.suffix, "application/octet-stream")
    if not whole:
        return FileResponse(path, media_type=kind)
    if path.name == "report.html":
        return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})
    shown = path.suffix == ".png"
    if path.suffix in (".html", ".svg"):
        kind = "application/octet-stream"
    saved = None if shown else f"{path.parent.name}-{path.name}"
    return FileResponse(path, media_type=kind, filename=saved)


def _find(build: Path, name: str, rejected: bool) -> Path | None:
    """A file of a build's folder, by its name there."""
    folder = child_of(build, REJECTED) if rejected else build
    path = None if folder is None else child_of(folder, name)
    return path if path is not None and path.is_file() else None


def _lost() -> Response:
    return PlainTextResponse("There is no such file in the studio.", 404)


async def _read_body(request: Request, largest: int, what: str) -> bytes:
    """The body, if it is no larger than that.

    Raises:
        InputError: it is, or it broke off.
    """
    parts, size = [], 0
    try:
        async for part in request.stream():
            size += len(part)
            if size <= largest:
                parts.append(part)
            elif size > _DRAINED * largest:
                break
    except ClientDisconnect as error:
        raise InputError(what[:80], "it broke off on its way", "Hand it in again.") from error
    if size > largest:
        raise too_large(what[:80])
    return b"".join(parts)


async def _read_json(request: Request) -> dict[str, Any]:
    try:
        found = json.loads(await _read_body(request, _LARGEST_JSON, "the call") or b"{}")
    except ValueError as error:
        raise InputError("the call", "it is not JSON", "Load the page again.") from error
    if not isinstance(found, dict):
        raise InputError("the call", "it is no table", "Load the page again.")
    return found


async def _explain(_: Request, error: Exception) -> Response:
    return JSONResponse({"sentence": str(error)}, 422)


async def _explain_http(_: Request, error: Exception) -> Response:
    code = error.status_code if isinstance(error, HTTPException) else 400
    return PlainTextResponse("The studio has nothing at this address.", code)


async def _explain_fault(_: Request, error: Exception) -> Response:
    kind = type(error).__name__
    return JSONResponse(
        {"sentence": f"The studio made a mistake ({kind}): load the page again."}, 500
    )
