"""Clients that do nothing wrong while others attack, each in a process of its own, and what happens to them."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import Unconfirmed
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from testkit.json_process import ObjectProcess
from testkit.report import Mark, at_most
from testkit.simulation import CROSS, NO_MOUNT

#: What calls of a server that nobody attacks are called: how long they take is what the machine needs.
UNTOUCHED = "a server that nobody attacks"
#: Longest call of a client that does nothing wrong [s].
MAX_CALL_S = 0.5
#: Interval between two calls of an object, between two numbered events, and timeout of a call [s].
INTERVAL_S, EVENT_INTERVAL_S, CALL_TIMEOUT_S = 0.05, 0.2, 10.0
#: Type and source of the numbered events.
EVENTS = ("chaos.count", "client")
#: Time limits for the subscription to reach the other channel, and for the last events to arrive [s].
JOIN_LIMIT_S, LAST_EVENTS_S = 60.0, 30.0
#: Lines that are printed of each kind of complaint.
MAX_LINES = 20


class Complaints:
    """Counts what happens to those who do nothing wrong, and prints it with the time since `began`. Texts that differ
    in numbers only are of the same kind; the same text is printed once. beside: what runs now."""

    def __init__(self) -> None:
        self.count = 0
        self.began = time.monotonic()
        self.beside = ""
        self._lock = threading.Lock()
        self._printed: dict[str, set[str]] = {}
        self._kinds: Counter[str] = Counter()

    def add(self, what: str) -> None:
        """Count a harm."""
        with self._lock:
            self.count += 1
        self.note(what)

    def note(self, what: str) -> None:
        """The same for something that is counted elsewhere."""
        kind = re.sub(r"[0-9]+", "#", what)
        with self._lock:
            self._kinds[kind] += 1
            printed = self._printed.setdefault(kind, set())
            if what in printed or len(printed) == MAX_LINES:
                return
            printed.add(what)
        print(f"{time.monotonic() - self.began:.1f} s: {what}, beside {self.beside or 'nothing'}", flush=True)

    def print_rest(self) -> None:
        """Print the number of each kind of which not all were printed."""
        for kind, count in self._kinds.most_common():
            if count > len(printed := self._printed[kind]):
                print(f"{min(printed)} ({count} times of this kind)")


# ---- a client of all servers ----


class Beside:
    """A client that calls every server, in a process of its own. longest: its longest call of each object [s]."""

    def __init__(self, process: ObjectProcess, complain: Complaints) -> None:
        self._process, self.complain = process, complain
        self.longest: dict[str, float] = {}

    def begin(self) -> None:
        """Forget the calls until now: the attacks begin."""
        self._process.call("take")
        self.complain.began = time.monotonic()

    def look(self) -> dict[str, float]:
        """The longest call of each object since the last look [s]. Failed calls are complained of, slow ones noted."""
        calls, errors = self._process.call("take")
        for name, error in errors.items():
            self.complain.add(f"another client's call of {name}: {error}")
        for name, took_s in calls.items():
            self.longest[name] = max(took_s, self.longest.get(name, 0.0))
            if took_s > MAX_CALL_S and name != UNTOUCHED:
                self.complain.note(f"another client's call of {name} took {took_s:.2f} s")
        found: dict[str, float] = calls
        return found

    def marks(self) -> list[Mark]:
        """The required values of `longest`. What the machine itself needs is allowed to everybody."""
        most_s = max(MAX_CALL_S, self.longest[UNTOUCHED])
        return [
            at_most(f"longest call of {name} by another client, s", took_s, most_s)
            for name, took_s in self.longest.items()
            if name != UNTOUCHED
        ]


@contextlib.contextmanager
def beside(naming: Address, about: tuple[str, ...], complain: Complaints) -> Iterator[Beside]:
    """about: a channel, a robot, and two places X,Y on floor L1."""
    with (
        ObjectProcess(untouched) as server,
        ObjectProcess(calls_of_every_server, naming, *about, server.call("reference")) as process,
    ):
        yield Beside(process, complain)


class Calls:
    """Repeats each call in a thread of its own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._longest: dict[str, float] = {}
        self._errors: dict[str, str] = {}

    def take(self) -> tuple[dict[str, float], dict[str, str]]:
        """The duration of the longest of each call since the last question [s], and the last error of those that
        failed."""
        with self._lock:
            found, self._longest, self._errors = (self._longest, self._errors), {}, {}
        return found

    def call(self, name: str, call: Callable[[], object]) -> None:
        began, error = time.monotonic(), ""
        try:
            call()
        except CORBA.UserException:
            pass  # a server may refuse a call, such as for a path to where another robot stands
        except (CORBA.Exception, RoboCorbaError) as raised:
            error = error_of(raised)
        took_s = time.monotonic() - began
        with self._lock:
            self._longest[name] = max(took_s, self._longest.get(name, 0.0))
            if error:
                self._errors[name] = error


@contextlib.contextmanager
def calls_of_every_server(
    naming: Address, channel: str, robot: str, here: str, there: str, untouched: str
) -> Iterator[Calls]:
    """Calls of each server, of a virtual sensor, a robot, and a server that nobody attacks. here, there: of L1."""
    start, goal = (RoboCorba.Point("L1", *map(float, each.split(","))) for each in (here, there))
    pose = RoboCorba.Pose("L1", start.x, start.y, 0.0)
    found = Calls()
    with Orb(naming, call_timeout_s=CALL_TIMEOUT_S) as orb, contextlib.ExitStack() as stack:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        calls: dict[str, Callable[[], object]] = {
            "MapEditor": orb.resolve("MapEditor", RoboCorba.MapEditor)._get_currentVersion,
            "PathPlanner": lambda: planner.getPath(start, goal),
            "SimulationServer": orb.resolve("SimulationServer", RoboCorba.SimulationServer)._get_state,
            "OmniDatabase": lambda: database.getFloor("L1"),
            "VirtualSensor": lambda: sensor.scan(pose, NO_MOUNT, CROSS),
            "EventChannel": orb.resolve(f"{CHANNELS}/{channel}", RoboCorba.EventChannel)._get_name,
            "RobotAgent": orb.resolve(f"{ROBOTS}/{robot}", RoboCorba.RobotAgent)._get_state,
            UNTOUCHED: orb.reference(untouched, RoboCorba.VirtualSensor)._get_load,
        }
        for name, call in calls.items():
            repeated = Repeating(name, partial(found.call, name, call), INTERVAL_S)
            stack.enter_context(contextlib.closing(repeated.start()))
        yield found


class Untouched(RoboCorba__POA.VirtualSensor):
    """A sensor without a load, which nobody attacks."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

    def reference(self) -> str:
        return self._orb.uri(self._this())

    def _get_load(self) -> Any:
        return RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0)


@contextlib.contextmanager
def untouched() -> Iterator[Untouched]:
    with claimed_ports() as port, Orb(Address("127.0.0.1", port), Address("127.0.0.1", port + 1)) as orb:
        servant = Untouched(orb)
        orb.activate(servant)
        orb.accept_calls()
        yield servant


# ---- numbered events from one channel to the other ----


class NumberedEvents:
    """Pushes numbered events, and checks that each arrives once."""

    def __init__(self, sending: EventClient, receiving: EventClient, sender: str) -> None:
        self._lock = threading.Lock()
        self._sending = sending
        self._next, self._number = 0, 0
        self._longest_s = 0.0
        self._slow: list[str] = []
        self._wrong: list[str] = []
        self._unconfirmed: set[int] = set()
        receiving.subscribe(self._receive, EVENTS).wait_in_force(sender, JOIN_LIMIT_S)
        self._pushing = Repeating("events", self._push, EVENT_INTERVAL_S).start()

    def news(self) -> tuple[float, list[str], list[str]]:
        """Since the last question: the longest time for an event [s], events that took long, and what went wrong."""
        with self._lock:
            found = self._longest_s, self._slow, self._wrong
            self._longest_s, self._slow, self._wrong = 0.0, [], []
        return found

    def last(self) -> tuple[float, list[str], list[str]]:
        """Send no more, wait for the last events, and return the last news."""
        self._pushing.close()
        deadline = time.monotonic() + LAST_EVENTS_S
        while self._next < self._number and time.monotonic() < deadline:
            time.sleep(0.1)
        if self._next < self._number:
            self._wrong.append(f"events from {self._next} to {self._number} have not arrived")
        return self.news()

    def _push(self) -> None:
        try:
            self._sending.push(EVENTS[0], [self._number, time.time()])
        except Unconfirmed as error:
            self._unconfirmed.add(self._number)
            with self._lock:
                self._wrong.append(f"event {self._number}: {error}")
        self._number += 1

    def _receive(self, event: Event) -> None:
        number, sent = event.payload
        took_s, missed = time.time() - sent, set(range(self._next, number)) - self._unconfirmed
        with self._lock:
            if missed:
                self._wrong.append(f"events lost: {sorted(missed)[:10]}")
            if number < self._next:
                self._wrong.append(f"event {number} came again")
            if took_s > MAX_CALL_S:
                self._slow.append(f"event {number} took {took_s:.2f} s")
            self._longest_s = max(self._longest_s, took_s)
        self._next = max(self._next, number + 1)


@contextlib.contextmanager
def numbered_events(naming: Address, here: str, there: str) -> Iterator[NumberedEvents]:
    with (
        Orb(naming) as orb,
        EventClient(orb, here, EVENTS[1]) as sending,
        EventClient(orb, there, EVENTS[1]) as receiving,
    ):
        yield NumberedEvents(sending, receiving, here)
