"""Who may talk to the server: pages that it has served itself, and programs that know its token."""

from __future__ import annotations

import hmac
import re
from http.cookies import SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_CONTENT = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_HEADERS = {
    "content-security-policy": _CONTENT,
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}
_UNKNOWN = "This address lacks the token of the studio; open the one that `texloom studio` has printed.\n"
_REFUSED_SOCKET = 1008  # of WebSocket: policy violation


class Guard:
    """ASGI middleware that passes on only requests to this server's own name, from its own page, with its token.

    The token is in the cookie that the page was given, in ``Authorization: Bearer TOKEN``, or in the address of the
    page, as ``?token=TOKEN``.
    """

    def __init__(self, app: ASGIApp, token: str, port: int):
        self.app, self.token = app, token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.cookie = f"texloom-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See `Guard`."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        problem, status = self._problem(scope)
        if problem and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": _REFUSED_SOCKET, "reason": problem})
        elif problem:
            await PlainTextResponse(problem, status, dict(_HEADERS))(scope, receive, send)
        else:
            await self.app(scope, receive, self._with_headers(scope, send))

    def _problem(self, scope: Scope) -> tuple[str, int]:
        """Why a request is refused, and the status of the answer; empty if it is not."""
        headers = Headers(scope=scope)
        if headers.get("host", "") not in self.hosts:
            return "This server answers to 127.0.0.1 and localhost only.\n", 403
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "Requests of other pages are refused.\n", 403
        if headers.get("sec-fetch-site") == "cross-site" and scope.get("path") != "/":
            return "Requests of other pages are refused.\n", 403
        return ("", 0) if self._has_token(scope, headers) else (_UNKNOWN, 401)

    def _has_token(self, scope: Scope, headers: Headers) -> bool:
        cookies: SimpleCookie = SimpleCookie()
        cookies.load(re.sub(r"[^\x20-\x7e]", "", headers.get("cookie", "")))
        given = [cookies[self.cookie].value] if self.cookie in cookies else []
        given.append(headers.get("authorization", "").removeprefix("Bearer "))
        if scope.get("path") == "/":
            given += parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [])
        return any(hmac.compare_digest(one.encode(), self.token.encode()) for one in given)

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        """Adds headers to every answer, and the cookie to that of the page."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = {name.lower() for name, _ in message["headers"]}
                added = dict(_HEADERS)
                if scope["path"] == "/":
                    added["set-cookie"] = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                new = [(name.encode(), value.encode()) for name, value in added.items()]
                message["headers"] = [*message["headers"], *(pair for pair in new if pair[0] not in present)]
            await send(message)

        return sending
