"""Calls and connections: their limits, callers that have gone, and those that arrive while a server starts."""

from __future__ import annotations

import contextlib
import resource
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast

import pytest
from omniORB import CORBA

from robocorba.errors.paths import UnknownFloor
from robocorba.missions.corba.mission_control_servant import MissionControlServant
from robocorba.orb import connections
from robocorba.orb.call_limit import CallLimit
from robocorba.orb.callers import present_caller
from robocorba.orb.connections import ConnectionLimit, raise_descriptor_limit
from robocorba.orb.orb import Orb
from robocorba.servers.simulation import FOLLOWING, limit_calls
from robocorba.simulation.corba.omni_database_servant import OmniDatabaseServant
from robocorba.simulation.corba.simulation_server_servant import SimulationServerServant
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.claimed_ports import claimed_ports
from testkit.processes import eventually
from tests.waits import outlast, work_for


class HeldPlanner(RoboCorba__POA.PathPlanner):
    """A path planning agent whose map version is known once `go_on` is set.

    called: has a permit for each call. callers: of all calls, whether each has gone."""

    def __init__(self) -> None:
        self.called, self.go_on = threading.Semaphore(0), threading.Event()
        self.callers: list[Callable[[], bool]] = []

    def _get_mapVersion(self) -> int:
        self.callers.append(present_caller())
        self.called.release()
        assert self.go_on.wait(60.0)
        return 7


@pytest.fixture
def planner() -> Iterator[HeldPlanner]:
    """One whose calls end with the test at the latest."""
    planner = HeldPlanner()
    yield planner
    planner.go_on.set()


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(8) as pool:
        yield pool


def test_a_call_that_waits_or_fails_leaves_its_place(planner: HeldPlanner, pool: ThreadPoolExecutor, orb: Orb) -> None:
    CallLimit(at_once=1, limit_s=0.01).apply(planner, "_get_mapVersion")
    call = orb.activate(planner)._narrow(RoboCorba.PathPlanner)._get_mapVersion
    first = pool.submit(call)
    assert planner.called.acquire(timeout=60.0)
    with pytest.raises(CORBA.TRANSIENT):
        call()
    planner.go_on.set()
    assert (first.result(60.0), call()) == (7, 7)

    def fail() -> None:
        raise CORBA.NO_IMPLEMENT

    failing = CallLimit(at_once=1, waiting=0).limited(fail)
    for _ in range(3):
        with pytest.raises(CORBA.NO_IMPLEMENT):
            failing()


@pytest.mark.parametrize("limit_s", [10.0, 0.0005])
def test_no_place_is_lost_and_none_is_taken_twice(limit_s: float) -> None:
    """Beside many callers, also those whose time ends while they get their place."""
    running, most = list[None](), list[int]()

    def work() -> None:
        running.append(None)
        most.append(len(running))
        work_for(0.0002)
        running.pop()

    call = CallLimit(at_once=3, limit_s=limit_s).limited(work)

    def repeat(times: int) -> None:
        for _ in range(times):
            with contextlib.suppress(CORBA.TRANSIENT):
                call()

    with ThreadPoolExecutor(24) as pool:
        list(pool.map(repeat, [50] * 24))
    assert max(most) <= 3
    assert 50 <= len(most) <= 24 * 50
    assert limit_s < 1.0 or len(most) == 24 * 50
    for _ in range(10):
        call()  # all places are free again


def test_who_has_waited_longest_goes_first_and_few_may_wait() -> None:
    order: list[int] = []
    go_on, call_first = threading.Event(), threading.Event()

    def work(number: int) -> None:
        order.append(number)
        call_first.set()
        go_on.wait(60.0)

    limit = CallLimit(at_once=1, waiting=5)
    call = limit.limited(work)
    with ThreadPoolExecutor(8) as pool:
        for number in range(6):
            pool.submit(call, number)
            assert call_first.wait(60.0)
            eventually(lambda waiting=number: len(limit._waiting) == waiting)
        with pytest.raises(CORBA.TRANSIENT):
            call(6)
        go_on.set()
    assert order == list(range(6))


#: Calls an object once, and prints the result.
CLIENT = """
import sys
from omniORB import CORBA
from robocorba.orb.orb import Orb
from robocorba.system.settings import Address
from robocorba.stubs import RoboCorba
with Orb(Address("127.0.0.1", 9), call_timeout_s=float(sys.argv[2])) as orb:
    try:
        print(orb.reference(sys.argv[1], RoboCorba.PathPlanner)._get_mapVersion())
    except CORBA.TIMEOUT:
        print("timeout", flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def call(orb: Orb, planner: HeldPlanner) -> Iterator[Any]:
    """Starts a client with a call timeout."""
    started: list[subprocess.Popen[str]] = []
    uri = orb.uri(orb.activate(planner))

    def start(timeout_s: float) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", CLIENT, uri, str(timeout_s)]
        started.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_a_client_whose_call_timed_out_has_gone(planner: HeldPlanner, call: Any) -> None:
    impatient, patient = call(0.2), call(60.0)
    eventually(lambda: len(planner.callers) == 2, what="both calls")
    assert impatient.stdout.readline() == "timeout\n"  # and goes on
    eventually(lambda: sorted(has_gone() for has_gone in planner.callers) == [False, True])
    planner.go_on.set()
    assert patient.communicate(timeout=60.0)[0] == "7\n"
    eventually(lambda: all(has_gone() for has_gone in planner.callers))


def test_readers_do_not_wait_for_robots_that_follow_a_floor() -> None:
    called, go_on, nobody = threading.Semaphore(0), threading.Event(), cast(Any, None)

    def changes(name: str, since: int) -> None:
        called.release()
        assert go_on.wait(60.0)
        raise UnknownFloor("name", name, ["L1"])

    servant = OmniDatabaseServant(cast(Any, SimpleNamespace(changes=changes, floors=["L1"])), nobody, nobody)
    server = SimulationServerServant(nobody, nobody, nobody, nobody, nobody)
    limit_calls(server, servant, MissionControlServant(nobody))
    with ThreadPoolExecutor(FOLLOWING + 1) as robots:
        calls = ("floorChanges", "typedFloorChanges")
        following = [robots.submit(getattr(servant, calls[i % 2]), "L9", 0) for i in range(FOLLOWING)]
        for _ in range(FOLLOWING):
            assert called.acquire(timeout=60.0)
        assert robots.submit(servant.floors).result(60.0) == ["L1"]
        go_on.set()
    for call in following:
        with pytest.raises(RoboCorba.UnknownFloor):
            call.result(60.0)


class Server:
    """A listening socket, and the connections that it has accepted."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        self._stack = stack
        self._listening = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self.accepted: dict[socket.socket, socket.socket] = {}

    def client(self) -> socket.socket:
        """A new connection of a client."""
        client = self._stack.enter_context(socket.create_connection(self._listening.getsockname()))
        self.accepted[client] = self._stack.enter_context(self._listening.accept()[0])
        client.setblocking(False)
        return client

    def call(self, client: socket.socket) -> None:
        """A request and its answer."""
        client.send(b"?")
        assert self.accepted[client].recv(1) == b"?"
        self.accepted[client].send(b"!")
        eventually(lambda: received(client) == b"!")


@pytest.fixture
def server() -> Iterator[Server]:
    with contextlib.ExitStack() as stack:
        yield Server(stack)


def received(client: socket.socket) -> bytes | None:
    """What has arrived; None if nothing has, empty at the end of the connection."""
    with contextlib.suppress(BlockingIOError):
        return client.recv(100)
    return None


def has_ended(client: socket.socket) -> bool:
    return received(client) in (b"", connections._CLOSE_CONNECTION)


def check(excess: int) -> None:
    ConnectionLimit(len(connections.descriptors_in_use()) - excess).check()


def test_the_number_of_connections_is_limited_but_for_those_of_this_process(server: Server) -> None:
    clients = [server.client() for _ in range(3)]
    check(-1)
    assert not any(has_ended(client) for client in clients)
    ConnectionLimit(connections=2).check()
    assert sum(has_ended(client) for client in clients) == 1
    client = server.client()
    check(100)
    assert has_ended(client)
    client.getpeername()  # only its other end was shut down


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
from robocorba.orb.orb import Orb
from robocorba.system.settings import Address
from robocorba.stubs import RoboCorba__POA

class Planner(RoboCorba__POA.PathPlanner):
    def _get_mapVersion(self):
        return 1

with Orb(Address("127.0.0.1", 9), Address("127.0.0.1", {port})) as orb:
    print("listens", flush=True)
    if sys.stdin.readline() == "end\\n":
        sys.exit()
    orb.activate(Planner(), "Planner")
    orb.accept_calls()
    print("serves", flush=True)
    sys.stdin.readline()
"""


class StartingServer:
    """A server that serves its object when `start` is called."""

    def __init__(self, process: subprocess.Popen[str], port: int) -> None:
        self._process, self.port = process, port
        self._expect("listens")

    def _expect(self, line: str) -> None:
        assert self._process.stdout and self._process.stdout.readline() == f"{line}\n"

    def _order(self, line: str) -> None:
        print(line, file=self._process.stdin, flush=True)

    def start(self) -> None:
        self._order("")
        self._expect("serves")

    def end(self) -> int:
        self._order("end")
        return self._process.wait(30.0)


@pytest.fixture
def starting() -> Iterator[StartingServer]:
    pipe = subprocess.PIPE
    with claimed_ports() as port:
        command = [sys.executable, "-c", SERVER.format(port=port)]
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process, contextlib.ExitStack() as stack:
            stack.callback(process.kill)
            yield StartingServer(process, port)


class Client:
    """A client that has asked, by GIOP 1.0, for the number of threads that Python knows."""

    def __init__(self, stack: contextlib.ExitStack, port: int) -> None:
        self._socket = stack.enter_context(socket.create_connection(("127.0.0.1", port), CONNECT_LIMIT_S))
        operation = b"_get_mapVersion\0"
        body = struct.pack("<IIB3x", 0, 1, 1)  # no contexts, request 1, an answer is expected
        body += struct.pack("<I7sx", 7, b"Planner") + struct.pack("<I", len(operation)) + operation
        body += struct.pack("<I", 0)  # nobody
        self._socket.sendall(b"GIOP\1\0\1\0" + struct.pack("<I", len(body)) + body)

    def status(self, timeout_s: float) -> int:
        """Of the reply, 0 for a result. Raises TimeoutError."""
        self._socket.settimeout(timeout_s)
        size = struct.unpack("<I", self._socket.recv(12, socket.MSG_WAITALL)[8:])[0]
        return int(struct.unpack("<III", self._socket.recv(size, socket.MSG_WAITALL)[:12])[2])


def test_calls_wait_while_a_server_starts(starting: StartingServer) -> None:
    with contextlib.ExitStack() as stack:
        clients = [Client(stack, starting.port) for _ in range(CONNECTIONS)]
        with pytest.raises(TimeoutError):
            clients[0].status(0.3)
        starting.start()
        clients.append(Client(stack, starting.port))
        assert {client.status(60.0) for client in clients} == {0}
    assert starting.end() == 0


def test_a_server_ends_although_it_has_not_served_yet(starting: StartingServer) -> None:
    with contextlib.ExitStack() as stack:
        Client(stack, starting.port)
        assert starting.end() == 0
