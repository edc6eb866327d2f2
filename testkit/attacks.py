"""Clients that do what no client should, for tests and benches: nobody else may be harmed.

    python -m testkit.attacks NAMING pictures|readings|maps|edits|plans|scans COUNT

COUNT clients repeat calls until a line on stdin."""

from __future__ import annotations

import contextlib
import itertools
import math
import random
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.planning.request import MAX_ALTERNATIVES, MAX_AREAS, SMARTPAL_RADIUS_M, SMARTPAL_SPEED_M_S
from robocorba.stubs import RoboCorba
from robocorba.system.names import SENSORS
from robocorba.system.settings import Address
from testkit.json_process import checkout_command
from testkit.processes import Launcher
from testkit.simulation import NO_MOUNT, NO_NOISE

#: The beginning of a GIOP 1.2 request with 100 bytes.
_HEADER = b"GIOP\1\2\1\0" + struct.pack("<I", 100)
#: What arrives before the silence: a part of the header, the header, a part of the request, nothing.
PARTS = (_HEADER[:6], _HEADER, _HEADER + bytes(40), b"")

#: Timeout for opening a connection [s]. Loopback answers at once unless the server's backlog is full.
CONNECT_TIMEOUT_S = 2.0
#: Timeout for sending [s]. A server that reads no more must not hold up the next connection.
SEND_TIMEOUT_S = 0.2

#: Range of the coordinates of long requests, and the size of their obstacles [m].
REQUESTED_M, OBSTACLE_M = (1.0, 9.0), 0.05
#: As many rays as one call may want.
WHOLE_TURN = RoboCorba.ScanSpec(0.0, 2 * math.pi / RoboCorba.MAX_RAYS, RoboCorba.MAX_RAYS, 30.0, 0.0, NO_NOISE)
SCANNED = [RoboCorba.Pose("L1", 3.0, 3.0, 0.0)] * (RoboCorba.MAX_RAYS_OF_A_CALL // RoboCorba.MAX_RAYS)
#: Of the nodes that are created, so that no two have the same name.
_numbers = itertools.count()


@contextlib.contextmanager
def connections(server: Address, sent: Iterable[bytes]) -> Iterator[None]:
    """A connection to a server for each of `sent`, silent afterwards, until the end of the `with`. What the server
    refuses is left out."""
    with contextlib.ExitStack() as stack:
        for each in sent:
            with contextlib.suppress(OSError):
                connection = socket.create_connection((server.host, server.port), CONNECT_TIMEOUT_S)
                stack.enter_context(connection)
                connection.settimeout(SEND_TIMEOUT_S)
                connection.sendall(each)
        yield


def stalled_connections(server: Address, count: int) -> contextlib.AbstractContextManager[None]:
    """Connections to a server, each silent after a part of a request, as if its client had lost the network."""
    return connections(server, itertools.islice(itertools.cycle(PARTS), count))


def calls_of(orb: Orb) -> dict[str, Callable[[], object]]:
    """The calls that greedy clients repeat, by name."""
    server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
    planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
    kinds = itertools.cycle(RoboCorba.ElementKind._items)
    return {
        "pictures": lambda: server.renderFloor("L1", 4096),
        "readings": lambda: database.getFloor("L1"),
        "maps": lambda: (editor.exportMap(), editor.elements(next(kinds), "L1"), editor.checkFloor("L1", 0.4)),
        "edits": lambda: _edit(editor),
        "plans": lambda: planner.findPaths(_long_request()),
        "scans": lambda: sensor.scanMany(SCANNED, NO_MOUNT, WHOLE_TURN),
    }


@contextlib.contextmanager
def repeat_in_threads(call: Callable[[], object], count: int) -> Iterator[None]:
    """Threads that repeat a call without a pause, whatever CORBA exception it raises, until the end of the `with`."""
    ending = threading.Event()
    threads = [threading.Thread(target=_repeat, args=(call, ending), daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ending.set()
        for thread in threads:
            thread.join()


@contextlib.contextmanager
def greedy_clients(launch: Launcher, naming: Address, calls: str, count: int) -> Iterator[None]:
    """A process whose `count` threads repeat calls of `calls_of` without a pause."""
    if not count:
        yield
        return
    process = launch(*checkout_command(__name__, str(naming), calls, str(count)))
    assert process.stdout is not None and process.stdin is not None
    assert process.stdout.readline() == "ready\n"
    try:
        yield
    finally:
        process.stdin.write("end\n")
        process.stdin.flush()
        process.wait()


def main(naming: str, calls: str, count: str) -> None:
    with Orb(Address.parse(naming)) as orb, repeat_in_threads(calls_of(orb)[calls], int(count)):
        print("ready", flush=True)
        sys.stdin.readline()


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


def _long_request() -> Any:
    """A request for ten paths among as many obstacles as a request may have, all at random."""
    start, goal, *obstacles = ([random.uniform(*REQUESTED_M) for _ in range(2)] for _ in range(2 + MAX_AREAS))
    corners = ((0.0, 0.0), (OBSTACLE_M, 0.0), (0.0, OBSTACLE_M))
    areas = [RoboCorba.ForbiddenArea("L1", [RoboCorba.XY(x + dx, y + dy) for dx, dy in corners]) for x, y in obstacles]
    return RoboCorba.PathRequest(
        *(RoboCorba.Point("L1", *start), RoboCorba.Point("L1", *goal), SMARTPAL_RADIUS_M, SMARTPAL_SPEED_M_S),
        *(RoboCorba.SMOOTHED, RoboCorba.SHORTEST_DISTANCE, [], [], areas, [], "", MAX_ALTERNATIVES),
    )


def _repeat(call: Callable[[], object], ending: threading.Event) -> None:
    while not ending.is_set():
        with contextlib.suppress(CORBA.Exception):
            call()


if __name__ == "__main__":
    main(*sys.argv[1:])
