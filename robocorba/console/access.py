"""Who may use the console: pages of this host only, and with a password on any address but the loopback. A PIN opens
the panel of its robot, and nothing else."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import secrets
import time
from collections.abc import Mapping
from html import escape
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

COOKIE = "robocorba_console"
#: How long a log-in holds [s].
SESSION_S = 12 * 3600.0
#: Maximum number of log-ins that wait for the one before; more are refused.
MAX_WAITING = 20
#: Longest body of a log-in [bytes].
MAX_FORM = 4096
_HEADERS = {"X-Frame-Options": "DENY", "X-Content-Type-Options": "nosniff", "Referrer-Policy": "same-origin"}
_PANEL = "/panel/"


class Access:
    """ASGI middleware around the console.

    hosts: accepted values of the Host header, without port. password: empty for none. pause_s: after a wrong password
    or PIN, for all clients together [s]. pins: of robots' panels, by name."""

    def __init__(
        self,
        app: ASGIApp,
        hosts: frozenset[str],
        password: str,
        pause_s: float = 1.0,
        pins: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._app, self._hosts, self._pause_s = app, frozenset(map(str.lower, hosts)), pause_s
        self._password = hashlib.sha256(password.encode()).digest() if password else b""
        self._pins = {robot: hashlib.sha256(pin.encode()).digest() for robot, pin in pins.items()}
        self._key = secrets.token_bytes(32)
        self._one_attempt, self._attempts = asyncio.Lock(), 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        if problem := self._foreign(headers):
            await self._refuse(PlainTextResponse(problem, 403), scope, receive, send)
        elif not self._password or self._may_see(scope, headers):
            await self._app(scope, receive, self._with_headers(send))
        elif scope["type"] == "http" and scope["path"] == "/login" and scope["method"] == "POST":
            await (await self._log_in(Request(scope, receive)))(scope, receive, send)
        elif scope["type"] == "http" and scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
            robot = scope["path"].removeprefix(_PANEL) if scope["path"].startswith(_PANEL) else ""
            await HTMLResponse(self._form(robot), headers=_HEADERS)(scope, receive, send)
        else:
            await self._refuse(PlainTextResponse("log in first", 401), scope, receive, send)

    def _foreign(self, headers: Mapping[str, str]) -> str:
        """Why a request comes from a page that is not the console's; empty if it is."""
        host, origin = headers.get("host", ""), headers.get("origin")
        try:
            if (urlsplit(f"//{host}").hostname or "") not in self._hosts:
                return "this address is not the console's"
            if origin and urlsplit(origin).netloc != host:
                return "requests from other sites are refused"
        except ValueError:  # no address at all
            return "this address is not the console's"
        return ""

    async def _refuse(self, response: Response, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await response(scope, receive, send)

    def _with_headers(self, send: Send) -> Send:
        async def send_with_headers(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                added = [(name.lower().encode(), value.encode()) for name, value in _HEADERS.items()]
                message = {**message, "headers": [*message["headers"], *added]}
            await send(message)

        return send_with_headers  # type: ignore[return-value]

    async def _log_in(self, request: Request) -> Response:
        try:
            given = await asyncio.wait_for(_form_in(request), 10.0)
        except (asyncio.TimeoutError, ClientDisconnect):
            return PlainTextResponse("the form did not arrive in time", 408)
        if given is None:
            return PlainTextResponse("too long", 413)
        if self._attempts >= MAX_WAITING:
            return PlainTextResponse("too many log-ins; try again later", 429)
        password, robot = (given.get(name, [""])[0] for name in ("password", "robot"))
        wanted = self._pins.get(robot, self._password)
        self._attempts += 1
        try:
            async with self._one_attempt:
                if not hmac.compare_digest(hashlib.sha256(password.encode()).digest(), wanted):
                    await asyncio.sleep(self._pause_s)
                    what = "PIN" if robot in self._pins else "password"
                    return HTMLResponse(self._form(robot, f"The {what} is wrong."), 401, headers=_HEADERS)
        finally:
            self._attempts -= 1
        response = RedirectResponse(_PANEL + quote(robot, safe="") if robot else "/", 303)
        session = self._session(robot if robot in self._pins else "")
        is_secure = request.url.scheme == "https"
        response.set_cookie(COOKIE, session, max_age=int(SESSION_S), httponly=True, samesite="strict", secure=is_secure)
        return response

    def _form(self, robot: str, problem: str = "") -> str:
        """The page that asks for the PIN of a robot, or for the password."""
        page = "pin.html" if robot in self._pins else "login.html"
        form = (Path(__file__).parent / "static" / page).read_text()
        return form.replace("{problem}", problem).replace("{robot}", escape(robot))

    def _session(self, robot: str) -> str:
        """A cookie's value; it holds for this process only, so its time may be by the monotonic clock. robot: whose
        panel it opens; empty for all pages."""
        claim = f"{int(time.monotonic() + SESSION_S)}.{robot.encode().hex()}"
        return f"{claim}.{self._signature(claim)}"

    def _signature(self, claim: str) -> str:
        return hmac.new(self._key, claim.encode(), "sha256").hexdigest()

    def _may_see(self, scope: Scope, headers: Mapping[str, str]) -> bool:
        """Whether the session in a request's cookie opens what it asks for."""
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        claim, _, signature = (cookie.value if cookie else "").rpartition(".")
        if not hmac.compare_digest(signature.encode(), self._signature(claim).encode()):
            return False
        until, _, robot = claim.partition(".")
        if time.monotonic() >= float(until):
            return False
        path, name = scope["path"], bytes.fromhex(robot).decode()
        if not name or path == _PANEL + name or path.startswith(("/static/", "/_nicegui", "/favicon")):
            return True
        before, _, called = path.removeprefix("/panel-call/").partition("/")
        return path == f"/panel-call/{before}/{called}" and called == name


async def _form_in(request: Request) -> dict[str, list[str]] | None:
    """The fields of a form; None if it is too long."""
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MAX_FORM:
            return None
    return parse_qs(body.decode("utf-8", "replace"))
