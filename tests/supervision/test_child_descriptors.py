"""The connections to a child that has no limit of its own."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from robocorba.corba.connections import ConnectionLimit, OwnDescriptors
from robocorba.supervision.child_descriptors import ChildDescriptors
from robocorba.testing.processes import eventually

#: Accepts connections, and keeps them until their clients end.
SERVER = """
import socket
listening = socket.create_server(("127.0.0.1", 0))
print(listening.getsockname()[1], flush=True)
kept = []
while True:
    kept.append(listening.accept()[0])
    print(len(kept), flush=True)
"""


@pytest.fixture
def child() -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, "-c", SERVER], stdout=subprocess.PIPE, text=True) as child:
        yield child
        child.kill()


@pytest.fixture
def clients(child: subprocess.Popen[str]) -> Iterator[list[socket.socket]]:
    assert child.stdout is not None
    port = int(child.stdout.readline())
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(10)]
        while int(child.stdout.readline()) < len(clients):
            pass
        yield clients


def ended(clients: list[socket.socket]) -> int:
    count = 0
    for client in clients:
        client.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            client.recv(100)
            count += 1
    return count


def test_too_many_connections_to_a_child_end(child: subprocess.Popen[str], clients: list[socket.socket]) -> None:
    descriptors = ChildDescriptors("a child", lambda: child.pid)
    own = len(OwnDescriptors().in_use())
    with contextlib.closing(descriptors):
        descriptors.renew()
        if not any(_is_readable(descriptors, each) for each in descriptors.in_use()):
            pytest.skip("this system does not let a process have the descriptors of its child")
        ConnectionLimit(connections=10, process=descriptors).check()
        assert ended(clients) == 0
        ConnectionLimit(connections=7, process=descriptors).check()
        eventually(lambda: ended(clients) == 3)
    assert len(OwnDescriptors().in_use()) == own


def _is_readable(descriptors: ChildDescriptors, descriptor: int) -> bool:
    with contextlib.suppress(OSError), descriptors.borrowed(descriptor):
        return True
    return False


def test_without_a_child_nothing_ends() -> None:
    descriptors = ChildDescriptors("a child", lambda: 0)
    limit = ConnectionLimit(connections=0, process=descriptors)
    limit.check()
    assert descriptors.in_use() == ()
