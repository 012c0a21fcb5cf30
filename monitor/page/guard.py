"""Guard: who may see the page. This machine by default; others only with a token, and never by another site's form."""

from __future__ import annotations

import base64
import binascii
import hmac
import os

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from configs import InputError

__all__ = ["LOCAL", "TOKEN", "Guard", "check_opening", "is_from_here"]

LOCAL = ("127.0.0.1", "localhost", "::1")
TOKEN = "MICRORELIEF_TOKEN"  # noqa: S105 - the name of the variable, not a token
OPEN_PATHS = ("/healthz", "/livez", "/readyz")
HEADERS = {
    "content-security-policy": "default-src 'none'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "form-action 'self'; frame-ancestors 'none'; base-uri 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
}


def check_opening(host: str) -> str:
    """Give the token that a page on this address asks for; none on this machine alone.

    Raises
    ------
    InputError
        If the page would be open to others without one.
    """
    token = os.environ.get(TOKEN, "")
    if host not in LOCAL and len(token) < 16:
        raise InputError(
            f"--host {host} opens the page to others: set {TOKEN} to a secret of at least 16 characters first, "
            "and put a proxy with TLS before it (docs/running.md)"
        )
    return token


def is_from_here(request: Request) -> bool:
    """Tell whether somebody on this machine asks, and no proxy for somebody elsewhere."""
    forwarded = any(name in request.headers for name in ("forwarded", "x-forwarded-for", "x-forwarded-host", "via"))
    return not forwarded and request.client is not None and request.client.host in LOCAL


class Guard:
    """Refuses who may not, and gives every answer its headers.

    Parameters
    ----------
    app : ASGIApp
    host : str
        The address that is listened on. On this machine alone, only its own names are answered: a page elsewhere that
        makes a browser come here under another name (DNS rebinding) gets nothing.
    token : str
        Asked for as a bearer token, or as the password of any user; empty asks for none.
    """

    def __init__(self, app: ASGIApp, host: str = "127.0.0.1", token: str = "") -> None:
        self._app, self._host, self._token = app, host, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse."""
        from starlette.responses import PlainTextResponse

        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)

        async def with_headers(message: dict) -> None:  # type: ignore[type-arg]  # starlette's message
            if message["type"] == "http.response.start":
                known = {name for name, _ in message["headers"]}
                extra = [(k.encode(), v.encode()) for k, v in HEADERS.items() if k.encode() not in known]
                message = {**message, "headers": [*message["headers"], *extra]}
            await send(message)

        refusal = self._refusal(request)
        answer = self._app if refusal is None else PlainTextResponse(refusal[1] + "\n", refusal[0], _asks(refusal[0]))
        await answer(scope, receive, with_headers)  # type: ignore[arg-type]  # starlette's message is a mutable mapping

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        name = request.headers.get("host", "").rpartition("@")[2]
        name = name.partition("]")[0].lstrip("[") if name.startswith("[") else name.partition(":")[0]
        if self._host in LOCAL and name not in LOCAL:
            return 421, "this page answers on this machine only"
        if request.method not in ("GET", "HEAD"):
            origin = request.headers.get("origin")
            if origin is not None and origin.partition("://")[2] != request.headers.get("host"):
                return 403, "a form of another site"
        if self._token and request.url.path not in OPEN_PATHS and not self._knows(request):
            return 401, "a token is needed: any user name, and the token as password"
        return None

    def _knows(self, request: Request) -> bool:
        kind, _, given = request.headers.get("authorization", "").partition(" ")
        if kind.lower() == "basic":
            try:
                given = base64.b64decode(given, validate=True).decode().partition(":")[2]
            except (binascii.Error, UnicodeDecodeError, ValueError):
                return False
        elif kind.lower() != "bearer":
            return False
        return hmac.compare_digest(given.encode(), self._token.encode())


def _asks(status: int) -> dict[str, str]:
    return {"www-authenticate": 'Basic realm="microrelief"'} if status == 401 else {}
