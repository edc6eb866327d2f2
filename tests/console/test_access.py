"""Who may use the console: its own pages only, with a password those who know it, and its options."""

from __future__ import annotations

import asyncio
import subprocess
import time
from pathlib import Path
from urllib.parse import quote, urlencode

import pytest
from starlette.responses import PlainTextResponse

from robocorba.console import settings
from robocorba.console.access import COOKIE, MAX_FORM, MAX_WAITING, SESSION_S, Access
from robocorba.console.settings import LOOPBACK_HOSTS, ConsoleSettings, dates_problem
from robocorba.system.settings import InvalidSetting
from tests.console.asgi import Answer, answer, ask

PASSWORD = "open sesame"


def console(password: str = "", hosts: frozenset[str] = LOOPBACK_HOSTS) -> Access:
    return Access(PlainTextResponse("inside"), hosts, password, pause_s=0.0)


def log_in(app: Access, password: str) -> Answer:
    return ask(app, "/login", "POST", [urlencode({"password": password}).encode()])


def cookie_of(given: Answer) -> str:
    return given.headers["set-cookie"].partition(";")[0]


def test_own_pages_get_in_and_those_of_foreign_hosts_and_sites_do_not() -> None:
    """Also by a name that an attacker lets point to this machine (DNS rebinding)."""
    for host in ("127.0.0.1:8800", "localhost:8800", "LOCALHOST", "[::1]:8800"):
        assert ask(console(), host=host).body == b"inside", host
        assert ask(console(), host=host, origin=f"http://{host}").body == b"inside", host
    assert ask(console()).headers["x-frame-options"] == "DENY"
    foreign = ("evil.example", "evil.example:8800", "127.0.0.1.evil.example", "", "[::1", "localhost@evil.example")
    for host in (*foreign, "::1"):
        assert ask(console(), host=host).status == 403, host
    app = console(hosts=frozenset({"Robots.example"}))
    assert ask(app, host="robots.example:8800").body == b"inside"
    assert ask(app, host="127.0.0.1:8800").status == 403
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9999", "http://[::1", "file://"):
        for kind, status in (("http", 403), ("websocket", 0)):
            refused = ask(console(), "/live", kind=kind, origin=origin)
            assert refused.status == status and b"inside" not in refused.body, origin


def test_only_the_password_opens_the_console() -> None:
    app = console(PASSWORD)
    form = ask(app, accept="text/html")
    assert b'type="password"' in form.body and b"inside" not in form.body
    assert ask(app, "/call/stop_all", "POST").status == 401
    assert ask(app, "/live", kind="websocket").body == b""
    app = console(PASSWORD)
    opened = log_in(app, PASSWORD)
    assert opened.status == 303
    assert {"HttpOnly", "SameSite=strict"} <= set(opened.headers["set-cookie"].split("; "))
    assert ask(app, cookie=cookie_of(opened)).body == b"inside"
    assert ask(console(PASSWORD), cookie=cookie_of(opened)).status == 401, "another console has another key"
    refused = log_in(app, "open sesam\u00e9")
    assert refused.status == 401 and "set-cookie" not in refused.headers and b"The password is wrong" in refused.body
    for made_up in ("=", "=99999999999.aa", "=\xe9.\xe9", "=nan.", ""):
        assert ask(app, cookie=f"{COOKIE}{made_up}").status == 401, made_up
    for made_up in ("", "=;=;\x01"):
        assert ask(app, cookie=made_up).status == 401, made_up
    assert ask(app, "/login", "POST", [b"x" * MAX_FORM, b"x"]).status == 413


def test_a_cookie_expires_by_the_time_that_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    app = console(PASSWORD)
    cookie, now = cookie_of(log_in(app, PASSWORD)), time.monotonic()
    for wrong in (0.0, 99999999999.0):
        monkeypatch.setattr("robocorba.console.access.time.time", lambda wrong=wrong: wrong)
        assert ask(app, cookie=cookie).status == 200
    monkeypatch.setattr("robocorba.console.access.time.monotonic", lambda: now + SESSION_S)
    assert ask(app, cookie=cookie).status == 401


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


@pytest.fixture(autouse=True)
def nobody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)


def test_the_loopback_needs_no_password_and_other_addresses_need_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = ConsoleSettings.read(["--state", str(tmp_path)])
    assert (read.host, read.port, read.password, read.viewers, read.pins) == ("127.0.0.1", 8800, "", 64, {})
    assert (read.administrator, read.supervisor) == (None, tmp_path / "supervisor.ior")
    for host in ("127.0.0.1", "127.0.0.2", "::1", "localhost"):
        assert ConsoleSettings.read(["--host", host]).hosts >= {host, "localhost", "127.0.0.1"}
    file = tmp_path / "password"
    for host in ("192.0.2.1", "robots.example", "2001:db8::1"):
        with pytest.raises(InvalidSetting, match="give a --password-file"):
            ConsoleSettings.read(["--host", host])
        file.write_text("long enough\nnot this line\n")
        read = ConsoleSettings.read(["--host", host, "--password-file", str(file), "--viewers", "3"])
        assert (read.password, read.hosts, read.viewers) == ("long enough", {host}, 3)
    for content in (b"short", b"", b"\nlong enough", b"\xff\xfe"):
        file.write_bytes(content)
        with pytest.raises(InvalidSetting, match="--password-file"):
            ConsoleSettings.read(["--password-file", str(file)])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(settings.getpass, "getpass", lambda _: "typed by me")
    assert ConsoleSettings.read(["--host", "192.0.2.1"]).password == "typed by me"


def test_unusable_options_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    certificate = ("--certificate", "setup.cfg")
    for *arguments, option in (
        *(("--port", port, "--port") for port in ("70000", "-1")),
        *(("--host", host, "--host") for host in ("0.0.0.0", "no such host")),
        *((*certificate, "--certificate"), ("--key", "setup.cfg", "--certificate")),
        *((*certificate, "--key", "missing", "--key"), (*certificate, "--key", "setup.cfg", "--certificate")),
        ("--viewers", "0", "--viewers"),
        *((option, "missing", option) for option in ("--password-file", "--administrator", "--supervisor")),
    ):
        with pytest.raises(InvalidSetting) as raised:
            ConsoleSettings.read(arguments)
        assert option in raised.value.setting


def test_a_certificate_with_its_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    certificate, key = tmp_path / "c.pem", tmp_path / "k.pem"
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=localhost"]
    try:
        subprocess.run([*make, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True)
    except OSError:
        pytest.skip("openssl is not installed")
    read = ConsoleSettings.read(["--certificate", str(certificate), "--key", str(key)])
    assert (read.certificate, read.key) == (certificate, key)
    assert dates_problem(certificate) == ""
    now = time.time()
    for ahead_s in (-3600.0, 365 * 86400.0):  # as if the clock had been ahead when it was made; it has expired
        monkeypatch.setattr(time, "time", lambda ahead_s=ahead_s: now + ahead_s)
        assert f"{certificate} is valid from" in dates_problem(certificate)


def test_a_pin_opens_the_panel_of_its_robot_and_nothing_else() -> None:
    robots = {"A": "471193", "B/1 <b>": "222333"}
    app = Access(PlainTextResponse("inside"), LOOPBACK_HOSTS, PASSWORD, pause_s=0.0, pins=robots)

    def open_by(robot: str, pin: str) -> Answer:
        return ask(app, "/login", "POST", [urlencode({"password": pin, "robot": robot}).encode()])

    assert b"PIN of B/1 &lt;b&gt;" in ask(app, "/panel/B/1 <b>", accept="text/html").body
    assert b'type="password"' in ask(app, "/panel/C", accept="text/html").body
    for robot, pin in (
        ("A", "471194"),
        ("A", robots["B/1 <b>"]),
        ("A", PASSWORD),
        ("C", robots["A"]),
        ("", robots["A"]),
    ):
        refused = open_by(robot, pin)
        assert refused.status == 401 and "set-cookie" not in refused.headers, (robot, pin)
    assert b"The PIN is wrong" in open_by("A", "").body
    for robot, other in (("A", "B/1 <b>"), ("B/1 <b>", "A")):
        opened = open_by(robot, robots[robot])
        assert opened.headers["location"] == f"/panel/{quote(robot, safe='')}"
        cookie = cookie_of(opened)
        panel, calls = f"/panel/{robot}", f"/panel-call/panel_run/{robot}"
        for path in (panel, calls, "/static/panel.js", "/_nicegui/1/static/nicegui.js"):
            assert ask(app, path, cookie=cookie).body == b"inside", path
        ways_around = (f"{panel}/", f"/panel-call/panel_run/{other}", f"/panel-call/{robot}", f"{calls}/x", "/panel/")
        for path in ("/", "/3d", "/call/stop_all", "/plan", f"/panel/{other}", *ways_around):
            assert ask(app, path, cookie=cookie).status == 401, path
        assert ask(app, "/live", kind="websocket", cookie=cookie).body == b""
        claim, _, signature = cookie.rpartition(".")
        assert ask(app, "/", cookie=f"{claim.rpartition('.')[0]}..{signature}").status == 401, "all pages"
    opened = open_by("C", PASSWORD)
    assert opened.headers["location"] == "/panel/C" and ask(app, "/", cookie=cookie_of(opened)).body == b"inside"


def test_pins_are_digits_of_named_robots_and_need_a_password(tmp_path: Path) -> None:
    pins, password = tmp_path / "pins", tmp_path / "password"
    password.write_text(PASSWORD)
    protected = ("--password-file", str(password), "--pin-file", str(pins))
    pins.write_text("A 471193\n\n B 1  222333444555\n")
    assert ConsoleSettings.read(protected).pins == {"A": "471193", "B 1": "222333444555"}
    with pytest.raises(InvalidSetting, match="give a --password-file too"):
        ConsoleSettings.read(protected[2:])
    for content in ("A", "471193", "A 47119", "A 4711931234567", "A 47119x", "A \u0664\u0667\u0661\u0661\u0669\u0663"):
        pins.write_text(f"B 222333\n{content}")
        with pytest.raises(InvalidSetting, match="line 2 is not a name, a blank and 6 to 12 digits"):
            ConsoleSettings.read(protected)
    for missing in (("--pin-file", str(tmp_path / "none")), ("--programs", str(pins))):
        with pytest.raises(InvalidSetting) as raised:
            ConsoleSettings.read((*protected[:2], *missing))
        assert raised.value.setting == missing[0]
