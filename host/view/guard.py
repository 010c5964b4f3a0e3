"""Who may talk to the viewer.

On the loopback address nobody needs a token, but a page of another site must not reach us through the user's
browser: the Host header must name this machine (against DNS rebinding) and an Origin header must be our own
(against cross-site web sockets). On any other address every request needs the token that the command
printed, as `?token=` once (a cookie takes over) or as `Authorization: Bearer`.
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


class Guard:
    """ASGI middleware: lets in what belongs here, and refuses the rest before any route sees it.

    Parameters
    ----------
    token : str or None
        None only where the server is bound to the loopback address.
    """

    def __init__(self, app: ASGIApp, *, token: str | None = None) -> None:
        self._app = app
        self._token = token

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
        if self._token is None and host_name(host) not in _LOOPBACK_NAMES:
            return 403, "The viewer answers only under the name localhost."
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return 403, "Another site's page may not talk to the viewer."
        if scope["type"] == "websocket" and origin is None and "sec-fetch-site" in headers:
            return 403, "A browser must say which page opens the connection."
        if self._token is not None and not self._has_token(scope, headers):
            return 401, "This address needs the token: open the link that `palpate view` printed."
        return None

    def _has_token(self, scope: Scope, headers: dict[str, str]) -> bool:
        offered = [_query(scope).get("token", [""])[0]]
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            offered.append(bearer.strip())
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            morsel = None
        if morsel is not None:
            offered.append(morsel.value)
        wanted = (self._token or "").encode()
        return any(hmac.compare_digest(o.encode("utf-8", "replace"), wanted) for o in offered)

    def _token_in_query(self, scope: Scope) -> bool:
        return self._token is not None and scope["method"] == "GET" and "token" in _query(scope)

    async def _exchange(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Move the token out of the address bar into a cookie that scripts cannot read."""
        query = {k: v for k, v in _query(scope).items() if k != "token"}
        rest = urlencode(query, doseq=True)
        response = RedirectResponse(scope["path"] + (f"?{rest}" if rest else ""), 303)
        response.set_cookie(COOKIE, self._token or "", httponly=True, samesite="strict")
        await response(scope, receive, _with_headers(send))


def _query(scope: Scope) -> dict[str, list[str]]:
    return parse_qs(scope.get("query_string", b"").decode("latin-1"), max_num_fields=32)


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            names = {name for name, _ in message["headers"]}
            message["headers"] = [*message["headers"], *((n, v) for n, v in _HEADERS if n not in names)]
        await send(message)

    return send_with_headers
