"""Serve the studio's page, pictures and files, and guard it against foreign requests."""

from __future__ import annotations

import asyncio
import re
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request, cookie_parser
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
)
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from knotfab.apps.studio.builds import child_of, plain_files
from knotfab.apps.studio.fields import FIELDS, usual_numbers
from knotfab.apps.studio.pictures import thumbnail
from knotfab.base.moves import REJECTED
from knotfab.picture.fonts import list_families
from knotfab.picture.source import PICTURE_SUFFIXES
from knotfab.report.page import VIEWER
from knotfab.scene.catalogue import Kind, materials, printers, title_of
from knotfab_formats.piece import Printer

_STATIC = Path(__file__).parent / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".gif": "image/gif",
    ".json": "application/json",
    ".pdf": "application/pdf",
    ".3mf": "model/3mf",
    ".stl": "model/stl",
    ".glb": "model/gltf-binary",
}
_LOST = "There is no such file in the studio."


async def show_page(_: Request) -> Response:
    return _show(_STATIC / "index.html")


async def show_static(request: Request) -> Response:
    name = request.path_params["name"]
    if name == "viewer.js":
        return _show(VIEWER)
    return _show(_STATIC / name if name in plain_files(_STATIC) and name != "index.html" else None)


async def show_choices(_: Request) -> Response:
    """Send the choices of the menus."""
    return JSONResponse(
        {
            "printers": _titled("printer", printers()),
            "materials": _titled("material", materials()),
            "fonts": await asyncio.to_thread(list_families),
            "labels": FIELDS,
            "usual": {"printer": Printer().name, **usual_numbers()},
            "suffixes": sorted(PICTURE_SUFFIXES),
        }
    )


def _titled(kind: Kind, found: Mapping[str, Any]) -> list[dict[str, object]]:
    return [{"name": name, "title": title_of(kind, name)} for name, one in found.items()]


async def show_picture(request: Request) -> Response:
    shown = thumbnail(request.app.state.studio.picture_folder, request.path_params["name"])
    return _show(child_of(shown.parent, shown.name))


async def show_panel(request: Request) -> Response:
    panels, number = request.app.state.studio.panels, request.path_params["panel"]
    if number >= len(panels):
        return PlainTextResponse(_LOST, 404)
    return Response(panels[number], media_type="image/png")


async def show_file(request: Request) -> Response:
    """Send a file of a build: pictures and the report to be shown, everything else to be saved."""
    where, name = request.path_params["where"], request.path_params["name"]
    rejected = where.endswith(f"/{REJECTED}")
    folder = request.app.state.studio.folder_of(where.removesuffix(f"/{REJECTED}"))
    if folder is not None and rejected:
        folder = child_of(folder, REJECTED)
    path = None if folder is None else child_of(folder, name)
    if path is None or not path.is_file():
        return _show(None)
    if path.name == "report.html":
        return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})
    if path.suffix in (".png", ".gif"):
        return _show(path)
    kind = "application/octet-stream" if path.suffix in (".html", ".svg") else _type(path)
    return FileResponse(path, media_type=kind, filename=f"{path.parent.name}-{path.name}")


def _show(path: Path | None) -> Response:
    if path is None or not path.is_file():
        return PlainTextResponse(_LOST, 404)
    return FileResponse(path, media_type=_type(path))


def _type(path: Path) -> str:
    return _TYPES.get(path.suffix, "application/octet-stream")


# only the studio's own page, in the browser that was given the token, may talk to it

_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
# a report has inline scripts, and so is sandboxed in an origin of its own
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; frame-ancestors 'self'"
)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
# redirects from the studio's own origin, so that the browser sends the strict cookie
_LET_IN = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" '
    'content="0; url=/"><link rel="icon" href="data:,"><title>knotfab studio</title><p>'
    '<a href="/">Go on to the studio</a></p></html>'
)
_SAFE = ("GET", "HEAD")
_LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
NO_TOKEN = "This address lacks its token: open the address that knotfab studio printed."
FOREIGN = "This request comes from elsewhere: open the address that knotfab studio printed."


class RequestGuard:
    """ASGI middleware that checks host, origin and cookie of requests and sockets, and sets headers.

    A name of the loopback passes whatever its port, which a tunnel changes.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self.app, self.token = app, token
        # named by the port, which cookies ignore
        self.cookie = f"knotfab-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        answer = self._refuse(scope)
        if answer is None:
            await self.app(scope, receive, self._with_headers(scope, send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": FOREIGN})
        else:
            await answer(scope, receive, self._with_headers(scope, send))

    def _refuse(self, scope: Scope) -> Response | None:
        """Return the response that refuses a request, or sets the cookie; None if it may go on."""
        headers = Headers(scope=scope)
        socket = scope["type"] == "websocket"
        method = "GET" if socket else scope["method"]
        host, origin = headers.get("host", ""), headers.get("origin")
        if _LOOPBACK.fullmatch(host) is None:
            return PlainTextResponse(FOREIGN, 403)
        if origin is None and (socket or method not in _SAFE):
            return PlainTextResponse(FOREIGN, 403)
        if origin is not None and origin != f"http://{host}":
            return PlainTextResponse(FOREIGN, 403)
        if not socket and method in _SAFE and scope["path"] == "/":
            given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
            if given and self._is_token(given[0]):
                answer = HTMLResponse(_LET_IN)
                answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
                return answer
        # http.cookies would stop at the first malformed cookie of another local page
        if not self._is_token(cookie_parser(headers.get("cookie", "")).get(self.cookie, "")):
            return PlainTextResponse(NO_TOKEN, 403)
        return None

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        host = Headers(scope=scope).get("host", "")
        host = host if _LOOPBACK.fullmatch(host) else "127.0.0.1"

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("content-security-policy", _PAGE_POLICY.format(host=host))
            await send(message)

        return sent
