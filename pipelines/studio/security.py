"""Who may talk to the server: pages that it has served itself, in browsers that were let in."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, PlainTextResponse, Response
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
_REFUSED_SOCKET = 1008  # of WebSocket: policy violation
_OWN_SITES = (None, "same-origin", "none")  # of Sec-Fetch-Site; a page of another port is "same-site"
_HELP = """This address does not open the studio.

It opens it once. A browser that has opened it goes on at http://{host}/ without it.
For another browser, open the newest address in the terminal where `texloom studio` runs.
"""


def leading_to(address: str) -> str:
    """A page that opens another one, as HTML."""
    return f'<!doctype html><meta http-equiv="refresh" content="0; url={address}"><title>texloom</title>\n'


class Codes:
    """Codes that let a browser in once."""

    def __init__(self, used: Callable[[str], None]):
        """Call ``used`` with each code that was."""
        self._open: set[str] = set()
        self._used = used

    def new(self) -> str:
        """One more code."""
        code = secrets.token_urlsafe(32)
        self._open.add(code)
        return code

    def use(self, given: str) -> bool:
        """Whether this is a code that nobody has used, which it is from now on."""
        found = next((code for code in self._open if hmac.compare_digest(code.encode(), given.encode())), None)
        if found is None:
            return False
        self._open.discard(found)
        self._used(found)
        return True


class Guard:
    """ASGI middleware that passes on only requests to this server's own name, from its own page, with its cookie.

    The cookie is exchanged for one of ``codes`` in the address of the page, as ``/?code=CODE``. Browsers send it to
    all ports of this machine, so its name has the port; those of other servers come along with it. Programs that
    are no browser send what it holds, ``token``, as ``Authorization: Bearer TOKEN``. Others are told ``help``.
    """

    def __init__(self, app: ASGIApp, codes: Codes, port: int, help: str = _HELP):
        self.app, self.codes, self.port, self.help = app, codes, port, help
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.cookie = f"texloom-{port}"
        self.token = secrets.token_urlsafe(32)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See `Guard`."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        problem, status = self._problem(scope)
        answer: Response | None = None
        if problem:
            answer = PlainTextResponse(problem, status)
        elif not self._has_token(scope):
            answer = self._entrance(scope)
        elif _code(scope):
            answer = HTMLResponse(leading_to("/"))  # the address was opened again, by the browser that has used it
        if answer is None:
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": _REFUSED_SOCKET, "reason": problem or "no cookie"})
        else:
            await answer(scope, receive, _with_headers(send))

    def _problem(self, scope: Scope) -> tuple[str, int]:
        """Why a request is refused whoever sends it, and the status of the answer; empty if it is not."""
        headers = Headers(scope=scope)
        if headers.get("host", "") not in self.hosts:
            return "This server answers to 127.0.0.1 and localhost only.\n", 403
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "Requests of other pages are refused.\n", 403
        if headers.get("sec-fetch-site") not in _OWN_SITES and scope.get("path") != "/":
            return "Requests of other pages are refused.\n", 403
        return "", 0

    def _has_token(self, scope: Scope) -> bool:
        headers = Headers(scope=scope)
        bearer = headers.get("authorization", "").partition("Bearer ")[2]
        given = [*_cookies(headers, self.cookie), bearer]
        return any(hmac.compare_digest(one.encode(), self.token.encode()) for one in given)

    def _entrance(self, scope: Scope) -> Response:
        """The answer to who has no cookie: with it and to the page, if the address has a code."""
        code = _code(scope)
        if code and self.codes.use(code):
            # No redirection: a browser may take that for a request of the page that led here, without the cookie.
            answer = HTMLResponse(leading_to("/"))
            answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
            return answer
        return PlainTextResponse(self.help.format(host=f"127.0.0.1:{self.port}"), 401)


def _code(scope: Scope) -> str:
    """The code in the address of the page, or none."""
    if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
        return ""
    query: str = scope.get("query_string", b"").decode("latin-1")
    return parse_qs(query).get("code", [""])[0]


def _cookies(headers: Headers, name: str) -> list[str]:
    """What cookies of this name hold; `http.cookies` drops them all where one of another server is malformed."""
    pairs = [pair.partition("=") for header in headers.getlist("cookie") for pair in header.split(";")]
    return [value.strip() for found, _, value in pairs if found.strip() == name]


def _with_headers(send: Send) -> Send:
    """Adds headers to every answer."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {name.lower() for name, _ in message["headers"]}
            new = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
            message["headers"] = [*message["headers"], *(pair for pair in new if pair[0] not in present)]
        await send(message)

    return sending
