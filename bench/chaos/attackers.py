"""A client that attacks a running system in one way, again and again, until it is killed.

    python -m bench.chaos.attackers NAMING KIND SEED ENDPOINT...

It knows what any client of a plain system knows: the address of the naming service and the ports (ENDPOINT) of the
servers. It does nothing that a plain system permits and that harms others by its purpose, such as stopping a robot."""

from __future__ import annotations

import contextlib
import itertools
import os
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import CosNaming
from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS
from robocorba.system.roles import Role, may_call
from robocorba.system.settings import Address
from testkit.attacks import calls_of, connections, repeat_in_threads, stalled_connections
from testkit.fuzzing.operations import Operation, operations
from testkit.fuzzing.values import Seen, Values
from testkit.simulation import about

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)

#: Niceness of attackers.
NICENESS = 10
#: Time limit for a call of an attacker [s].
CALL_TIMEOUT_S = 10.0
#: Floor on which nobody is, and its size [m].
EMPTY_FLOOR, EMPTY_FLOOR_M = "L2", 60.0
#: Channels of the system, and a robot of it.
HERE, THERE, ROBOT = "west", "east", "d0"
#: Connections to each server that stall within a request: fewer and more than a pool of threads would have.
STALLED = (8, 64, 500)
#: Connections to one server: half of those that it accepts.
CONNECTIONS = 2_000
#: Threads that read floors, or ask for paths, without a pause.
READERS = 30
#: Threads that ask for pictures or scans, or read the map, without a pause. Each of these calls takes long.
DRAWERS = 10
#: Nodes that one transaction creates, and the next one removes.
NODES = 10_000
#: Robots that log on in one attack.
LOG_ONS = 50
#: Threads that wait for an event.
PULLS = 200
#: Duration of an attack by stalled connections, or by calls without a pause [s].
ATTACK_S = 10.0
#: Operations of observers that are not called with nonsense: `pull` waits for an event, `subscribe` has its own attack.
OMITTED = {"pull", "subscribe", "routeBack"}


class Attacker:
    """The attacks are its public methods; each ends by itself and can be repeated."""

    def __init__(self, orb: Orb, naming: Address, seed: int, endpoints: Sequence[Address]) -> None:
        self._orb, self._random, self._servers = orb, Random(seed), [naming, *endpoints]
        self._numbers = itertools.count(1000 * (seed % 1000))

    # ---- connections ----

    def stalled_connections(self) -> None:
        """Connections to every server that are silent after a part of a request."""
        with contextlib.ExitStack() as stack:
            for server in self._servers:
                stack.enter_context(stalled_connections(server, self._random.choice(STALLED)))
            time.sleep(ATTACK_S)

    def stalled_bodies(self) -> None:
        """Requests of which 1 MB of 5 MB arrives."""
        with contextlib.ExitStack() as stack:
            for server in self._servers:
                request = _request(b"MapEditor", b"importMap", 5_000_000, 1_000_000)
                stack.enter_context(connections(server, [request] * 8))
            time.sleep(ATTACK_S)

    def many_connections(self) -> None:
        """Connections to one server that send nothing, as many as this process can open."""
        with connections(self._random.choice(self._servers), itertools.repeat(b"", CONNECTIONS)):
            time.sleep(5.0)

    def garbage(self) -> None:
        """Random bytes, with and without the beginning of a request."""
        heads = (b"", b"GIOP\1\2", b"GIOP\1\2\1\0", b"GIOP\1\2\3\1\xff\xff\xff\xff")
        with contextlib.ExitStack() as stack:
            for server in self._servers:
                sent = [
                    self._random.choice(heads) + self._random.randbytes(self._random.choice((1, 30, 5000)))
                    for _ in range(50)
                ]
                stack.enter_context(connections(server, sent))

    # ---- calls ----

    def readers(self) -> None:
        """Clients that read floors without a pause."""
        self._repeat("readings", READERS)

    def drawers(self) -> None:
        """Clients that ask for large pictures."""
        self._repeat("pictures", DRAWERS)

    def map_readers(self) -> None:
        """Clients that export and check the map without a pause."""
        self._repeat("maps", DRAWERS)

    def planners(self) -> None:
        """Clients that ask for ten paths among many obstacles without a pause."""
        self._repeat("plans", READERS)

    def scanners(self) -> None:
        """Clients that scan a million rays in each call without a pause."""
        self._repeat("scans", DRAWERS)

    def nonsense(self) -> None:
        """Calls of operations that any observer may call, with nonsense for arguments."""
        names = ("MapEditor", "PathPlanner", "OmniDatabase", "SimulationServer", "MissionControl")
        targets = [(name, getattr(RoboCorba, name)) for name in names]
        targets += [(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel), (f"{SENSORS}/s1", RoboCorba.VirtualSensor)]
        targets += [(f"{ROBOTS}/{ROBOT}", RoboCorba.RobotAgent)]
        seen = Seen(("L1", "L2", ROBOT, "s1", HERE, "wall-0", "table-0"))
        name, interface = self._random.choice(targets)
        reference = self._orb.resolve(name, interface)
        values = Values(self._random, seen)
        callable_ones = [each for each in operations(interface) if self._is_harmless(interface, each)]
        for _ in range(100):
            operation = self._random.choice(callable_ones)
            with contextlib.suppress(Exception):  # also of our ORB: it can't send everything
                arguments = values.arguments(operation.wanted, ())
                result = reference._obj.invoke(operation.name, operation.descriptor, tuple(arguments))
                for descriptor in (operation.returned or ())[:1]:
                    seen.note(self._random, descriptor, result)

    @staticmethod
    def _is_harmless(interface: Any, operation: Operation) -> bool:
        return operation.name not in OMITTED and may_call(Role.OBSERVER, interface.__name__, operation.name)

    # ---- what is kept for a client ----

    def transactions(self) -> None:
        """Transactions and edit sessions that are forgotten."""
        editor = self._orb.resolve("MapEditor", RoboCorba.MapEditor)
        for _ in range(40):
            editor.begin()
        for number in range(40):
            editor.openSession(f"forgetful {number}").begin()

    def edits(self) -> None:
        """Edits that replace all nodes of the empty floor by ten thousand others."""
        editor = self._orb.resolve("MapEditor", RoboCorba.MapEditor)
        first = next(self._numbers)
        transaction = removal(editor)
        for number in range(NODES):
            x, y = (EMPTY_FLOOR_M * self._random.uniform(0.01, 0.99) for _ in range(2))
            node = RoboCorba.PathNode(f"n{first}-{number}", RoboCorba.XY(x, y), "")
            transaction.create(EMPTY_FLOOR, RoboCorba.Element(RoboCorba.NODE_ELEMENT, node))
        transaction.commit()

    def log_ons(self) -> None:
        """Robots with strange names that log on and off, or are forgotten."""
        server = self._orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        for number in range(LOG_ONS):
            x, y = (EMPTY_FLOOR_M * self._random.uniform(0.05, 0.95) for _ in range(2))
            name = f"\x1b[2J{next(self._numbers)}-{'x' * (number % 40)}"
            with contextlib.suppress(CORBA.UserException):
                session = server.registerRobot(about(name, x, y, floor=EMPTY_FLOOR))
                if self._random.random() < 0.7:
                    session.deregister()

    # ---- events ----

    def absent_consumers(self) -> None:
        """Durable subscriptions to everything that block suppliers; their consumers leave, or never were there."""
        channel = self._orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel)
        dead = self._orb.reference("corbaloc::127.0.0.1:9/nobody", RoboCorba.EventConsumer)
        queue = RoboCorba.QueuePolicy(1, RoboCorba.BLOCK_SUPPLIER, 10.0)
        everything = [RoboCorba.Clause([RoboCorba.EventPattern("*", "*")], 0.0)]
        for number in range(10):
            consumer = self._random.choice((dead, self._orb.activate(_Sleeper())))
            proxy = channel.subscribe(f"logger-{number}", consumer, everything, queue)
            if self._random.random() < 0.5:
                proxy.disconnect_push_supplier()
        time.sleep(5.0)

    def forged_events(self) -> None:
        """Events that claim to come from the other channel with a number beyond all."""
        header = _forged_header("chaos.count", "client")
        proxy = self._orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel).supply("")
        endpoints = self._servers[1:]
        for _ in range(20):
            with contextlib.suppress(CORBA.Exception):
                proxy.pushEvent(RoboCorba.Event(_forged_header("chaos.forged", "nobody"), b"\xc0"))
            for endpoint in endpoints:
                for name in (HERE, THERE):
                    uri = f"corbaloc:iiop:1.2@{endpoint}/{CHANNELS}/{name}/gateway"
                    with contextlib.suppress(CORBA.Exception):
                        gateway = self._orb.reference(uri, RoboCorba.PeerGateway)
                        way = RoboCorba.EventWay([RoboCorba.EventTarget(name, 0)], 0)
                        gateway.forwardOn("1", 1, [0.0], [way], [RoboCorba.EventRun(header, [1.0], [b"\xc0"])])
            time.sleep(0.1)
        proxy.disconnect_push_consumer()

    def loops(self) -> None:
        """A client whose consumer pushes all that it gets to the channel again."""
        channel = self._orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel)
        supplier = channel.for_suppliers().obtain_push_consumer()
        supplier.connect_push_supplier(None)
        consumer = channel.for_consumers().obtain_push_supplier()
        echo = _Echo(supplier)
        consumer.connect_push_consumer(self._orb.activate(echo))
        for number in range(20):
            supplier.push(CORBA.Any(CORBA.TC_long, number))
        time.sleep(5.0)
        consumer.disconnect_push_supplier()
        supplier.disconnect_push_consumer()

    def pulls(self) -> None:
        """Clients that wait for events by `pull`; none comes."""
        channel = self._orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel)
        proxies = []
        for _ in range(PULLS):
            proxy = channel.for_consumers().obtain_pull_supplier()._narrow(RoboCorba.EventProxyPullSupplier)
            proxy.connect_pull_consumer(None)
            proxy.changeSubscription([RoboCorba.Clause([RoboCorba.EventPattern("never", "*")], 0.0)])
            proxies.append(proxy)
        for proxy in proxies:
            threading.Thread(target=_quietly, args=(proxy.pull,), daemon=True).start()
        time.sleep(8.0)
        for proxy in proxies:
            proxy.disconnect_pull_supplier()

    # ---- names ----

    def stolen_names(self) -> None:
        """Names that are bound to somebody else, or unbound."""
        other = self._orb.activate(_Sleeper())
        root = self._orb.reference(f"corbaloc::{self._servers[0]}/NameService", CosNaming.NamingContext)
        names = [("PathPlanner", ""), ("SimulationServer", ""), ("MapEditor", ""), (ROBOTS, ROBOT), (CHANNELS, HERE)]
        for one in self._random.sample(names, 2):
            parts = [CosNaming.NameComponent(part, "") for part in ("RoboCorba", *one) if part]
            with contextlib.suppress(CORBA.Exception):
                root.unbind(parts) if self._random.random() < 0.5 else root.rebind(parts, other)
        time.sleep(3.0)

    def fake_sensors(self) -> None:
        """Sensor servers that nobody has started."""
        server = self._orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        sensor = self._orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        for _ in range(20):
            with contextlib.suppress(CORBA.Exception):
                server.registerSensor(f"fake-{next(self._numbers)}", sensor, "0" * 64)
            with contextlib.suppress(CORBA.Exception):
                server.reportSensor("s1", sensor, RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0), [])

    # ---- inside ----

    def _repeat(self, calls: str, threads: int) -> None:
        with repeat_in_threads(calls_of(self._orb)[calls], threads):
            time.sleep(ATTACK_S)


class _Sleeper(RoboCorba__POA.EventConsumer):
    """A consumer that returns late."""

    def pushRuns(self, runs: Any) -> None:
        time.sleep(5.0)

    push = pushRuns

    def pushTogether(self, which: int, events: Any) -> None:
        time.sleep(5.0)

    def disconnect_push_consumer(self) -> None:
        """Ignore the end."""


class _Echo(CosEventComm__POA.PushConsumer):
    """A consumer that pushes what it gets."""

    def __init__(self, supplier: Any) -> None:
        self._supplier = supplier

    def push(self, data: Any) -> None:
        _quietly(lambda: self._supplier.push(data))

    def disconnect_push_consumer(self) -> None:
        """Ignore the end."""


def removal(editor: Any) -> Any:
    """A transaction that removes all nodes of the empty floor; it is to be committed."""
    left = editor.elements(RoboCorba.NODE_ELEMENT, EMPTY_FLOOR)
    transaction = editor.begin()
    for each in left:
        name = RoboCorba.ElementId(RoboCorba.NODE_ELEMENT, EMPTY_FLOOR, each.value.aNode.name)
        transaction.remove(name, each.changedAt)
    return transaction


def _forged_header(type: str, source: str) -> Any:
    """The header of an event that claims to come from the other channel, with a number beyond all."""
    return RoboCorba.EventHeader(type, source, THERE, 2**63, 0.0, 0, 0.0, RoboCorba.MSGPACK)


def _request(key: bytes, operation: bytes, total: int, sent: int) -> bytes:
    """A GIOP 1.2 request whose body of `total` bytes ends after `sent`."""
    head = struct.pack("<IB3xH2xI", 1, 3, 0, len(key)) + key
    head += bytes(-len(head) % 4) + struct.pack("<I", len(operation) + 1) + operation + b"\0"
    head += bytes(-len(head) % 4) + struct.pack("<I", 0)
    head += bytes(-(len(head) + 12) % 8) + struct.pack("<I", total)
    return b"GIOP\1\2\1\0" + struct.pack("<I", len(head) + total) + head + b"x" * sent


def _quietly(call: Callable[[], object]) -> None:
    with contextlib.suppress(CORBA.Exception):
        call()


def lower_priority() -> None:
    """Attackers are on other machines: here they must take the servers' CPU time by calls only. Where the kernel groups
    processes by session (sched_autogroup_enabled), niceness counts within a session, and each session has its own."""
    os.nice(NICENESS)
    group = Path("/proc/self/autogroup")
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # no such file, or another user's process changed its own a moment ago
            group.write_text(str(NICENESS))


#: Names of the attacks.
KINDS = tuple(name for name in vars(Attacker) if not name.startswith("_"))


def main(naming: str, kind: str, seed: str, *endpoints: str) -> None:
    lower_priority()
    address = Address.parse(naming)
    with Orb(address, call_timeout_s=CALL_TIMEOUT_S) as orb:
        attacker = Attacker(orb, address, int(seed), [Address.parse(each) for each in endpoints])
        print("null", flush=True)
        while True:
            try:
                getattr(attacker, kind)()
            except Exception as error:  # refused; what comes of it is seen at the servers
                print(f"{kind}: {str(error)[:200]}", file=sys.stderr, flush=True)
                time.sleep(0.5)


if __name__ == "__main__":
    main(*sys.argv[1:])
