"""Clients that do what no client should, for tests and benches: nobody else may be harmed.

    python -m robocorba.testing.attacks NAMING pictures|readings|maps|edits COUNT

COUNT clients repeat calls until a line on stdin."""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import Launcher

#: The beginning of a GIOP 1.2 request with 100 bytes.
_HEADER = b"GIOP\1\2\1\0" + struct.pack("<I", 100)
#: What arrives before the silence: a part of the header, the header, a part of the request, nothing.
PARTS = (_HEADER[:6], _HEADER, _HEADER + bytes(40), b"")

#: Of the nodes that are created, so that no two have the same name.
_numbers = itertools.count()


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
def greedy_clients(launch: Launcher, naming: Address, calls: str, count: int) -> Iterator[None]:
    """A process whose `count` threads repeat calls without a pause: `pictures`, `readings`, `maps` or `edits`."""
    if not count:
        yield
        return
    process = launch(sys.executable, "-m", __name__, str(naming), calls, str(count))
    assert process.stdout is not None and process.stdin is not None
    assert process.stdout.readline() == "ready\n"
    try:
        yield
    finally:
        process.stdin.write("end\n")
        process.stdin.flush()
        process.wait()


def main(naming: str, calls: str, count: str) -> None:
    with Orb(Address.parse(naming)) as orb:
        server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        kinds = itertools.cycle(RoboCorba.ElementKind._items)
        call: Callable[[], object] = {
            "pictures": lambda: server.renderFloor("L1", 4096),
            "readings": lambda: database.getFloor("L1"),
            "maps": lambda: (editor.exportMap(), editor.elements(next(kinds), "L1"), editor.checkFloor("L1", 0.4)),
            "edits": lambda: _edit(editor),
        }[calls]
        ending = threading.Event()
        threads = [threading.Thread(target=_repeat, args=(call, ending), daemon=True) for _ in range(int(count))]
        for thread in threads:
            thread.start()
        print("ready", flush=True)
        sys.stdin.readline()
        ending.set()
        for thread in threads:
            thread.join()


def _edit(editor: Any) -> None:
    """An edit in an edit session of its own, which is undone."""
    session = editor.openSession("somebody")
    try:
        number = next(_numbers)
        node = RoboCorba.PathNode(f"n{number}", RoboCorba.XY(1.0 + number % 10, 1.0), "")
        session.create("L1", RoboCorba.Element(aNode=node))
        session.undo()
    finally:
        session.close()


def _repeat(call: Callable[[], object], ending: threading.Event) -> None:
    while not ending.is_set():
        with contextlib.suppress(CORBA.Exception):
            call()


if __name__ == "__main__":
    main(*sys.argv[1:])
