"""Those who do nothing wrong while others attack: driving robots, missions, and a client of everything."""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

import CosNaming
from omniORB import CORBA

from bench.chaos.attackers import EMPTY_FLOOR, EMPTY_FLOOR_M, HERE, ROBOT, THERE
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import Unconfirmed
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor.model import BoxShape, Building, MapObject, Wall
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from testkit.buildings import rectangular
from testkit.missions import FLOOR, MissionSystem, RobotStart
from testkit.simulation import CROSS, NO_MOUNT

#: What a client measures beside calls: the time of an event, and how long a name led to somebody else.
EVENT, STOLEN = "an event", "a stolen name"
#: Interval between two calls of an object, between two numbered events, and timeout of a call [s].
INTERVAL_S, EVENT_INTERVAL_S, CALL_TIMEOUT_S = 0.05, 0.2, 10.0
#: Time limits for the subscription to reach the other channel, for the last events to arrive, and for a mission [s].
JOIN_LIMIT_S, LAST_EVENTS_S, MISSION_S = 60.0, 30.0, 300.0
#: Lines that are printed of each kind of complaint.
MAX_LINES = 20
#: Lanes on which robots drive, their distance and length [m]; two rooms above them, and the tables' way [m].
LANES, LANE_M, LENGTH_M, LANES_M = 20, 1.1, 1.6, 4.0
MIDDLES, MIDDLE_Y_M, WAY_M, NEAR_M = {"A": 6.0, "B": 18.0}, 7.5, 1.2, 0.05


def building() -> Building:
    """Lanes along the south wall, two rooms with a table each; above them an empty floor."""
    width, depth = EMPTY_FLOOR_M
    tables = [
        MapObject(f"table-{name}", BoxShape((1.2, 0.8)), (x - WAY_M / 2, MIDDLE_Y_M), height=0.7, movable=True)
        for name, x in MIDDLES.items()
    ]
    walls = [Wall("south", (0.0, LANES_M), (width, LANES_M)), Wall("between", (width / 2, LANES_M), (width / 2, depth))]
    parts = [(FLOOR, part) for part in (*walls, *tables)]
    return rectangular("chaos", EMPTY_FLOOR_M, [FLOOR, EMPTY_FLOOR], *parts)


def starts(drivers: int) -> dict[str, RobotStart]:
    """Three robots in each room, and one on each lane until there are enough."""
    found: dict[str, RobotStart] = {}
    for leader, middle in MIDDLES.items():
        corners = (-3.0, -1.7, 0.0), (3.0, 1.7, math.pi), (3.0, -1.7, math.pi)
        for name, (x, y, heading), channel in zip(("", "1", "2"), corners, (HERE, THERE, HERE), strict=True):
            found[f"{leader}{name}"] = RobotStart(middle + x, MIDDLE_Y_M + y, heading, channel)
    for number in range(drivers):
        found[f"d{number}"] = RobotStart(lane(number), 1.0, math.pi / 2, (HERE, THERE)[number % 2])
    return found


def lane(number: int) -> float:
    """x of a lane [m]."""
    return LANE_M * (number + 1)


class Complaints:
    """Counts what happens to those who do nothing wrong, and prints it: texts that differ in numbers only MAX_LINES
    times. beside: what runs now."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self.beside = ""
        self._kinds: Counter[str] = Counter()

    def add(self, what: str) -> None:
        self.found.append(what)
        kind = re.sub(r"[0-9]+", "#", what)
        self._kinds[kind] += 1
        if self._kinds[kind] <= MAX_LINES:
            print(f"{what}, beside {self.beside or 'nothing'}", flush=True)


class Drivers:
    """Robots that drive to and fro by paths of the planner."""

    def __init__(self, place: MissionSystem, count: int, complain: Complaints) -> None:
        self._complain = complain
        self._agents = [place.agent(f"d{number}") for number in range(count)]  # once: attackers steal names
        for number, agent in enumerate(self._agents):
            builder = ProgramBuilder("to and fro")
            with builder.repeat(10_000):
                builder.mbase_path(FLOOR, lane(number), 1.0 + LENGTH_M).mbase_path(FLOOR, lane(number), 1.0)
            agent.load(dumps(builder.program()))
            agent.run()

    def look(self) -> None:
        """Complain of those that stand, and let them drive on."""
        for agent in self._agents:
            try:
                state = agent.state()
                if state.condition is not AgentCondition.RUNNING:
                    reason = state.program.reason or state.reason
                    self._complain.add(f"{agent.name} is {state.condition.name}: {reason}")
                    agent.run()
            except RoboCorbaError as error:
                self._complain.add(f"{agent.name}: {error}")


class Carrier(threading.Thread):
    """A mission that is given again and again: a table is carried to and fro. done: times of those that brought it to
    its goal [s]; failed: the number of the others."""

    def __init__(self, place: MissionSystem, leader: str, complain: Complaints) -> None:
        super().__init__(daemon=True)
        self._place, self._leader, self._complain = place, leader, complain
        self._ending = threading.Event()
        self.done: list[float] = []
        self.failed = 0

    def run(self) -> None:
        side = 1
        while not self._ending.is_set():
            goal = MIDDLES[self._leader] + side * WAY_M / 2, MIDDLE_Y_M
            began, off_m = time.monotonic(), math.inf
            user = self._place.mission(self._leader, f"table-{self._leader}", f"{FLOOR}:{goal[0]},{goal[1]},0")
            result, reason = self._place.result(user, MISSION_S)
            with contextlib.suppress(RoboCorbaError):
                off_m = math.dist(self._place.body(f"table-{self._leader}")[:2], goal)
            if result == "done" and off_m < NEAR_M:
                self.done.append(time.monotonic() - began)
            else:
                self.failed += 1
                self._complain.add(f"mission of {self._leader}: {result}, {reason}, {1000 * off_m:.0f} mm off")
            side = -side if off_m < WAY_M / 2 else side

    def end(self) -> None:
        """Wait for the end of the last mission."""
        self._ending.set()
        self.join(MISSION_S)


# ---- a client of everything, in a process of its own ----


class Client:
    """Calls every server, looks up names, and sends numbered events from one sub-network to the other."""

    def __init__(self, orb: Orb, sending: EventClient, receiving: EventClient) -> None:
        self._orb, self._sending, self._lock = orb, sending, threading.Lock()
        self._longest: dict[str, float] = {}
        self._wrong: list[str] = []
        self._next, self._number, self._unconfirmed = 0, 0, set[int]()
        self._names = orb.reference(f"corbaloc::{orb.naming}/NameService", CosNaming.NamingContext)
        self._rightful = {
            name: self._bound(name) for name in ("PathPlanner", f"{CHANNELS}/{HERE}", f"{ROBOTS}/{ROBOT}")
        }
        self._stolen_at: dict[str, float] = {}
        receiving.subscribe(self._receive, "chaos.count").wait_in_force(HERE, JOIN_LIMIT_S)
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        pose = RoboCorba.Pose(FLOOR, 12.0, 3.5, 0.0)
        start, goal = RoboCorba.Point(FLOOR, 2.0, 3.5), RoboCorba.Point(FLOOR, 22.0, 3.5)
        calls: dict[str, Callable[[], object]] = {
            "MapEditor": orb.resolve("MapEditor", RoboCorba.MapEditor)._get_currentVersion,
            "PathPlanner": lambda: planner.getPath(start, goal),
            "SimulationServer": orb.resolve("SimulationServer", RoboCorba.SimulationServer)._get_state,
            "OmniDatabase": lambda: database.getFloor(FLOOR),
            "VirtualSensor": lambda: sensor.scan(pose, NO_MOUNT, CROSS),
            "EventChannel": orb.resolve(f"{CHANNELS}/{HERE}", RoboCorba.EventChannel)._get_name,
            "RobotAgent": orb.resolve(f"{ROBOTS}/{ROBOT}", RoboCorba.RobotAgent)._get_state,
        }
        self._tasks = [Repeating(name, partial(self._call, name, call), INTERVAL_S) for name, call in calls.items()]
        self._tasks += [
            Repeating("names", self._look_up, INTERVAL_S),
            Repeating("events", self._push, EVENT_INTERVAL_S),
        ]
        for task in self._tasks:
            task.start()

    def take(self) -> tuple[dict[str, float], list[str]]:
        """Since the last question: the longest of each call, event and theft [s], and what went wrong."""
        with self._lock:
            found, self._longest, self._wrong = (self._longest, self._wrong), {}, []
        return found

    def end(self) -> tuple[dict[str, float], list[str]]:
        """Wait for the last events; the last answer of `take`."""
        for task in self._tasks:
            task.close()
        until = time.monotonic() + LAST_EVENTS_S
        while self._next < self._number and time.monotonic() < until:
            time.sleep(0.1)
        self._note(EVENT, 0.0, f"events from {self._next} on are lost" if self._next < self._number else "")
        return self.take()

    def _note(self, what: str, took_s: float, error: str = "") -> None:
        with self._lock:
            self._longest[what] = max(took_s, self._longest.get(what, 0.0))
            if error:
                self._wrong.append(f"{what}: {error}")

    def _call(self, name: str, call: Callable[[], object]) -> None:
        began, error = time.monotonic(), ""
        try:
            call()
        except CORBA.UserException:
            pass  # a server may refuse a call, such as for a path to where another robot stands
        except (CORBA.Exception, RoboCorbaError) as raised:
            error = error_of(raised)
        self._note(name, time.monotonic() - began, error)

    def _bound(self, name: str) -> str:
        parts = [CosNaming.NameComponent(part, "") for part in ("RoboCorba", *name.split("/"))]
        return self._orb.uri(self._names.resolve(parts))

    def _look_up(self) -> None:
        for name, rightful in self._rightful.items():
            found = ""
            with contextlib.suppress(CORBA.Exception):
                found = self._bound(name)
            if found == rightful:
                self._stolen_at.pop(name, None)
            else:
                self._note(STOLEN, time.monotonic() - self._stolen_at.setdefault(name, time.monotonic()))

    def _push(self) -> None:
        try:
            self._sending.push("chaos.count", [self._number, time.time()])
        except Unconfirmed as error:
            self._unconfirmed.add(self._number)
            self._note(EVENT, 0.0, f"{self._number}: {error}")
        self._number += 1

    def _receive(self, event: Event) -> None:
        number, sent = event.payload
        if missed := set(range(self._next, number)) - self._unconfirmed:
            self._note(EVENT, 0.0, f"lost: {sorted(missed)[:10]}")
        self._note(EVENT, time.time() - sent, f"{number} came again" if number < self._next else "")
        self._next = max(self._next, number + 1)


@contextlib.contextmanager
def client(naming: Address) -> Iterator[Client]:
    with (
        Orb(naming, call_timeout_s=CALL_TIMEOUT_S) as orb,
        EventClient(orb, HERE, "client") as sending,
        EventClient(orb, THERE, "client") as receiving,
    ):
        yield Client(orb, sending, receiving)
