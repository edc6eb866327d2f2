"""The common interface of the brokers in these benches."""

from __future__ import annotations

import contextlib
import importlib.util
import shutil
import socket
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from robocorba.system.claimed_ports import claimed_ports
from testkit.processes import eventually

#: Takes the payloads that arrived in one call.
Receive = Callable[[Sequence[bytes]], None]
#: Starts a command as a process that ends with the bench, and returns its process id.
Start = Callable[..., int]
#: Size of the payload of every event.
PAYLOAD_BYTES = 100
#: Timeout for a broker to listen, and for a client to connect [s].
START_LIMIT_S = 60.0
#: Debian installs servers in folders that are not in the PATH of ordinary users.
_SERVER_FOLDERS = "/usr/sbin:/usr/local/sbin"
_claims = contextlib.ExitStack()


class Broker(NamedTuple):
    """A running broker. pid: of the process that forwards the events."""

    address: str
    pid: int


@dataclass(frozen=True)
class Supplier:
    """A connection that sends. push: sends one event, as the client library does. push_run: sends several in one
    call."""

    push: Callable[[bytes], object]
    push_run: Callable[[Sequence[bytes]], object] | None = None

    def flood(self, payloads: Iterable[bytes]) -> None:
        """Send events one by one as fast as possible; all are sent when it returns."""
        push = self.push
        for payload in payloads:
            push(payload)


@dataclass(frozen=True)
class Peer:
    """A broker of one kind, and its Python client.

    broker: starts it, with files in a folder. supplier: a connection that sends to an address. consumer: a connection
    that receives everything from the moment that its `with` begins. programs, modules: what they need."""

    name: str
    broker: Callable[[Start, Path], Broker]
    supplier: Callable[[str], AbstractContextManager[Supplier]]
    consumer: Callable[..., AbstractContextManager[None]]
    programs: Sequence[str] = ()
    modules: Sequence[str] = ()

    def missing(self) -> str:
        """What is not installed here, empty if the peer can run."""
        absent = [name for name in self.programs if not program(name)]
        absent += [name for name in self.modules if importlib.util.find_spec(name) is None]
        return ", ".join(absent)


def server(*command: str, settings: str = "") -> Callable[[Start, Path], Broker]:
    """Starts a command and waits until it listens. In the command {0} is its port, {folder} its folder, and {file} a
    file with the `settings`."""

    def start_server(start: Start, folder: Path) -> Broker:
        (port,) = free_ports(1)
        file = folder / f"settings-{port}"
        file.write_text(settings.format(port))
        name, *arguments = (part.format(port, folder=folder, file=file) for part in command)
        pid = start(program(name), *arguments)
        eventually(lambda: _listens(port), START_LIMIT_S, f"{name} at its port")
        return Broker(f"127.0.0.1:{port}", pid)

    return start_server


def free_ports(count: int) -> list[int]:
    """Free ports, claimed until this process ends."""
    first = _claims.enter_context(claimed_ports())
    return list(range(first, first + count))


def program(name: str) -> str:
    """Path of a program, empty if it is not installed."""
    return shutil.which(name) or shutil.which(name, path=_SERVER_FOLDERS) or ""


def split(address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT."""
    host, _, port = address.rpartition(":")
    return host, int(port)


def _listens(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False
