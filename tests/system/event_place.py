"""Channel servers and a naming service as real processes, and clients of all four kinds in this one."""

from __future__ import annotations

import contextlib
import queue
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from subprocess import Popen
from typing import Any

import CosEventComm
import CosEventComm__POA
from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from testkit.federation import SERVER, Channels
from testkit.processes import Launcher

#: A channel's server that gives silent clients up sooner.
IMPATIENT = "event_impatient_server"
ROOT = Path(__file__).resolve().parents[2]
QUEUE = RoboCorba.QueuePolicy(1000, RoboCorba.DISCARD_OLDEST, 0.0)


@contextlib.contextmanager
def open_place(folder: Path) -> Iterator[Place]:
    """A place without channels."""
    with (
        claimed_ports() as port,
        Launcher(folder) as launch,
        Orb(Address("127.0.0.1", port), call_timeout_s=20.0) as orb,
        contextlib.closing(Place(launch, folder, port, orb)) as place,
    ):
        place.start_naming()
        yield place


class Place(Channels):
    """Channels and a naming service, and clients of all kinds."""

    def __init__(self, launch: Launcher, folder: Path, port: int, orb: Orb) -> None:
        super().__init__(launch, folder, port, orb)
        self.launch = launch

    def begin(self, name: str, *more: str, module: str = SERVER) -> Any:
        """Start channel `name`, or start it again, with more arguments; returns it when it answers."""
        self.spawn(name, *more, module=module)
        self.wait_ready(name)
        return self.channel(name)

    def uri(self, name: str) -> str:
        """Where a channel is found without the naming service."""
        return f"corbaloc:iiop:{self.address(name)}/EventChannels/{name}"

    def client(self, module: str, *arguments: str) -> Popen[str]:
        """A process with a module of this folder."""
        command = (sys.executable, "-m", f"tests.system.{module}")
        return self.launch(*command, *arguments, PYTHONPATH=str(ROOT))

    def push_to(self, consumer: Any, channel: Any = None) -> Any:
        """Connect a plain consumer to a channel, by default `lab`; returns its proxy."""
        proxy = (channel or self.channel("lab")).for_consumers().obtain_push_supplier()
        proxy.connect_push_consumer(self.orb.activate(consumer))
        return proxy

    def supplier(self, channel: Any = None) -> Any:
        """A proxy to push plain events to."""
        proxy = (channel or self.channel("lab")).for_suppliers().obtain_push_consumer()
        proxy.connect_push_supplier(None)
        return proxy

    def consumer(self, name: str, queue: int = 0) -> Popen[str]:
        """A process with a consumer of a channel, which prints each event; a plain one, unless it has a queue."""
        process = self.client("any_consumer", *(["batches"] if queue else []))
        assert process.stdout is not None
        uri, channel = process.stdout.readline().strip(), self.channel(name)
        if queue:
            policy = RoboCorba.QueuePolicy(queue, RoboCorba.DISCARD_OLDEST, 0.0)
            channel.subscribe("", self.orb.reference(uri, RoboCorba.EventConsumer), clauses(""), policy)
        else:
            proxy = channel.for_consumers().obtain_push_supplier()
            proxy.connect_push_consumer(self.orb.reference(uri, CosEventComm.PushConsumer))
        return process

    def evicted(self, name: str) -> int:
        return int(self.channel(name).state().evicted)

    def balanced_states(self, name: str) -> list[Any]:
        """The states of its proxies, none of which has lost or invented an event."""
        states: list[Any] = self.channel(name).state().proxies
        for state in states:
            account = state.events
            assert account.received == account.delivered + account.discarded + account.expired + account.queued, state
        return states


def clauses(*types: str) -> list[Any]:
    """A subscription to events of these types; an empty one is all."""
    return [RoboCorba.Clause([RoboCorba.EventPattern(type, "")], 0.0) for type in types]


def text(value: str) -> Any:
    """An `any` with a string."""
    return CORBA.Any(CORBA.TC_string, value)


class _Told:
    """Counts how often it is told that it is disconnected; `farewell` may do more."""

    def __init__(self, farewell: Callable[[], None] = lambda: None) -> None:
        self.disconnections = 0
        self._farewell = farewell

    def disconnected(self) -> None:
        self.disconnections += 1
        self._farewell()


class PushConsumer(_Told, CosEventComm__POA.PushConsumer):
    """A plain consumer: `got` has the values that came. take: gets the events instead."""

    def __init__(
        self, farewell: Callable[[], None] = lambda: None, take: Callable[[Any], object] | None = None
    ) -> None:
        super().__init__(farewell)
        self.got: list[Any] = []
        self._take = take or (lambda value: self.got.append(value.value()))

    def push(self, value: Any) -> None:
        self._take(value)

    disconnect_push_consumer = _Told.disconnected


class EventConsumer(_Told, RoboCorba__POA.EventConsumer):
    """A consumer that takes batches: `got` has number, type, source and payload; `together` conjunctions."""

    def __init__(self) -> None:
        super().__init__()
        self.got: list[tuple[int, str, str, bytes]] = []
        self.together: list[tuple[int, list[Any]]] = []
        self.calls = 0

    def pushRuns(self, runs: Any) -> None:
        self.calls += 1
        for run in runs:
            first = run.first
            self.got += [(first.number + at, first.type, first.source, p) for at, p in enumerate(run.payloads)]

    def pushTogether(self, which: int, events: Any) -> None:
        self.together.append((which, events))

    disconnect_push_consumer = _Told.disconnected

    @property
    def payloads(self) -> list[bytes]:
        return [payload for _, _, _, payload in self.got]


class PullConsumer(_Told, CosEventComm__POA.PullConsumer):
    """Known to its proxy only to be told of its disconnection."""

    disconnect_pull_consumer = _Told.disconnected


class PushSupplier(_Told, CosEventComm__POA.PushSupplier):
    """The same for a supplier that pushes."""

    disconnect_push_supplier = _Told.disconnected


class PullSupplier(_Told, CosEventComm__POA.PullSupplier):
    """Gives what was put into `waiting`."""

    def __init__(self, farewell: Callable[[], None] = lambda: None) -> None:
        super().__init__(farewell)
        self.waiting: queue.Queue[Any] = queue.Queue()

    def try_pull(self) -> tuple[Any, bool]:
        try:
            return self.waiting.get_nowait(), True
        except queue.Empty:
            return CORBA.Any(CORBA.TC_null, None), False

    disconnect_pull_supplier = _Told.disconnected


def in_background(call: Callable[[], Any]) -> Future[Any]:
    """A call that another thread makes: its result, or the CORBA exception that it raised."""
    future: Future[Any] = Future()

    def run() -> None:
        try:
            future.set_result(call())
        except CORBA.Exception as error:
            future.set_result(error)

    threading.Thread(target=run, daemon=True).start()
    return future
