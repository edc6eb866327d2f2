"""What a broker has to offer to be compared."""

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
#: Debian keeps servers where the path of an ordinary user does not lead.
_SERVER_FOLDERS = "/usr/sbin:/usr/local/sbin"


class Broker(NamedTuple):
    """A broker that runs. pid: of the process that passes the events on."""

    address: str
    pid: int


class Supplier(Protocol):
    """A connection that sends."""

    def push(self, payload: bytes) -> None:
        """Send one event, as the client library sends one."""

    def flood(self, payloads: Iterable[bytes]) -> None:
        """Send them one after another as fast as it goes; all are on their way when it returns."""

    def push_run(self, payloads: Sequence[bytes]) -> None:
        """Send several in one go. Raises NotImplementedError where the client library has no such call."""


class Peer(Protocol):
    """A broker of one kind, and its Python client."""

    name: str
    #: Whether its client has a call that sends several events.
    batches: bool

    def missing(self) -> str:
        """What is not installed here, empty where it can run."""

    def broker(self, folder: Path, start: Start) -> AbstractContextManager[Broker]:
        """The broker, while the `with` lasts."""

    def supplier(self, address: str) -> AbstractContextManager[Supplier]:
        """A connection that sends."""

    def consumer(self, address: str, receive: Receive) -> AbstractContextManager[None]:
        """A connection that receives everything from the moment that the `with` begins."""


class Start(Protocol):
    """Starts a process that lives as long as the bench; its output goes to a file of the bench's folder."""

    def __call__(self, *command: str) -> int:
        """The process id."""


class OneByOne:
    """Base of suppliers whose library knows single events only."""

    def push(self, payload: bytes) -> None:
        raise NotImplementedError

    def flood(self, payloads: Iterable[bytes]) -> None:
        push = self.push
        for payload in payloads:
            push(payload)

    def push_run(self, payloads: Sequence[bytes]) -> None:
        raise NotImplementedError


def program(name: str) -> str:
    """Where a program is, empty where there is none."""
    return shutil.which(name) or shutil.which(name, path=_SERVER_FOLDERS) or ""


def lacking(*, programs: Sequence[str] = (), modules: Sequence[str] = ()) -> str:
    """Which of them are not installed, as text."""
    absent = [name for name in programs if not program(name)]
    absent += [name for name in modules if importlib.util.find_spec(name) is None]
    return ", ".join(absent)


def free_port() -> int:
    """A TCP port of loopback that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listening(port: int) -> None:
    """Wait until somebody listens there. Raises TimeoutError."""
    deadline = time.monotonic() + _START_LIMIT_S
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        time.sleep(0.02)
    raise TimeoutError(f"nobody listens on port {port}")


def split(address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT."""
    host, _, port = address.rpartition(":")
    return host, int(port)
