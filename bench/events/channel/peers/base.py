"""The interface of a broker in these benches."""

from __future__ import annotations

import contextlib
import importlib.util
import shutil
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple, Protocol

Receive = Callable[[Sequence[bytes]], None]
_START_LIMIT_S = 20.0
#: Debian installs servers in folders that are not in the PATH of ordinary users.
_SERVER_FOLDERS = "/usr/sbin:/usr/local/sbin"


class Broker(NamedTuple):
    """A running broker. pid: of the process that forwards the events."""

    address: str
    pid: int


class Supplier(Protocol):
    """A connection that sends."""

    def push(self, payload: bytes) -> None:
        """Send one event, as the client library sends one."""

    def flood(self, payloads: Iterable[bytes]) -> None:
        """Send events one by one as fast as possible; all are sent when it returns."""

    def push_run(self, payloads: Sequence[bytes]) -> None:
        """Send several events in one call. Raises NotImplementedError if the client library has no such call."""


class Peer(Protocol):
    """A broker of one kind, and its Python client."""

    name: str
    #: Whether its client has a call that sends several events.
    batches: bool

    def missing(self) -> str:
        """What is not installed here, empty if the peer can run."""

    def broker(self, folder: Path, start: Start) -> AbstractContextManager[Broker]:
        """The broker, while the `with` lasts."""

    def supplier(self, address: str) -> AbstractContextManager[Supplier]:
        """A connection that sends."""

    def consumer(self, address: str, receive: Receive) -> AbstractContextManager[None]:
        """A connection that receives everything from the moment that the `with` begins."""


class Start(Protocol):
    """Starts a process that ends with the bench; its output goes to a file in the folder of the bench."""

    def __call__(self, *command: str) -> int:
        """The process id."""


class OneByOne:
    """Base of suppliers whose library sends single events only."""

    def push(self, payload: bytes) -> None:
        raise NotImplementedError

    def flood(self, payloads: Iterable[bytes]) -> None:
        push = self.push
        for payload in payloads:
            push(payload)

    def push_run(self, payloads: Sequence[bytes]) -> None:
        raise NotImplementedError


def program(name: str) -> str:
    """Path of a program, empty if it is not installed."""
    return shutil.which(name) or shutil.which(name, path=_SERVER_FOLDERS) or ""


def lacking(*, programs: Sequence[str] = (), modules: Sequence[str] = ()) -> str:
    """The programs and modules that are not installed, as text."""
    absent = [name for name in programs if not program(name)]
    absent += [name for name in modules if importlib.util.find_spec(name) is None]
    return ", ".join(absent)


def free_port() -> int:
    """A free TCP port of the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listening(port: int) -> None:
    """Wait until a process listens on a port of the loopback interface. Raises TimeoutError."""
    deadline = time.monotonic() + _START_LIMIT_S
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        time.sleep(0.02)
    raise TimeoutError(f"no process listens on port {port} after {_START_LIMIT_S:g} s")


def split(address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT."""
    host, _, port = address.rpartition(":")
    return host, int(port)
