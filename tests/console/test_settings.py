"""The console's options: other machines need a password, and files must be there."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import pytest

from robocorba.console import settings
from robocorba.console.settings import ConsoleSettings, check_installed, dates_problem
from robocorba.errors.services import ServiceError
from robocorba.settings import InvalidSetting


@pytest.fixture(autouse=True)
def nobody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)


def test_the_loopback_needs_no_password(tmp_path: Path) -> None:
    read = ConsoleSettings.read(["--state", str(tmp_path)])
    assert (read.host, read.port, read.password) == ("127.0.0.1", 8800, "")
    assert "localhost" in read.hosts
    assert (read.viewers, ConsoleSettings.read(["--viewers", "3"]).viewers) == (64, 3)
    assert (read.administrator, read.supervisor) == (None, tmp_path / "supervisor.ior")


@pytest.mark.parametrize("host", ["127.0.0.2", "::1", "localhost"])
def test_every_loopback_address_is_its_own_host_name(host: str) -> None:
    assert ConsoleSettings.read(["--host", host]).hosts >= {host, "localhost", "127.0.0.1"}


@pytest.mark.parametrize("host", ["192.0.2.1", "robots.example", "2001:db8::1"])
def test_other_addresses_need_one(host: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidSetting, match="give a --password-file"):
        ConsoleSettings.read(["--host", host])
    file = tmp_path / "password"
    file.write_text("long enough\nnot this line\n")
    read = ConsoleSettings.read(["--host", host, "--password-file", str(file)])
    assert read.password == "long enough"
    assert read.hosts == {host}


def test_a_password_is_asked_for_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(settings.getpass, "getpass", lambda _: "typed by me")
    assert ConsoleSettings.read(["--host", "192.0.2.1"]).password == "typed by me"


@pytest.mark.parametrize("content", ["short", "", "\nlong enough", "\xff\xfe"])
def test_bad_passwords(content: str, tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_bytes(content.encode("latin-1"))
    with pytest.raises(InvalidSetting, match="--password-file"):
        ConsoleSettings.read(["--password-file", str(file)])


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("--port", "70000"), "--port"),
        (("--port", "-1"), "--port"),
        (("--host", "0.0.0.0"), "--host"),
        (("--host", "no such host"), "--host"),
        (("--password-file", "missing"), "--password-file"),
        (("--certificate", "setup.cfg"), "--certificate"),
        (("--key", "setup.cfg"), "--certificate"),
        (("--certificate", "setup.cfg", "--key", "missing"), "--key"),
        (("--certificate", "setup.cfg", "--key", "setup.cfg"), "--certificate"),
        (("--viewers", "0"), "--viewers"),
        (("--administrator", "missing"), "--administrator"),
        (("--supervisor", "missing"), "--supervisor"),
    ],
)
def test_unusable_options_are_named(arguments: tuple[str, ...], option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
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


def test_without_its_packages_the_console_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    check_installed()
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(ServiceError, match=r"pip install 'robocorba\[console\]'"):
        check_installed()
