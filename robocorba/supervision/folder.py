"""The state folder of a system: who holds it, which port each server has, what runs now.

lock          held (flock) by the `robocorba up` that uses the folder
ports.json    the port of each server, kept so that references survive restarts
links.json    the peers that each event channel was given
up.json       what runs now, replaced whole at every change
logs/         a file for each process
omninames/    the bindings of the naming service
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import psutil

from robocorba.errors.services import AlreadyRunning, PortInUse, ServiceError
from robocorba.settings import Address

T = TypeVar("T")


class ProcessRecord(msgspec.Struct):
    """A process as up.json tells it; `started` in POSIX seconds, `pid` 0 while it waits for its next start."""

    name: str
    state: str
    pid: int
    endpoint: str
    names: tuple[str, ...]
    started: float
    restarts: int


class SystemRecord(msgspec.Struct):
    """What up.json holds: the naming service's address, the supervisor and its processes."""

    naming: str
    pid: int
    created: float
    processes: tuple[ProcessRecord, ...]

    @property
    def is_alive(self) -> bool:
        """Whether the supervisor that wrote it still runs; a process id alone could be somebody else's by now."""
        try:
            return abs(psutil.Process(self.pid).create_time() - self.created) < 1.0
        except psutil.Error:
            return False


@dataclass(frozen=True)
class StateFolder:
    """Reading and writing what stands at the top of this file."""

    path: Path

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    @property
    def names(self) -> Path:
        return self.path / "omninames"

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder, made where there is none. Raises AlreadyRunning, or ServiceError where it can't be used.

        The kernel lets go of the lock when this process ends, however it ends."""
        try:
            self.names.mkdir(parents=True, exist_ok=True)
            lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as wrong:
            raise ServiceError(f"can't use the state folder {self.path}: {wrong.strerror}") from None
        try:
            self._take(lock)
            yield
        finally:
            os.close(lock)

    def _take(self, lock: int) -> None:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            record = self.read_record()
            who = f" (process id {record.pid})" if record and record.is_alive else ""
            raise AlreadyRunning(f"another robocorba up{who} uses the state folder {self.path}") from None

    def ports(self, servers: Sequence[str], naming: Address) -> dict[str, int]:
        """The port of each server on the naming service's host: the one it had, else the first free one after
        the naming service's, remembered from now on. Raises PortInUse where one that it had is taken."""
        file = self.path / "ports.json"
        remembered = self._read(file, dict[str, int]) or {}
        for server in servers:
            port = remembered.get(server)
            if port is None:
                remembered[server] = self._next_port(naming, {naming.port, *remembered.values()})
            elif port == naming.port or not is_free(naming.host, port):
                raise PortInUse(naming.host, port, f"{server} (remembered in {file})")
        self._write(file, remembered)
        return {server: remembered[server] for server in servers}

    def _next_port(self, naming: Address, taken: set[int]) -> int:
        for port in range(naming.port + 1, 65536):
            if port not in taken and is_free(naming.host, port):
                return port
        raise ServiceError(f"no port above {naming.port} is free on {naming.host}")

    def links(self) -> dict[str, list[str]]:
        """The peers of each event channel, as the systems in this folder linked them."""
        return self._read(self.path / "links.json", dict[str, list[str]]) or {}

    def write_links(self, links: Mapping[str, Sequence[str]]) -> None:
        self._write(self.path / "links.json", links)

    def write_record(self, record: SystemRecord) -> None:
        self._write(self.path / "up.json", record)

    def read_record(self) -> SystemRecord | None:
        """What runs, or ran last, here; None where nothing did. Raises ServiceError for a damaged file."""
        return self._read(self.path / "up.json", SystemRecord)

    def remove_record(self) -> None:
        (self.path / "up.json").unlink(missing_ok=True)

    def _read(self, file: Path, schema: type[T]) -> T | None:
        try:
            return msgspec.json.decode(file.read_bytes(), type=schema)
        except FileNotFoundError:
            return None
        except OSError as wrong:
            raise ServiceError(f"can't read {file}: {wrong.strerror}") from None
        except msgspec.MsgspecError as wrong:
            raise ServiceError(f"{file} is damaged ({wrong}); remove it") from None

    def _write(self, file: Path, content: object) -> None:
        """Readers see the old file or the new one, never a part. The lock makes us the only writer."""
        fresh = file.with_suffix(".new")
        try:
            fresh.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2))
            fresh.replace(file)
        except OSError as wrong:
            raise ServiceError(f"can't write {file}: {wrong.strerror}") from None


def is_free(host: str, port: int) -> bool:
    """Whether a server could listen there. Raises ServiceError where `host` is another machine or the port denied."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            # As omniORB does: connections that linger in TIME_WAIT don't keep a server from its port.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except socket.gaierror:
        raise ServiceError(f"{host} is not known as a host") from None
    except OSError as wrong:
        if wrong.errno == errno.EADDRINUSE:
            return False
        if wrong.errno == errno.EADDRNOTAVAIL:
            raise ServiceError(f"{host} is not an address of this machine") from None
        raise ServiceError(f"can't listen on {host}:{port}: {wrong.strerror}") from None
    return True
