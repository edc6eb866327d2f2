"""Channel servers and a naming service as real processes, and clients of all four kinds in this one."""

from __future__ import annotations

import contextlib
import queue
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any

import CosEventComm
import CosEventComm__POA
from omniORB import CORBA

from robocorba.claimed_ports import claimed_ports
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.supervision.launch import module_command
from robocorba.supervision.system import naming_service_command
from robocorba.testing.processes import Launcher, eventually

#: A channel's server that gives silent clients up sooner, and has MAX_PROXIES.
IMPATIENT, MAX_PROXIES = "event_impatient_server", 100
ROOT = Path(__file__).resolve().parents[2]
QUEUE = RoboCorba.QueuePolicy(1000, RoboCorba.DISCARD_OLDEST, 0.0)


@contextlib.contextmanager
def open_place(folder: Path) -> Iterator[Place]:
    """A place without channels."""
    with (
        claimed_ports() as port,
        Launcher(folder) as launch,
        Orb(Address("127.0.0.1", port), call_timeout_s=20.0) as orb,
    ):
        yield Place(launch, port, orb)


class Place:
    """A naming service on `port`, channels on the ports after it, and this process's ORB."""

    def __init__(self, launch: Launcher, port: int, orb: Orb) -> None:
        self.launch, self.port, self.orb = launch, port, orb
        self._offsets: dict[str, int] = {}
        launch(*naming_service_command(Address("127.0.0.1", port), launch.folder))

    def start(self, name: str, server: str = "robocorba.servers.event_channel", *more: str) -> Popen[str]:
        """Start channel `name`, or start it again, with more arguments; waits until it answers."""
        offset = self._offsets.setdefault(name, len(self._offsets) + 1)
        addresses = ("--endpoint", f"127.0.0.1:{self.port + offset}", "--naming", f"127.0.0.1:{self.port}")
        command = (*module_command(server), "--state", str(self.launch.folder / "state"), *addresses)
        process = self.launch(*command, "--name", name, *more)
        eventually(lambda: process.poll() is not None or self._answers(name), 30, f"channel {name}")
        assert process.poll() is None, process.communicate()[1]
        return process

    def uri(self, name: str) -> str:
        """Where a channel is found without the naming service."""
        return f"corbaloc:iiop:127.0.0.1:{self.port + self._offsets[name]}/EventChannels/{name}"

    def channel(self, name: str) -> Any:
        return self.orb.reference(self.uri(name), RoboCorba.EventChannel)

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

    def consumer(self, name: str, file: Path, *more: str) -> Popen[str]:
        """A process with a consumer of a channel; each event becomes a line of `file`."""
        process = self.client("event_consumer", self.uri(name), str(file), *more)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
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

    def _answers(self, name: str) -> bool:
        try:
            return self.channel(name)._get_name() == name
        except CORBA.SystemException:
            return False


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

    def _disconnected(self) -> None:
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

    def disconnect_push_consumer(self) -> None:
        self._disconnected()


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

    def push(self, value: Any) -> None:
        raise CORBA.NO_IMPLEMENT

    def disconnect_push_consumer(self) -> None:
        self._disconnected()

    @property
    def payloads(self) -> list[bytes]:
        return [payload for _, _, _, payload in self.got]


class PullConsumer(_Told, CosEventComm__POA.PullConsumer):
    """Known to its proxy only to be told of its disconnection."""

    def disconnect_pull_consumer(self) -> None:
        self._disconnected()


class PushSupplier(_Told, CosEventComm__POA.PushSupplier):
    """The same for a supplier that pushes."""

    def disconnect_push_supplier(self) -> None:
        self._disconnected()


class PullSupplier(_Told, CosEventComm__POA.PullSupplier):
    """Gives what was put into `waiting`; counts how often it is asked."""

    def __init__(self, farewell: Callable[[], None] = lambda: None) -> None:
        super().__init__(farewell)
        self.waiting: queue.Queue[Any] = queue.Queue()
        self.asked = 0

    def pull(self) -> Any:
        raise CosEventComm.Disconnected

    def try_pull(self) -> tuple[Any, bool]:
        self.asked += 1
        try:
            return self.waiting.get_nowait(), True
        except queue.Empty:
            return CORBA.Any(CORBA.TC_null, None), False

    def disconnect_pull_supplier(self) -> None:
        self._disconnected()


class InBackground:
    """A call that another thread makes: its result, or what it raised."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self._answers: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._run, args=(call,), daemon=True).start()

    def _run(self, call: Callable[[], Any]) -> None:
        try:
            self._answers.put(call())
        except CORBA.Exception as error:
            self._answers.put(error)

    def answer(self, timeout_s: float = 60.0) -> Any:
        return self._answers.get(timeout=timeout_s)

    def is_waiting(self) -> bool:
        return self._answers.empty()
