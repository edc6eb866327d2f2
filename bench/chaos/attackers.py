"""A client that attacks a running system in one way, again and again, until it is killed.

    python -m bench.chaos.attackers NAMING KIND SEED ENDPOINT...

It knows what any client of a plain system knows: the address of the naming service and the ports (ENDPOINT) of the
servers. It does nothing that a plain system permits and that harms others by its purpose, such as stopping a robot."""

from __future__ import annotations

import contextlib
import itertools
import os
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
from robocorba.system.names import CHANNELS, ROBOTS
from robocorba.system.settings import Address
from testkit.attacks import calls_of, connections, repeat_in_threads, stalled_connections
from testkit.simulation import about

import CosEventComm__POA  # isort: skip  (found once omniORB is imported)

#: Niceness of attackers.
NICENESS = 10
#: Time limit for a call of an attacker [s].
CALL_TIMEOUT_S = 10.0
#: Floor on which nobody is, and its size [m].
EMPTY_FLOOR, EMPTY_FLOOR_M = "L2", (24.0, 11.0)
#: Channels of the system, and a robot of it.
HERE, THERE, ROBOT = "west", "east", "d0"
#: Connections to each server that stall within a request: fewer and more than a pool of threads would have.
STALLED = (8, 64, 500)
#: Connections to one server: half of those that it accepts.
CONNECTIONS = 2_000
#: Calls that are repeated without a pause, and by how many threads.
REPEATED = {"readings": 30, "plans": 30, "pictures": 10, "maps": 10, "scans": 10, "edits": 10}
#: Robots that log on in one attack, and threads that wait for an event.
LOG_ONS, PULLS = 50, 200
#: Duration of an attack by stalled connections, or by calls without a pause [s].
ATTACK_S = 10.0


class Attacker:
    """The attacks are its public methods; each ends by itself and can be repeated."""

    def __init__(self, orb: Orb, naming: Address, seed: int, endpoints: Sequence[Address]) -> None:
        self._orb, self._random, self._servers = orb, Random(seed), [naming, *endpoints]
        self._numbers = itertools.count(1000 * (seed % 1000))

    def stalled_connections(self) -> None:
        """Connections to every server that are silent after a part of a request."""
        with contextlib.ExitStack() as stack:
            for server in self._servers:
                stack.enter_context(stalled_connections(server, self._random.choice(STALLED)))
            time.sleep(ATTACK_S)

    def many_connections(self) -> None:
        """Connections to one server that send nothing, as many as this process can open."""
        with connections(self._random.choice(self._servers), itertools.repeat(b"", CONNECTIONS)):
            time.sleep(5.0)

    def garbage(self) -> None:
        """Random bytes, with and without the beginning of a request."""
        heads = (b"", b"GIOP\1\2", b"GIOP\1\2\1\0", b"GIOP\1\2\3\1\xff\xff\xff\xff")
        for server in self._servers:
            lengths = self._random.choices((1, 30, 5000), k=50)
            sent = [self._random.choice(heads) + self._random.randbytes(length) for length in lengths]
            with connections(server, sent):
                pass

    def transactions(self) -> None:
        """Transactions and edit sessions that are forgotten."""
        editor = self._orb.resolve("MapEditor", RoboCorba.MapEditor)
        for number in range(40):
            editor.begin()
            editor.openSession(f"forgetful {number}").begin()

    def log_ons(self) -> None:
        """Robots with strange names that log on and off, or are forgotten."""
        server = self._orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        for number in range(LOG_ONS):
            x, y = (side * self._random.uniform(0.05, 0.95) for side in EMPTY_FLOOR_M)
            name = f"\x1b[2J{next(self._numbers)}-{'x' * (number % 40)}"
            with contextlib.suppress(CORBA.UserException):
                session = server.registerRobot(about(name, x, y, floor=EMPTY_FLOOR))
                if self._random.random() < 0.7:
                    session.deregister()

    def absent_consumers(self) -> None:
        """Durable subscriptions to everything that block suppliers; their consumers leave, or never were there."""
        channel = self._channel()
        dead = self._orb.reference("corbaloc::127.0.0.1:9/nobody", RoboCorba.EventConsumer)
        queue = RoboCorba.QueuePolicy(1, RoboCorba.BLOCK_SUPPLIER, 10.0)
        everything = [RoboCorba.Clause([RoboCorba.EventPattern("*", "*")], 0.0)]
        for number in range(10):
            consumer = self._random.choice((dead, self._orb.activate(_Sleeper())))
            proxy = channel.subscribe(f"logger-{number}", consumer, everything, queue)
            if self._random.random() < 0.5:
                proxy.disconnect_push_supplier()
        time.sleep(5.0)

    def loops(self) -> None:
        """A client whose consumer pushes all that it gets to the channel again."""
        channel = self._channel()
        supplier = channel.for_suppliers().obtain_push_consumer()
        supplier.connect_push_supplier(None)
        consumer = channel.for_consumers().obtain_push_supplier()
        consumer.connect_push_consumer(self._orb.activate(_Echo(supplier)))
        for number in range(20):
            supplier.push(CORBA.Any(CORBA.TC_long, number))
        time.sleep(5.0)
        consumer.disconnect_push_supplier()
        supplier.disconnect_push_consumer()

    def pulls(self) -> None:
        """Clients that wait for events by `pull`; none comes."""
        proxies = []
        for _ in range(PULLS):
            proxy = self._channel().for_consumers().obtain_pull_supplier()._narrow(RoboCorba.EventProxyPullSupplier)
            proxy.connect_pull_consumer(None)
            proxy.changeSubscription([RoboCorba.Clause([RoboCorba.EventPattern("never", "*")], 0.0)])
            proxies.append(proxy)
            threading.Thread(target=_quietly, args=(proxy.pull,), daemon=True).start()
        time.sleep(8.0)
        for proxy in proxies:
            proxy.disconnect_pull_supplier()

    def stolen_names(self) -> None:
        """Names that are bound to somebody else, or unbound."""
        other = self._orb.activate(_Sleeper())
        root = self._orb.reference(f"corbaloc::{self._servers[0]}/NameService", CosNaming.NamingContext)
        names = [("PathPlanner",), ("SimulationServer",), ("MapEditor",), (ROBOTS, ROBOT), (CHANNELS, HERE)]
        for one in self._random.sample(names, 2):
            parts = [CosNaming.NameComponent(part, "") for part in ("RoboCorba", *one)]
            with contextlib.suppress(CORBA.Exception):
                root.unbind(parts) if self._random.random() < 0.5 else root.rebind(parts, other)
        time.sleep(3.0)

    def _channel(self) -> Any:
        return self._orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel)


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


def _quietly(call: Callable[[], object]) -> None:
    with contextlib.suppress(CORBA.Exception):
        call()


def lower_priority() -> None:
    """Attackers are on other machines: here they must take the servers' CPU time by calls only. Where the kernel groups
    processes by session (sched_autogroup_enabled), niceness counts within a session, and each session has its own."""
    os.nice(NICENESS)
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # no such file, or another user's process changed its own a moment ago
            Path("/proc/self/autogroup").write_text(str(NICENESS))


#: Names of the attacks.
KINDS = (*REPEATED, *(name for name in vars(Attacker) if not name.startswith("_")))


def main(naming: str, kind: str, seed: str, *endpoints: str) -> None:
    lower_priority()
    address = Address.parse(naming)
    with Orb(address, call_timeout_s=CALL_TIMEOUT_S) as orb:
        attacker = Attacker(orb, address, int(seed), [Address.parse(each) for each in endpoints])
        while True:
            try:
                if kind in REPEATED:
                    with repeat_in_threads(calls_of(orb)[kind], REPEATED[kind]):
                        time.sleep(ATTACK_S)
                else:
                    getattr(attacker, kind)()
            except Exception as error:  # refused; what comes of it is seen at the servers
                print(f"{kind}: {str(error)[:200]}", file=sys.stderr, flush=True)
                time.sleep(0.5)


if __name__ == "__main__":
    main(*sys.argv[1:])
