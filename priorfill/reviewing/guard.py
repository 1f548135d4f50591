"""What stands before the application of a server: refusals, limits, headers, and the first link."""

from __future__ import annotations

import hmac
import json
import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from priorfill.reviewing.security import (
    MAX_BODY,
    RESPONSE_HEADERS,
    Refusal,
    Visitor,
    new_token,
    split_path,
    too_large,
)

__all__ = ["LINK_SECONDS", "Guard"]

LINK_SECONDS = 60.0
"""How long a link to the page is valid."""

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]
"""An application as ASGI defines it: https://asgi.readthedocs.io."""


class Guard:
    """Refuses the requests of others, limits what is read of a request, and adds headers.

    Parameters
    ----------
    visitor : Visitor
        Who may send requests.
    app : callable
        The application that answers (ASGI).
    """

    def __init__(self, visitor: Visitor, app: App) -> None:
        self._visitor = visitor
        self._app = app
        self._link = ""
        self._valid_until = 0.0

    def link(self) -> str:
        """Return a path that leads to the page once, within `LINK_SECONDS`."""
        self._link = new_token()
        self._valid_until = time.monotonic() + LINK_SECONDS
        return f"/{self._link}/open"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":  # there is no other kind of request
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *RESPONSE_HEADERS]
            await send(message)

        method, path, headers = scope["method"], scope["path"], scope["headers"]
        if method == "GET" and self._visitor.comes_from_here(headers) and self._follows(path):
            await _redirect(send_with_headers, f"/{self._visitor.token}/")
            return
        refusal = self._visitor.refusal(method, path, headers)
        if refusal is None and method == "POST":
            body = await _read(receive)
            if isinstance(body, Refusal):
                refusal = body
            else:
                receive = _again(body, receive)
        if refusal is not None:
            await _refuse(send_with_headers, refusal)
        else:
            await self._app(scope, receive, send_with_headers)

    def _follows(self, path: str) -> bool:
        """Return whether a path is that of the link, which then is used up."""
        first, rest = split_path(path)
        same = hmac.compare_digest(first.encode("utf-8", "replace"), self._link.encode())
        if not self._link or not same or rest != "open" or time.monotonic() > self._valid_until:
            return False
        self._link = ""
        return True


async def _read(receive: Receive) -> bytes | Refusal:
    """Return the body of a request, or why it is refused."""
    parts, size = [], 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return Refusal(400, "the request is not complete")
        part = message.get("body", b"")
        size += len(part)
        if size > MAX_BODY:
            return too_large()
        parts.append(part)
        if not message.get("more_body", False):
            return b"".join(parts)


def _again(body: bytes, receive: Receive) -> Receive:
    """Return what receives a body that was read, and then what comes after it."""
    pending = [body]

    async def receive_again() -> Message:
        if pending:
            return {"type": "http.request", "body": pending.pop(), "more_body": False}
        return await receive()

    return receive_again


async def _refuse(send: Send, refusal: Refusal) -> None:
    """Send a refusal, and close the connection: its request may not have been read."""
    body = json.dumps({"error": refusal.line}).encode("ascii")
    headers = [
        (b"content-type", b"application/json"),
        (b"content-length", b"%d" % len(body)),
        (b"connection", b"close"),
    ]
    await send({"type": "http.response.start", "status": refusal.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


async def _redirect(send: Send, path: str) -> None:
    headers = [(b"location", path.encode("ascii")), (b"content-length", b"0")]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})
