"""Settings of the console."""

from __future__ import annotations

import argparse
import getpass
import re
import ssl
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from robocorba.system.decoding import read_text
from robocorba.system.names import SUPERVISOR
from robocorba.system.settings import AddArgument, Address, InvalidSetting, Settings, add_common_options

#: Default port of the console.
DEFAULT_PORT = 8800
#: Shortest password on an address that other machines reach.
MIN_PASSWORD = 8
#: Default of the number of pages that are served at the same time; each costs memory, and time of the event loop.
DEFAULT_VIEWERS = 64
LOOPBACK_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})


@dataclass(frozen=True)
class ConsoleSettings:
    """Settings of the console.

    port: 0 for any free one. password: empty for none. certificate, key: PEM files, None without TLS.
    administrator: file with the reference of the simulation's administrator, None for no such rights.
    supervisor: file with the reference of the system's supervisor; it need not exist. recording: a file to look at
    beside the running system, or None. viewers: the number of pages that are served at the same time. pins: those of
    the panels of robots, by name. programs: a folder of programs to offer beside the samples, or None."""

    common: Settings
    host: str
    port: int
    password: str
    certificate: Path | None
    key: Path | None
    administrator: Path | None
    supervisor: Path
    recording: Path | None = None
    viewers: int = DEFAULT_VIEWERS
    pins: Mapping[str, str] = field(default_factory=dict)
    programs: Path | None = None

    @property
    def hosts(self) -> frozenset[str]:
        """Host names by which browsers may call the console."""
        return frozenset({self.host}) | (LOOPBACK_HOSTS if Address(self.host, 1).is_loopback else frozenset())

    @staticmethod
    def add_arguments(add: AddArgument) -> None:
        add("--host", default="127.0.0.1", metavar="H", help="address to listen on; default: 127.0.0.1")
        add("--port", type=int, default=DEFAULT_PORT, metavar="N", help="port, 0 for any free one; default: 8800")
        add("--password-file", type=Path, metavar="FILE", help="file with the users' password in line 1")
        add("--certificate", type=Path, metavar="FILE", help="PEM certificate, to serve HTTPS")
        add("--key", type=Path, metavar="FILE", help="PEM key of --certificate")
        add(
            "--administrator",
            type=Path,
            metavar="FILE",
            help="administrator.ior of the state folder, to let users pause, evict and place robots",
        )
        add(
            "--supervisor",
            type=Path,
            metavar="FILE",
            help="reference to start robots and show processes by; default: supervisor.ior of the state folder",
        )
        add("--recording", type=Path, metavar="FILE", help="recording to offer too")
        add("--viewers", type=int, default=DEFAULT_VIEWERS, metavar="N", help="limit of open pages; default: 64")
        add(
            "--pin-file", type=Path, metavar="FILE", help="file with PINs of robots' panels: a line `NAME PIN` for each"
        )
        add("--programs", type=Path, metavar="DIR", help="folder of programs to offer besides the samples")
        add_common_options(add)

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> ConsoleSettings:
        """From the arguments of `add_arguments`. Asks for a password where one is needed and none is given. Raises
        InvalidSetting; SystemExit with a usage line for unknown arguments."""
        parser = argparse.ArgumentParser(prog="robocorba console", description=description, allow_abbrev=False)
        cls.add_arguments(parser.add_argument)
        given = parser.parse_args(arguments)
        if given.port:
            Address.checked(given.host, given.port, "--host or --port")
        else:
            Address.checked(given.host, 1, "--host")
        if (given.certificate is None) != (given.key is None):
            raise InvalidSetting("--certificate", str(given.certificate), "a certificate and its --key go together")
        files = {"--certificate": given.certificate, "--key": given.key}
        files |= {"--administrator": given.administrator, "--supervisor": given.supervisor}
        for option, file in files.items():
            if file is not None and not file.is_file():
                raise InvalidSetting(option, str(file), "there is no such file")
        if given.programs is not None and not given.programs.is_dir():
            raise InvalidSetting("--programs", str(given.programs), "there is no such folder")
        if given.certificate is not None:
            _check_certificate(given.certificate, given.key)
        if given.viewers < 1:
            raise InvalidSetting("--viewers", str(given.viewers), "expected 1 or more")
        common = Settings.read(given.naming, given.state)
        password = _password(given.host, given.password_file)
        return cls(
            common,
            given.host,
            given.port,
            password,
            given.certificate,
            given.key,
            given.administrator,
            given.supervisor or common.state / SUPERVISOR,
            given.recording,
            given.viewers,
            _pins(given.pin_file, password) if given.pin_file else {},
            given.programs,
        )


def _check_certificate(certificate: Path, key: Path) -> None:
    """Raises InvalidSetting for files that a server cannot use."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, OSError) as error:
        reason = getattr(error, "reason", "") or error.strerror or str(error)
        raise InvalidSetting("--certificate", str(certificate), f"not usable with {key} ({reason})") from None


def dates_problem(certificate: Path) -> str:
    """Why browsers refuse a self-signed certificate by its dates, if their clock shows the time of ours; empty if they
    do not. One that an authority has signed has the dates of its clock."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(certificate)
    for found in context.get_ca_certs():
        begin, end = str(found["notBefore"]), str(found["notAfter"])
        if not ssl.cert_time_to_seconds(begin) <= time.time() < ssl.cert_time_to_seconds(end):
            return (
                f"{certificate} is valid from {begin} to {end}, and now it is {datetime.now().astimezone():%c %Z}: "
                "browsers refuse it. Check the clock; if it was wrong when the certificate was made, make it again"
            )
    return ""


def _pins(file: Path, password: str) -> dict[str, str]:
    """PINs of robots by name. With six digits and an attempt a second guessing takes days."""
    if not password:
        raise InvalidSetting("--pin-file", str(file), "here everybody may open the console: give a --password-file too")
    try:
        lines = [line for line in read_text(file).splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidSetting("--pin-file", str(file), str(error)) from None
    pins = {}
    for number, line in enumerate(lines, 1):
        name, _, pin = line.strip().rpartition(" ")
        if not (name.strip() and re.fullmatch("[0-9]{6,12}", pin)):
            raise InvalidSetting("--pin-file", str(file), f"line {number} is not a name, a blank and 6 to 12 digits")
        pins[name.strip()] = pin
    return pins


def _password(host: str, file: Path | None) -> str:
    """The password to ask users for; empty if only this machine reaches the console and no file is given."""
    if file is not None:
        try:
            password = read_text(file).split("\n")[0].strip()
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidSetting("--password-file", str(file), str(error)) from None
    elif Address(host, 1).is_loopback:
        return ""
    elif not sys.stdin.isatty():
        raise InvalidSetting("--host", host, "other machines reach this address: give a --password-file")
    else:
        print(f"Other machines reach {host}: choose a password for the console.", file=sys.stderr)
        try:
            password = getpass.getpass("Password: ")
        except EOFError:
            raise InvalidSetting("password", "", "none was given") from None
    if len(password) < MIN_PASSWORD:
        raise InvalidSetting("--password-file" if file else "password", "", f"shorter than {MIN_PASSWORD} characters")
    return password
