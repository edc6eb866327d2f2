"""Clients that do what no client should, for tests and benches: nobody else may be harmed."""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import threading
from collections.abc import Callable, Iterator

from omniORB import CORBA

from robocorba.settings import Address

#: The beginning of a GIOP 1.2 request with 100 bytes.
_HEADER = b"GIOP\1\2\1\0" + struct.pack("<I", 100)
#: What arrives before the silence: a part of the header, the header, a part of the request, nothing.
PARTS = (_HEADER[:6], _HEADER, _HEADER + bytes(40), b"")


@contextlib.contextmanager
def stalled_connections(server: Address, count: int) -> Iterator[list[socket.socket]]:
    """Connections to a server, each silent after a part of a request, as if its client had lost the network."""
    with contextlib.ExitStack() as stack:
        connections = []
        for part, _ in zip(itertools.cycle(PARTS), range(count), strict=False):
            connection = stack.enter_context(socket.create_connection((server.host, server.port), timeout=10.0))
            connection.sendall(part)
            connections.append(connection)
        yield connections


@contextlib.contextmanager
def callers(call: Callable[[], object], count: int) -> Iterator[None]:
    """Threads that each repeat a call without a pause, whatever it answers."""
    ending = threading.Event()

    def repeat() -> None:
        while not ending.is_set():
            with contextlib.suppress(CORBA.Exception):
                call()

    threads = [threading.Thread(target=repeat, name="caller", daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ending.set()
        for thread in threads:
            thread.join()
