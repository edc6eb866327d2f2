"""Connections: those that arrive while a server starts, what idle ones cost, and which end when there are too many."""

from __future__ import annotations

import contextlib
import resource
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.corba import connections
from robocorba.corba.connections import ConnectionLimit, raise_descriptor_limit
from robocorba.testing.processes import eventually
from tests.waits import outlast


class Server:
    """A listening socket, and the connections that it has accepted."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._listening = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self.accepted: list[socket.socket] = []

    def client(self) -> socket.socket:
        """A new connection of a client."""
        client = self._stack.enter_context(socket.create_connection(self._listening.getsockname()))
        self.accepted.append(self._stack.enter_context(self._listening.accept()[0]))
        client.setblocking(False)
        return client

    def call(self, client: socket.socket) -> None:
        """A request and its answer."""
        accepted = next(each for each in self.accepted if each.getpeername() == client.getsockname())
        client.send(b"?")
        assert accepted.recv(1) == b"?"
        accepted.send(b"!")
        eventually(lambda: received(client) == b"!")


@pytest.fixture
def server() -> Iterator[Server]:
    with ExitStack() as stack:
        yield Server(stack)


def received(client: socket.socket) -> bytes | None:
    """What has arrived; None if nothing has, empty at the end of the connection."""
    try:
        return client.recv(100)
    except BlockingIOError:
        return None


def has_ended(client: socket.socket) -> bool:
    return received(client) in (b"", connections._CLOSE_CONNECTION)


def check(excess: int) -> None:
    ConnectionLimit(len(connections.OwnDescriptors().in_use()) - excess).check()


def test_the_number_of_connections_is_limited(server: Server) -> None:
    clients = [server.client() for _ in range(3)]
    check(-1)
    assert not any(has_ended(client) for client in clients)
    ConnectionLimit(connections=2).check()
    assert sum(has_ended(client) for client in clients) == 1


def test_the_longest_idle_connection_ends(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "UNANSWERED_S", 0.0)
    robot, idle, stalled = (server.client() for _ in range(3))
    for client in (robot, idle):
        server.call(client)
    stalled.send(b"GIOP\1\2\1\0")
    outlast(0.01)  # the kernel counts milliseconds
    server.call(robot)
    check(1)
    assert (has_ended(stalled), has_ended(idle), has_ended(robot)) == (True, False, False)
    check(2)
    assert (has_ended(idle), has_ended(robot)) == (True, True)


def test_a_connection_that_this_process_has_opened_stays(server: Server) -> None:
    client = server.client()
    check(100)
    assert has_ended(client)
    client.getpeername()  # only its other end was shut down


def test_the_soft_limit_rises_to_the_hard_one() -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, before[1]))
        assert raise_descriptor_limit(300) == 300
        assert raise_descriptor_limit(250) == 300
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (300, before[1])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


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


class StartingServer:
    """A server that serves its object when `start` is called."""

    def __init__(self, process: subprocess.Popen[str], port: int) -> None:
        self._process, self.port = process, port
        assert process.stdin and process.stdout
        self._input, self._output = process.stdin, process.stdout
        assert self._output.readline() == "listens\n"

    def start(self) -> None:
        print(file=self._input, flush=True)
        assert self._output.readline() == "serves\n"

    def end(self) -> int:
        print("end", file=self._input, flush=True)
        return self._process.wait(30.0)


@pytest.fixture
def starting() -> Iterator[StartingServer]:
    with claimed_ports() as port:
        command = [sys.executable, "-c", SERVER.format(port=port)]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
            try:
                yield StartingServer(process, port)
            finally:
                process.kill()


class Client:
    """A client that asks, by GIOP 1.0, for the number of threads that Python knows."""

    def __init__(self, stack: contextlib.ExitStack, port: int) -> None:
        self._socket = stack.enter_context(socket.create_connection(("127.0.0.1", port), CONNECT_LIMIT_S))

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


def test_calls_wait_while_a_server_starts(starting: StartingServer) -> None:
    with contextlib.ExitStack() as stack:
        clients = [Client(stack, starting.port) for _ in range(CONNECTIONS)]
        for client in clients:
            client.ask()
        with pytest.raises(TimeoutError):
            clients[0].answer(0.3)
        starting.start()
        assert {client.answer(60.0)[0] for client in clients} == {0}
        late = Client(stack, starting.port)
        late.ask()
        assert late.answer(60.0)[0] == 0
    assert starting.end() == 0


def test_python_knows_no_threads_of_connections_without_calls(starting: StartingServer) -> None:
    """Hundreds of such threads stop a process for seconds when they end at the same time."""
    starting.start()
    with contextlib.ExitStack() as stack:
        *_, last = (Client(stack, starting.port) for _ in range(CONNECTIONS + 1))
        last.ask()
        assert last.answer(60.0)[1] < 20
    assert starting.end() == 0


def test_a_server_ends_although_it_has_not_served_yet(starting: StartingServer) -> None:
    with contextlib.ExitStack() as stack:
        client = Client(stack, starting.port)
        client.ask()
        assert starting.end() == 0


def test_a_server_opens_while_clients_connect() -> None:
    """omniORB frees what its accepting thread uses, when its reports are ended by its own function."""
    with claimed_ports() as port:
        command = [sys.executable, "-c", RESTARTS.format(port=port, times=150)]
        assert subprocess.run(command, timeout=120.0, check=False).returncode == 0
