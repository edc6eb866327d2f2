"""Requests to an ASGI application, without a server."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, NamedTuple

from starlette.types import ASGIApp


class Answer(NamedTuple):
    """status: 0 for a WebSocket that was refused."""

    status: int
    headers: dict[str, str]
    body: bytes


def ask(
    app: ASGIApp, path: str = "/", method: str = "GET", body: Iterable[bytes] = (), kind: str = "http", **headers: str
) -> Answer:
    """The answer to a request, by default to 127.0.0.1:8800. headers: with _ instead of -."""
    return asyncio.run(answer(app, path, method, body, kind, **headers))


async def answer(
    app: ASGIApp, path: str = "/", method: str = "GET", body: Iterable[bytes] = (), kind: str = "http", **headers: str
) -> Answer:
    """As `ask`, inside an event loop."""
    wanted = {"host": "127.0.0.1:8800", **{name.replace("_", "-"): value for name, value in headers.items()}}
    raw = [(name.encode(), value.encode("latin-1")) for name, value in wanted.items()]
    scope: dict[str, Any] = {
        "type": kind,
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "headers": raw,
        "scheme": "http",
        "server": ("127.0.0.1", 8800),
        "client": ("127.0.0.1", 1),
    }
    pieces = [*body]
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        piece = pieces.pop(0) if pieces else b""
        return {"type": "http.request", "body": piece, "more_body": bool(pieces)}

    async def send(message: Any) -> None:
        sent.append(message)

    await app(scope, receive, send)
    status = next((message["status"] for message in sent if "status" in message), 0)
    found = {name.decode().lower(): value.decode() for message in sent for name, value in message.get("headers", ())}
    return Answer(status, found, b"".join(message.get("body", b"") for message in sent))
