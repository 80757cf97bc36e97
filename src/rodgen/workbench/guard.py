"""Decides who may connect to the server of the page: only the browser that was given its address.

Other programs of this computer do not know the token in the address. A page of the web that makes a browser ask
127.0.0.1 is refused by its Origin, one that gave its own name the address 127.0.0.1 (DNS rebinding) by the Host. What
the page loads comes from here: its content security policy allows no other source.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, TypeAlias

__all__ = ["MOST_BYTES", "Guard"]

Scope: TypeAlias = MutableMapping[str, Any]
Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BYTES = 64_000_000
"""Bytes of a request at most: a table that is dropped on the page."""

_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; object-src 'none'; base-uri 'self'; "
        "form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class _TooLargeError(Exception):
    """A request has more bytes than one may have."""


class Guard:
    """An ASGI application that passes on what comes from its own page.

    Parameters
    ----------
    app : ASGI application
    token : str
        Every path begins with it.
    port : int
    most : int, optional
        Bytes of a request.
    """

    def __init__(self, app: App, token: str, port: int, most: int = MOST_BYTES) -> None:
        self.app, self.most = app, most
        self._start = f"/{token}/".encode()
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        status, why = self._refusal(scope)
        if status:
            await _refuse(scope, send, status, why)
            return
        taken = 0

        async def counted() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b"") or b"") if message["type"] == "http.request" else 0
            if taken > self.most:
                raise _TooLargeError
            return message

        begun = False

        async def marked(message: Message) -> None:
            nonlocal begun
            begun = True
            if message["type"] == "http.response.start":
                named = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                message["headers"] = [*message.get("headers", ()), *named]
            await send(message)

        try:
            await self.app(scope, counted, marked)
        except _TooLargeError:
            if not begun:
                await _refuse(scope, send, 413, f"more than {self.most / 1e6:g} MB")

    def _refusal(self, scope: Scope) -> tuple[int, str]:
        """Return the status of a refusal and why; 0 where there is none."""
        headers: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value.decode("latin-1"))
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return 403, "another host than this page's"
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return 403, "another origin than this page's"
        if scope["type"] == "websocket" and not origins:
            return 403, "no origin"
        site = headers.get(b"sec-fetch-site", ["none"])[0]
        if site not in {"none", "same-origin"}:
            return 403, "another site than this page's"
        path = scope["path"].encode("utf-8", "replace")
        if not hmac.compare_digest(path[: len(self._start)], self._start):
            return 403, "no token: open the address that rodgen open printed"
        length = headers.get(b"content-length", ["0"])[0]
        if not length.isdigit() or int(length[:18]) > self.most:
            return 413, f"more than {self.most / 1e6:g} MB"
        return 0, ""


async def _refuse(scope: Scope, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": ""})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"x-content-type-options", b"nosniff")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"Refused: {why}.\n".encode()})
