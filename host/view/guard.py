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
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlencode, urlsplit

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
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        refusal = self._refuse(scope, headers)
        if refusal is None and scope["type"] == "http" and self._token_in_query(scope):
            await self._exchange(scope, receive, send)
            return
        if refusal is not None:
            status, text = refusal
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 4000 + status, "reason": text})
            else:
                await PlainTextResponse(text + "\n", status)(scope, receive, _with_headers(send))
            return
        await self._app(scope, receive, _with_headers(send))

    def _refuse(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if self._loopback and host_name(host) not in _LOOPBACK_NAMES:
            return 403, "The viewer answers only under the name localhost."
        origin = headers.get("origin")
        if origin is not None and _place(origin) != host.lower():
            return 403, "Another site's page may not talk to the viewer."
        if scope["type"] == "websocket" and origin is None and "sec-fetch-site" in headers:
            return 403, "A browser must say which page opens the connection."
        if self._token and not self._has_token(scope, headers):
            return 401, "This address needs the token: open the link that `palpate view` printed."
        return None

    def _has_token(self, scope: Scope, headers: dict[str, str]) -> bool:
        offered = [_query(scope).get("token", [""])[0]]
        if offered[0] in self._once and scope["type"] == "http" and scope["method"] == "GET":
            self._once.discard(offered[0])
            return True
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            offered.append(bearer.strip())
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(cookie_name(headers.get("host", "")))
        except CookieError:
            morsel = None
        if morsel is not None:
            offered.append(morsel.value)
        wanted = self._token.encode()
        return any(hmac.compare_digest(o.encode("utf-8", "replace"), wanted) for o in offered)

    def _token_in_query(self, scope: Scope) -> bool:
        return bool(self._token) and scope["method"] == "GET" and "token" in _query(scope)

    async def _exchange(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Move the token out of the address bar into a cookie that scripts cannot read."""
        query = {k: v for k, v in _query(scope).items() if k != "token"}
        rest = urlencode(query, doseq=True)
        path = "/" + scope["path"].lstrip("/\\")  # "//name/" would be another site's
        response = RedirectResponse(path + (f"?{rest}" if rest else ""), 303)
        host = next((v.decode("latin-1") for k, v in scope["headers"] if k.lower() == b"host"), "")
        response.set_cookie(cookie_name(host), self._token, httponly=True, samesite="strict")
        await response(scope, receive, _with_headers(send))


def _query(scope: Scope) -> dict[str, list[str]]:
    try:
        return parse_qs(scope.get("query_string", b"").decode("latin-1"), max_num_fields=32)
    except ValueError:  # more fields than anything of ours has
        return {}


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
