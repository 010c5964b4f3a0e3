"""Access to the viewer.

Every request needs the token that the command printed, as `?token=` once (a cookie takes over) or as
`Authorization: Bearer`: other users of this machine reach the loopback address, too. A page of another site
must not reach us through the user's browser: on the loopback address the Host header must name this machine
(against DNS rebinding), and an Origin header must be our own (against cross-site web sockets).

The browser that we open ourselves gets a code that is good for one request, since any user can read what
programs are started with.
"""

from __future__ import annotations

import hmac
import ipaddress
from urllib.parse import urlencode, urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "palpate_token"
_LOOPBACK_NAMES = {"localhost", "127.0.0.1", "::1"}
_HEADERS = [
    (
        b"content-security-policy",
        b"default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
        b"frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
]


def is_loopback(host: str) -> bool:
    """Does this address, or the name `localhost`, stay on this machine?"""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def host_name(header: str) -> str:
    """The name in a Host header, without port and brackets; empty if it is not one."""
    try:
        return urlsplit(f"//{header}").hostname or ""
    except ValueError:
        return ""


def cookie_name(host: str) -> str:
    """The cookie of a server: cookies do not tell ports apart, and two viewers may run on one machine."""
    try:
        return f"{COOKIE}_{urlsplit(f'//{host}').port or 80}"
    except ValueError:
        return COOKIE


class Guard:
    """ASGI middleware: lets in what belongs here, and refuses the rest before any route sees it.

    Parameters
    ----------
    token : str
        Empty: nobody is asked for one.
    loopback : bool
        The server is bound to the loopback address.
    once : set of str, optional
        Codes that may stand in the token's place, in one request each; emptied as they are used.
    """

    def __init__(
        self, app: ASGIApp, *, token: str = "", loopback: bool = True, once: set[str] | None = None
    ) -> None:
        self._app = app
        self._token = token
        self._loopback = loopback
        self._once = set() if once is None else once

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check one request or web socket."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        asked = HTTPConnection(scope)
        refusal = self._refuse(asked)
        if refusal is None and self._token and _is_get(scope) and "token" in asked.query_params:
            await self._without_token(asked)(scope, receive, _with_headers(send))
            return
        if refusal is not None:
            status, text = refusal
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 4000 + status, "reason": text})
            else:
                await PlainTextResponse(text + "\n", status)(scope, receive, _with_headers(send))
            return
        await self._app(scope, receive, _with_headers(send))

    def _refuse(self, asked: HTTPConnection) -> tuple[int, str] | None:
        host = asked.headers.get("host", "")
        if self._loopback and host_name(host) not in _LOOPBACK_NAMES:
            return 403, "The viewer answers only under the name localhost."
        origin = asked.headers.get("origin")
        if origin is not None and _place(origin) != host.lower():
            return 403, "Another site's page may not talk to the viewer."
        if asked["type"] == "websocket" and origin is None and "sec-fetch-site" in asked.headers:
            return 403, "A browser must say which page opens the connection."
        if self._token and not self._has_token(asked, host):
            return 401, "This address needs the token: open the link that `palpate view` printed."
        return None

    def _has_token(self, asked: HTTPConnection, host: str) -> bool:
        offered = [asked.query_params.get("token", "")]
        if offered[0] in self._once and _is_get(asked.scope):
            self._once.discard(offered[0])
            return True
        scheme, _, bearer = asked.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            offered.append(bearer.strip())
        offered.append(asked.cookies.get(cookie_name(host), ""))
        wanted = self._token.encode()
        return any(hmac.compare_digest(o.encode("utf-8", "replace"), wanted) for o in offered)

    def _without_token(self, asked: HTTPConnection) -> RedirectResponse:
        """Move the token out of the address bar into a cookie that scripts cannot read."""
        rest = urlencode([(k, v) for k, v in asked.query_params.multi_items() if k != "token"])
        path = "/" + asked["path"].lstrip("/\\")  # "//name/" would be another site's
        response = RedirectResponse(path + (f"?{rest}" if rest else ""), 303)
        name = cookie_name(asked.headers.get("host", ""))
        response.set_cookie(name, self._token, httponly=True, samesite="strict")
        return response


def _is_get(scope: Scope) -> bool:
    return scope["type"] == "http" and scope["method"] == "GET"


def _place(origin: str) -> str | None:
    """Name and port of an Origin header; None where it has none."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            names = {name for name, _ in message["headers"]}
            message["headers"] = [*message["headers"], *((n, v) for n, v in _HEADERS if n not in names)]
        await send(message)

    return send_with_headers
