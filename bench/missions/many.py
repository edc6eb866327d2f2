"""Ten missions at once, with thirty robots of three sub-networks, over two elevators.

    python -m bench.missions.many [--missions 10]

Ten boxes stand along a hall with two elevators; two robots carry each of them to the floor above, and a third one is
free. All leaders begin within a second, and every mission must be done. No robot may wait for reserved areas, or for a
cabin, longer than was announced when it asked. The time until all are done is compared with that of first come, first
served, with the same durations: when every mission takes the nearest elevator, and when a dispatcher without any delay
gives each the first free one.

The plans show whether a robot was in two missions at the same time. Afterwards all robots must be free, hold nothing
and be stationary."""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from bench.common.harness import folder_of_bench, run
from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor.model import BoxShape, Building, CabinSide, Elevator, ElevatorDoor, MapObject
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.registry import Pose
from robocorba.system.repeating import Repeating
from testkit.buildings import rectangular
from testkit.missions import FLOOR, MissionSystem, RobotStart
from testkit.missions import missions as mission_system
from testkit.report import at_least, at_most, summarize

SUBNETS = ("west", "middle", "east")
UPPER = "L2"
#: Time limits for all missions to end, and for all robots to be free afterwards [s].
DEADLINE_S, RELEASE_LIMIT_S = 1800.0, 120.0
#: Largest distance of a box from its goal [mm].
NEAR_MM = 50.0
#: Interval between looks at the reservations [s].
LOOK_S = 0.2
#: Distance of two boxes, and depth of the hall [m].
PITCH_M, DEPTH_M = 3.6, 14.0
BOX_Y_M, ROBOT_Y_M = 3.4, 0.8
CABIN_M = 3.2
#: Places of the elevators along the hall, as shares of its length: not in the middle, for most boxes one is nearer.
ELEVATORS = {"west lift": 0.4, "east lift": 0.9}


def depot(count: int) -> Building:
    """Two floors with `count` boxes on the lower one."""
    length = PITCH_M * count
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, CABIN_M - 0.6) for floor in (FLOOR, UPPER))
    lifts = [
        Elevator(name, (share * length, DEPTH_M - CABIN_M / 2), (CABIN_M, CABIN_M), doors, speed=1.0, door_time=2.0)
        for name, share in ELEVATORS.items()
    ]
    boxes = [
        MapObject(f"box-{n}", BoxShape((0.4, 0.6)), (x_of(n), BOX_Y_M), height=0.8, movable=True) for n in range(count)
    ]
    parts = [*(("", lift) for lift in lifts), *((FLOOR, box) for box in boxes)]
    return rectangular("depot", (length, DEPTH_M), [FLOOR, UPPER], *parts)


def x_of(number: int) -> float:
    """Place of a box along the hall [m]."""
    return PITCH_M * (number + 0.5)


def at_boxes(count: int) -> dict[str, RobotStart]:
    """A leader l, a helper h and a free robot f at each box; neighbours are in different sub-networks."""
    found: dict[str, RobotStart] = {}
    for number, (kind, dx) in itertools.product(range(count), (("l", -1.1), ("h", 1.1), ("f", 0.0))):
        subnet = SUBNETS[(len(found) + number) % len(SUBNETS)]
        found[f"{kind}{number}"] = RobotStart(x_of(number) + dx, ROBOT_Y_M, math.pi / 2, subnet)
    return found


class Wait(NamedTuple):
    """A wait of a robot and its announced upper bound [s, simulated]. kind: "areas" or "cabin"."""

    kind: str
    robot: str
    waited_s: float
    longest_wait_s: float


class Observer:
    """Waits for areas and cabins, announced and actual.

    spans: when robots had their areas. overdue: robots that waited longer than announced."""

    def __init__(self, place: MissionSystem) -> None:
        self._place, self._database = place, RemoteDatabase(place.orb, 5.0)
        self.waits: list[Wait] = []
        self.spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self.overdue: set[str] = set()
        self._asked: dict[str, tuple[float, float]] = {}
        self._granted: dict[str, float] = {}

    @contextlib.contextmanager
    def observing(self) -> Iterator[Observer]:
        with (
            EventClient(self._place.orb, SUBNETS[0]) as events,
            contextlib.closing(Repeating("reservations", self._look, LOOK_S).start()),
        ):
            events.subscribe(self._on_boarding, "simulation.boarding")
            yield self

    def _on_boarding(self, event: Event) -> None:
        (robot,), found = event.payload["who"], event.payload
        self.waits.append(Wait("cabin", robot, found["waited_s"], found["longest_wait_s"]))

    def _look(self) -> None:
        try:
            found = {each.robot: each.status for each in self._database.reservations()}
        except RoboCorbaError:
            return
        now = time.monotonic()
        for robot in self._granted.keys() - found.keys():
            self.spans[robot].append((self._granted.pop(robot), now))
        for robot in self._asked.keys() - found.keys():  # withdrawn
            del self._asked[robot]
        for robot, status in found.items():
            if not status.granted:
                asked_at, bound_s = self._asked.setdefault(robot, (now, status.longest_wait_s))
                if now - asked_at > bound_s + LOOK_S:
                    self.overdue.add(robot)
            elif robot not in self._granted:
                self._granted[robot] = now
                if robot in self._asked:
                    asked_at, bound_s = self._asked.pop(robot)
                    self.waits.append(Wait("areas", robot, now - asked_at - LOOK_S, bound_s))


class Service(NamedTuple):
    """A mission that has its areas from `since` until `until` [s]. nearest: elevator."""

    leader: str
    nearest: str
    since: float
    until: float


def services(observer: Observer, count: int) -> list[Service]:
    """The missions in the order in which they got their areas."""
    found = []
    for number in range(count):
        nearest = min(ELEVATORS, key=lambda name: abs(ELEVATORS[name] * PITCH_M * count - x_of(number)))
        found += [Service(f"l{number}", nearest, *span) for span in observer.spans[f"l{number}"][-1:]]
    return sorted(found, key=lambda service: service.since)


def first_come_s(found: Sequence[Service], is_ideal: bool) -> float:
    """Time until all are done if each takes the nearest elevator, or (is_ideal) the first free one [s]."""
    busy = dict.fromkeys(ELEVATORS, 0.0)
    for service in found:
        name = min(busy, key=lambda each: busy[each]) if is_ideal else service.nearest
        busy[name] += service.until - service.since
    return max(busy.values()) if found else math.nan


def begin(place: MissionSystem, missions: int) -> float:
    """Start all missions; return the time between the first and the last start [s]."""
    agents = [place.agent(f"l{number}") for number in range(missions)]
    for number, agent in enumerate(agents):
        goal = Destination(UPPER, x_of(number), BOX_Y_M, 0.0)
        agent.load(dumps(ProgramBuilder("carry").move_table(f"box-{number}", goal).program()))

    def start(agent: Any) -> float:
        agent.run()
        return time.monotonic()

    with ThreadPoolExecutor(missions) as threads:
        began = sorted(threads.map(start, agents))
    return began[-1] - began[0]


def ended(place: MissionSystem, missions: int) -> Iterator[dict[str, Any]]:
    """The row of each mission as it ends, and of the others after the deadline."""
    until, running = time.monotonic() + DEADLINE_S, set(range(missions))
    while running:
        for number in sorted(running):
            try:
                report = place.agent(f"l{number}").state().program
            except RoboCorbaError as error:  # too busy to answer, or gone
                report = ProgramReport(reason=str(error))
            if report.result is not ProgramResult.NO_RESULT or time.monotonic() > until:
                running.remove(number)
                yield row(number, place, report)
        time.sleep(1.0)


def row(number: int, place: MissionSystem, report: ProgramReport) -> dict[str, Any]:
    known: dict[str, Any] = {"robots": (), "began": math.inf, "phases": ()}
    with contextlib.suppress(IndexError):  # it was refused
        known = place.report(f"l{number}")
    at, goal = place.poses()[f"box-{number}"], Pose(UPPER, x_of(number), BOX_Y_M, 0.0)
    found = {
        "leader": f"l{number}",
        "robots": ", ".join(known["robots"]),
        "result": report.result.name.lower(),
        "seconds": report.seconds,
        "began": known["began"],
        "agreed after, s": next((phase["began_s"] for phase in known["phases"] if phase["started_s"]), math.inf),
        "off, mm": 1000 * math.dist(at[1:3], goal[1:3]) if at.floor == goal.floor else math.inf,
        "why": report.reason,
    }
    print(*found.values(), sep="\t", flush=True)
    return found


def booked_twice(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Robots that began a mission before their previous one had ended, by the accepted plans."""
    spans: dict[str, list[tuple[float, float, str]]] = defaultdict(list)
    for each in rows:
        for robot in each["robots"].split(", "):
            since = each["began"] + each["agreed after, s"]
            spans[robot].append((since, each["began"] + each["seconds"], each["leader"]))
    return [
        f"{robot}: {leader} and {other}"
        for robot, parts in spans.items()
        for (_, until, leader), (since, _, other) in itertools.pairwise(sorted(parts))
        if since < until
    ]


def main(missions: int = 10) -> bool:
    with (
        folder_of_bench() as folder,
        mission_system(folder, depot(missions), ",".join(SUBNETS)) as place,
        Observer(place).observing() as observer,
    ):
        place.start(at_boxes(missions))
        before = place.collisions
        spread_s = begin(place, missions)
        rows = list(ended(place, missions))
        time.sleep(2.0)  # the last areas are released
        found = services(observer, missions)
        wrong = place.left_behind(list(place.robots), [f"box-{n}" for n in range(missions)], RELEASE_LIMIT_S)
        collisions = place.collisions - before
    twice, done = booked_twice(rows), sum(row["result"] == "done" and row["off, mm"] < NEAR_MM for row in rows)
    exceeded = [wait for wait in observer.waits if wait.waited_s > wait.longest_wait_s]
    print(*twice, *wrong, *exceeded, *found, sep="\n")
    for kind in ("areas", "cabin"):
        waits = [wait for wait in observer.waits if wait.kind == kind and wait.longest_wait_s]
        if shares := [wait.waited_s / wait.longest_wait_s for wait in waits]:
            print(f"{kind}: {len(shares)} waits, {max(shares):.0%} of the announced one at most")
    took_s = max(service.until for service in found) - found[0].since if found else math.nan
    nearest_s, ideal_s = (first_come_s(found, is_ideal) for is_ideal in (False, True))
    print(f"all carries: {took_s:.0f} s; first come, first served: {nearest_s:.0f} s, ideal dispatcher {ideal_s:.0f} s")
    marks = [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions done", done, missions),
        at_most("robots booked twice, by plans", len(twice), 0),
        at_most("errors afterwards", len(wrong), 0),
        at_most("collisions", collisions, 0),
        at_most("waits longer than announced", len(exceeded) + len(observer.overdue), 0),
        at_least(
            "waits for a cabin that were observed", sum(wait.kind == "cabin" for wait in observer.waits), 2 * missions
        ),
        at_least("throughput, of first come first served by the nearest elevator", nearest_s / took_s, 1.0),
        at_least("throughput, of first come first served by the first free elevator", ideal_s / took_s, 0.8),
    ]
    title = f"{missions} simultaneous missions, {3 * missions} robots: {done} done, {collisions} collisions"
    return summarize("many_missions", title, rows, marks)


if __name__ == "__main__":
    run(main)
