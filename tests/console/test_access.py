"""Who may use the console: its own pages only, and with a password those who know it."""

from __future__ import annotations

import asyncio
import time
from urllib.parse import urlencode

import pytest
from starlette.responses import PlainTextResponse

from robocorba.console.access import COOKIE, MAX_FORM, MAX_WAITING, SESSION_S, Access
from robocorba.console.settings import LOOPBACK_HOSTS
from tests.console.asgi import Answer, answer, ask

PASSWORD = "open sesame"


def console(password: str = "", hosts: frozenset[str] = LOOPBACK_HOSTS) -> Access:
    return Access(PlainTextResponse("inside"), hosts, password, pause_s=0.0)


def log_in(app: Access, password: str) -> Answer:
    return ask(app, "/login", "POST", [urlencode({"password": password}).encode()])


def cookie_of(given: Answer) -> str:
    return given.headers["set-cookie"].partition(";")[0]


def test_own_pages_get_in() -> None:
    for host in ("127.0.0.1:8800", "localhost:8800", "LOCALHOST", "[::1]:8800"):
        assert ask(console(), host=host).body == b"inside", host
        assert ask(console(), host=host, origin=f"http://{host}").body == b"inside", host


def test_a_console_on_another_address_answers_to_its_name_only() -> None:
    app = console(hosts=frozenset({"Robots.example"}))
    assert ask(app, host="robots.example:8800").body == b"inside"
    assert ask(app, host="127.0.0.1:8800").status == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8800", "127.0.0.1.evil.example", "", "[::1", "localhost@evil.example", "::1"]
)
def test_foreign_host_names_are_refused(host: str) -> None:
    """A name that an attacker lets point to this machine (DNS rebinding)."""
    assert ask(console(), host=host).status == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://[::1", "file://"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_pages_of_other_sites_are_refused(origin: str, kind: str) -> None:
    refused = ask(console(), "/live", kind=kind, origin=origin)
    assert refused.status == (403 if kind == "http" else 0) and b"inside" not in refused.body


def test_answers_forbid_frames() -> None:
    assert ask(console()).headers["x-frame-options"] == "DENY"


def test_without_a_log_in_there_is_a_form_for_people_and_401_for_programs() -> None:
    app = console(PASSWORD)
    form = ask(app, accept="text/html")
    assert b'type="password"' in form.body and b"inside" not in form.body
    assert ask(app, "/call/stop_all", "POST").status == 401
    assert ask(app, "/live", kind="websocket").body == b""


def test_the_password_opens_the_console() -> None:
    app = console(PASSWORD)
    opened = log_in(app, PASSWORD)
    assert opened.status == 303
    assert {"HttpOnly", "SameSite=strict"} <= set(opened.headers["set-cookie"].split("; "))
    assert ask(app, cookie=cookie_of(opened)).body == b"inside"
    assert ask(console(PASSWORD), cookie=cookie_of(opened)).status == 401, "another console has another key"


def test_a_wrong_password_does_not() -> None:
    refused = log_in(console(PASSWORD), "open sesam\u00e9")
    assert refused.status == 401 and "set-cookie" not in refused.headers and b"The password is wrong" in refused.body


@pytest.mark.parametrize(
    "cookie",
    ["", f"{COOKIE}=", f"{COOKIE}=99999999999.aa", f"{COOKIE}=\xe9.\xe9", f"{COOKIE}=nan.", "=;=;\x01", f"{COOKIE}"],
)
def test_made_up_cookies_are_nothing(cookie: str) -> None:
    assert ask(console(PASSWORD), cookie=cookie).status == 401


def test_a_cookie_expires_by_the_time_that_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    app = console(PASSWORD)
    cookie, now = cookie_of(log_in(app, PASSWORD)), time.monotonic()
    for wrong in (0.0, 99999999999.0):
        monkeypatch.setattr("robocorba.console.access.time.time", lambda wrong=wrong: wrong)
        assert ask(app, cookie=cookie).status == 200
    monkeypatch.setattr("robocorba.console.access.time.monotonic", lambda: now + SESSION_S)
    assert ask(app, cookie=cookie).status == 401


def test_a_form_that_is_too_long_is_not_read() -> None:
    assert ask(console(PASSWORD), "/login", "POST", [b"x" * MAX_FORM, b"x"]).status == 413


def test_log_ins_are_checked_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that guessing is slow with any number of connections; and a bounded number of them waits."""
    app = Access(PlainTextResponse("inside"), LOOPBACK_HOSTS, PASSWORD, pause_s=1.0)
    asleep, go_on = 0, asyncio.Event()

    async def sleep(_: float) -> None:
        nonlocal asleep
        asleep += 1
        await go_on.wait()
        asleep -= 1

    monkeypatch.setattr("robocorba.console.access.asyncio.sleep", sleep)

    async def guess() -> Answer:
        return await answer(app, "/login", "POST", [b"password=guess"])

    async def attack() -> list[Answer]:
        tasks = [asyncio.create_task(guess()) for _ in range(MAX_WAITING + 5)]
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        while len(done) < 5:
            done, _ = await asyncio.wait(tasks, timeout=0.001)
        assert asleep == 1
        go_on.set()
        return await asyncio.gather(*tasks)

    codes = [given.status for given in asyncio.run(attack())]
    assert (codes.count(429), codes.count(401)) == (5, MAX_WAITING)
