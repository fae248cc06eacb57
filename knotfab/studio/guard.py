"""Who may talk to the studio: its own page, in the browser that was given the token, and nobody else."""

from __future__ import annotations

import secrets
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["REPORT_POLICY", "RequestGuard"]

_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' {sockets}; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
# a report brings its own scripts: it runs in an origin of its own, from which it reaches nothing
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
# a page of the studio's own leads on, so that the browser counts what follows as the studio's
_LET_IN = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" '
    'content="0; url=/"><link rel="icon" href="data:,"><title>knotfab studio</title><p>'
    '<a href="/">Go on to the studio</a></p></html>'
)
_SAFE = ("GET", "HEAD")
NO_TOKEN = "This address lacks its token: open the address that knotfab studio printed."
FOREIGN = "This request comes from elsewhere: open the address that knotfab studio printed."


class RequestGuard:
    """ASGI middleware: checks host, origin and cookie of everything, sockets too, and sets the headers.

    Args:
        hosts: what the Host header may be, with the port.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: tuple[str, ...]) -> None:
        self.app, self.token, self.hosts = app, token, hosts
        # cookies know no ports: each studio has its own
        self.cookie = "knotfab-" + hosts[0].rpartition(":")[2]
        self.policy = _PAGE_POLICY.format(sockets=" ".join(f"ws://{host}" for host in hosts))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        answer = self._refuse(scope)
        if answer is None:
            await self.app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": FOREIGN})
        else:
            await answer(scope, receive, self._with_headers(send))

    def _refuse(self, scope: Scope) -> Response | None:
        """Return the refusal of a request; None: it may go on."""
        headers = Headers(scope=scope)
        socket = scope["type"] == "websocket"
        method = "GET" if socket else scope["method"]
        origins = tuple(f"http://{host}" for host in self.hosts)
        origin = headers.get("origin")
        if headers.get("host") not in self.hosts:
            return PlainTextResponse(FOREIGN, 403)
        if origin is None and (socket or method not in _SAFE):
            return PlainTextResponse(FOREIGN, 403)
        if origin is not None and origin not in origins:
            return PlainTextResponse(FOREIGN, 403)
        if not socket and method in _SAFE and scope["path"] == "/":
            given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
            if given and self._is_token(given[0]):
                answer = HTMLResponse(_LET_IN)
                answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
                return answer
        # not http.cookies: that stops at the first pair of another local page that it cannot read
        if not self._is_token(cookie_parser(headers.get("cookie", "")).get(self.cookie, "")):
            return PlainTextResponse(NO_TOKEN, 403)
        return None

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())

    def _with_headers(self, send: Send) -> Send:
        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("content-security-policy", self.policy)
            await send(message)

        return sent
