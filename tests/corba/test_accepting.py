"""Connections that arrive while a server starts, and what connections without calls cost."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator

import pytest

from robocorba.claimed_ports import claimed_ports

#: More than omniORB lets wait.
CONNECTIONS = 200
#: Time limit of a connection [s]. One that does not fit into the queue is tried again after 1 s, then after 3 s.
CONNECT_LIMIT_S = 0.9

SERVER = """
import sys
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba__POA

class Planner(RoboCorba__POA.PathPlanner):
    def _get_mapVersion(self):
        return len(sys._current_frames())

with Orb(Address("127.0.0.1", 9), Address("127.0.0.1", {port})) as orb:
    print("listens", flush=True)
    if sys.stdin.readline() == "end\\n":
        sys.exit()
    orb.activate(Planner(), "Planner")
    orb.accept_calls()
    print("serves", flush=True)
    sys.stdin.readline()
"""


RESTARTS = """
import socket, threading
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba__POA

class Planner(RoboCorba__POA.PathPlanner):
    def _get_mapVersion(self):
        return 1

def connect():
    while not is_over.is_set():
        try:
            socket.create_connection(("127.0.0.1", {port})).close()
        except OSError:
            pass

is_over = threading.Event()
connecting = threading.Thread(target=connect)
connecting.start()
for _ in range({times}):
    with Orb(Address("127.0.0.1", 9), Address("127.0.0.1", {port})) as orb:
        orb.activate(Planner(), "Planner")
        orb.accept_calls()
is_over.set()
connecting.join()
"""


class Server:
    """A server that serves its object when `start` is called."""

    def __init__(self, process: subprocess.Popen[str], port: int) -> None:
        self._process, self.port = process, port
        assert self._line() == "listens"

    def start(self) -> None:
        self._say()
        assert self._line() == "serves"

    def end(self) -> int:
        self._say("end")
        return self._process.wait(30.0)

    def _say(self, what: str = "") -> None:
        assert self._process.stdin
        self._process.stdin.write(f"{what}\n")
        self._process.stdin.flush()

    def _line(self) -> str:
        assert self._process.stdout
        return self._process.stdout.readline().strip()


@pytest.fixture
def server() -> Iterator[Server]:
    with claimed_ports() as port:
        command = [sys.executable, "-c", SERVER.format(port=port)]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
            try:
                yield Server(process, port)
            finally:
                process.kill()


class Client:
    """A client that asks, by GIOP 1.0, for the number of threads that Python knows."""

    def __init__(self, stack: contextlib.ExitStack, port: int, timeout_s: float = CONNECT_LIMIT_S) -> None:
        self._socket = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout_s))

    def ask(self) -> None:
        operation = b"_get_mapVersion\0"
        body = struct.pack("<IIB3x", 0, 1, 1)  # no contexts, request 1, an answer is expected
        body += struct.pack("<I7sx", 7, b"Planner") + struct.pack("<I", len(operation)) + operation
        body += struct.pack("<I", 0)  # nobody
        self._socket.sendall(b"GIOP\1\0\1\0" + struct.pack("<I", len(body)) + body)

    def answer(self, timeout_s: float) -> tuple[int, int]:
        """The status of the reply, 0 for a result, and the result. Raises TimeoutError."""
        self._socket.settimeout(timeout_s)
        header = self._socket.recv(12, socket.MSG_WAITALL)
        size = struct.unpack("<I", header[8:])[0]
        _, _, status, result = struct.unpack("<IIII", self._socket.recv(size, socket.MSG_WAITALL)[:16])
        return status, result


def test_calls_wait_while_a_server_starts(server: Server) -> None:
    with contextlib.ExitStack() as stack:
        clients = [Client(stack, server.port) for _ in range(CONNECTIONS)]
        for client in clients:
            client.ask()
        with pytest.raises(TimeoutError):
            clients[0].answer(0.3)
        server.start()
        assert {client.answer(60.0)[0] for client in clients} == {0}
        late = Client(stack, server.port)
        late.ask()
        assert late.answer(60.0)[0] == 0
    assert server.end() == 0


def test_a_server_ends_although_it_has_not_served_yet(server: Server) -> None:
    with contextlib.ExitStack() as stack:
        client = Client(stack, server.port)
        client.ask()
        assert server.end() == 0


def test_python_knows_no_threads_of_connections_without_calls(server: Server) -> None:
    """Hundreds of such threads stop a process for seconds when they end at the same time."""
    server.start()
    with contextlib.ExitStack() as stack:
        idle = [Client(stack, server.port) for _ in range(CONNECTIONS)]
        assert idle
        last = Client(stack, server.port)
        last.ask()
        assert last.answer(60.0)[1] < 20
    assert server.end() == 0


def test_a_server_opens_while_clients_connect() -> None:
    """omniORB frees what its accepting thread uses, when its reports are ended by its own function."""
    with claimed_ports() as port:
        command = [sys.executable, "-c", RESTARTS.format(port=port, times=150)]
        assert subprocess.run(command, timeout=120.0, check=False).returncode == 0
