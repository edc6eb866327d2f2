"""Which connections end when there are too many."""

from __future__ import annotations

import resource
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

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


def test_nothing_ends_below_the_limit(server: Server) -> None:
    clients = [server.client() for _ in range(3)]
    check(-1)
    assert not any(has_ended(client) for client in clients)


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


def test_the_number_of_connections_is_limited(server: Server) -> None:
    clients = [server.client() for _ in range(3)]
    ConnectionLimit(connections=2).check()
    assert sum(has_ended(client) for client in clients) == 1


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
