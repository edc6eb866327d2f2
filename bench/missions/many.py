"""Ten simultaneous missions, thirty robots, three sub-networks.

    python -m bench.missions.many [--site rooms|elevators] [--missions 10] [--robots 30] [--riders 4]

`rooms`: ten rooms along a shared corridor. In every other room three robots carry a table, in the others two robots
carry a box; some boxes go out into the corridor. Each room has a leader and one more robot; the others are in the
corridor, where several leaders compete for them.

`elevators`: ten boxes along a hall with two elevators; two robots carry each of them to the floor above, and a third
one is free. Meanwhile some of the free robots ride to the other floor by programs of their own, and every second one
is killed while it waits for the cabin. No robot may wait for reserved areas, or for a cabin, longer than was announced
when it asked. The time until all are done is compared with that of first come, first served, with the same durations:
when every mission takes the nearest elevator, and when a dispatcher without any delay gives each the first free one.

All leaders begin within a second. Every mission must end, at the elevators done. The plans and the status messages to
the leaders show whether a robot was in two missions at the same time. Afterwards all robots must be free, hold nothing
and be stationary."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import random
import statistics
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from bench.common.harness import folder_of_bench, run
from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor.model import BoxShape, Building, CabinSide, Door, Elevator, ElevatorDoor, MapObject, Wall
from robocorba.missions.subplan import Ride
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.registry import Pose
from robocorba.stubs import RoboCorba
from robocorba.system.names import MISSIONS
from robocorba.system.repeating import Repeating
from testkit.buildings import rectangular
from testkit.missions import FLOOR, MissionSystem, RobotStart
from testkit.missions import missions as mission_system
from testkit.report import Mark, at_least, at_most, bars, summarize

SUBNETS = ("west", "middle", "east")
UPPER = "L2"
#: Time limits for all missions to end at a site, and for all robots to be free afterwards [s].
DEADLINE_S, RELEASE_LIMIT_S = {"rooms": 900.0, "elevators": 1800.0}, 120.0
#: Largest distance of an object from its goal [mm].
NEAR_MM = 50.0
#: Interval between looks at the reservations [s], and between the programs of riders [s].
LOOK_S, RIDE_EVERY_S = 0.2, 20.0


class Errand(NamedTuple):
    """A mission to come: its leader has the item carried to the goal."""

    leader: str
    item: str
    goal: Pose


class Outcome(NamedTuple):
    """The outcome of a mission: its row of the table, and the leader's report, empty if there is none."""

    row: dict[str, Any]
    report: dict[str, Any]

    @property
    def is_right(self) -> bool:
        return self.row["result"] == "done" and bool(self.row["off, mm"] < NEAR_MM)

    @property
    def has_ended(self) -> bool:
        return self.is_right or (self.row["result"] == "failed" and bool(self.row["why"]))


# ---- rooms along a corridor ----

#: Size of a room, width of the corridor between the two rows, and width of a room's door [m].
ROOM, CORRIDOR_M, DOOR_M = (6.0, 5.0), 3.4, 1.8
TABLE, BOX = (1.2, 0.8), (0.6, 0.4)
#: Distance that objects are carried within a room, and from a door to a goal in the corridor [m].
ALONG_M, OUTSIDE_M = 1.2, 1.1
#: Rooms whose box goes out into the corridor.
GOES_OUT = (3, 7)
#: The corridor's middle [m].
MIDDLE_M = ROOM[1] + CORRIDOR_M / 2


class Room(NamedTuple):
    """x, y: its middle. side: of the corridor, 1 above and -1 below. item, start, goal: of its object."""

    number: int
    x: float
    y: float
    side: int

    @property
    def leader(self) -> str:
        return f"l{self.number}"

    @property
    def has_box(self) -> bool:
        return self.number % 2 == 1

    @property
    def item(self) -> str:
        return f"{'box' if self.has_box else 'table'}-{self.number}"

    @property
    def start(self) -> tuple[float, float]:
        return (self.x if self.number in GOES_OUT else self.x - ALONG_M / 2, self.y)

    @property
    def goal(self) -> tuple[float, float, float]:
        if self.number in GOES_OUT:
            return self.x, self.y - self.side * (ROOM[1] / 2 + OUTSIDE_M), math.pi / 2
        return self.x + ALONG_M / 2, self.y, 0.0


def rooms(count: int) -> list[Room]:
    """Rooms in two rows, those above the corridor first."""
    above = (count + 1) // 2
    places = [(number % above, 1 if number < above else -1) for number in range(count)]
    half = CORRIDOR_M / 2 + ROOM[1] / 2
    return [
        Room(number, (column + 0.5) * ROOM[0], MIDDLE_M + side * half, side)
        for number, (column, side) in enumerate(places)
    ]


def building(of: Sequence[Room], without: Sequence[str] = ()) -> Building:
    """without: items that are left out."""
    east, north = max(room.x for room in of) + ROOM[0] / 2, 2 * MIDDLE_M
    sides = {side: MIDDLE_M + side * CORRIDOR_M / 2 for side in (1, -1)}
    parts: list[Any] = [Wall(f"corridor-{side}", (0.0, y), (east, y)) for side, y in sides.items()]
    for room in of:
        y, x = sides[room.side], room.x + ROOM[0] / 2
        if x < east:
            parts.append(Wall(f"wall-{room.number}", (x, y), (x, north if room.side > 0 else 0.0)))
        parts.append(Door(f"door-{room.number}", (room.x - DOOR_M / 2, y), (room.x + DOOR_M / 2, y)))
        if room.item not in without:
            shape = BoxShape(BOX if room.has_box else TABLE)
            parts.append(MapObject(room.item, shape, room.start, height=0.7, movable=True))
    return rectangular("many rooms", (east, north), [FLOOR], *((FLOOR, part) for part in parts))


def in_rooms(of: Sequence[Room], count: int) -> dict[str, RobotStart]:
    """Leaders and as many other robots in the rooms, the rest in two rows along the corridor; neighbours are in
    different sub-networks."""
    places = [(room.x - 2.3, room.y + 1.7 * room.side, 0.0) for room in of]
    places += [(room.x + 2.3, room.y + 1.7 * room.side, math.pi) for room in of]
    left = count - len(places)
    east = max(room.x for room in of) + ROOM[0] / 2
    pitch = east / max(1, (left + 1) // 2)
    for number in range(max(0, left)):  # not before doors
        places.append((min(pitch * (number // 2 + 1), east - 0.7), MIDDLE_M + 0.85 * (-1) ** number, 0.0))
    names = [room.leader for room in of] + [f"r{number}" for number in range(count - len(of))]
    return {
        name: RobotStart(*place, SUBNETS[(number + number // len(SUBNETS)) % len(SUBNETS)])
        for number, (name, place) in enumerate(zip(names, places, strict=False))
    }


# ---- boxes along a hall with elevators ----

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
    """Waits for areas and cabins, announced and actual, and robots that ride alone. Use it in a `with`.

    spans: when robots had their areas. overdue: robots that waited longer than announced. killed: riders."""

    def __init__(self, place: MissionSystem, riders: Sequence[str]) -> None:
        self._place, self._database = place, RemoteDatabase(place.orb, 5.0)
        self._elevators = place.orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        self._stack = contextlib.ExitStack()
        self.waits: list[Wait] = []
        self.spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self.overdue: set[str] = set()
        self._asked: dict[str, tuple[float, float]] = {}
        self._granted: dict[str, float] = {}
        self.killed: list[str] = []
        self._riders, self._number, self._doomed = list(riders), 0, ""
        self._next_at = time.monotonic() + RIDE_EVERY_S

    def __enter__(self) -> Observer:
        with contextlib.ExitStack() as stack:
            events = stack.enter_context(EventClient(self._place.orb, SUBNETS[0]))
            events.subscribe(self._on_boarding, "simulation.boarding")
            for name, call in (("reservations", self._look), ("riders", self._ride)):
                stack.enter_context(contextlib.closing(Repeating(name, call, LOOK_S).start()))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

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

    def _ride(self) -> None:
        """Let one free robot after the other ride. Every second one is killed as it waits."""
        if name := self._doomed:
            if name in {robot for state in self._elevators.elevators() for robot in state.queue}:
                self._place.robots.pop(name).kill()
                self.killed.append(name)
                self._doomed = ""
            elif self._place.is_free(name):  # it has arrived
                self._doomed = ""
        elif self._riders and time.monotonic() > self._next_at:
            self._next_at = time.monotonic() + RIDE_EVERY_S
            name, agent = self._riders[0], self._place.agent(self._riders.pop(0))
            try:
                to = self._place.poses()[name].x, ROBOT_Y_M
                agent.load(dumps(ProgramBuilder("ride").mbase_path(UPPER, *to).program()))
                agent.run()
            except RoboCorbaError as error:  # it is in a mission
                print(f"{name} does not ride: {error}", flush=True)
                return
            self._number += 1
            self._doomed = name if self._number % 2 == 0 else ""


class Service(NamedTuple):
    """A mission that has its areas from `since` until `until` [s]. leader, elevator: its own; nearest: elevator."""

    leader: str
    elevator: str
    nearest: str
    since: float
    until: float


def services(place: MissionSystem, observer: Observer, count: int) -> list[Service]:
    """The missions in the order in which they got their areas."""
    found = []
    for number in range(count):
        leader, kept = f"l{number}", place.kept(f"l{number}")
        if observer.spans[leader] and kept is not None:
            rides = [step.elevator for step in kept.plan.subplans[0].steps if isinstance(step, Ride)]
            nearest = min(ELEVATORS, key=lambda name: abs(ELEVATORS[name] * PITCH_M * count - x_of(number)))
            found.append(Service(leader, rides[0], nearest, *observer.spans[leader][-1]))
    return sorted(found, key=lambda service: service.since)


def first_come_s(found: Sequence[Service], is_ideal: bool) -> float:
    """Time until all are done if each takes the nearest elevator, or (is_ideal) the first free one [s]."""
    busy = dict.fromkeys(ELEVATORS, 0.0)
    for service in found:
        name = min(busy, key=lambda each: busy[each]) if is_ideal else service.nearest
        busy[name] += service.until - service.since
    return max(busy.values()) if found else math.nan


def elevator_marks(observer: Observer, found: Sequence[Service], missions: int) -> list[Mark]:
    exceeded = [wait for wait in observer.waits if wait.waited_s > wait.longest_wait_s]
    print(*exceeded, *found, sep="\n")
    for kind in ("areas", "cabin"):
        waits = [wait for wait in observer.waits if wait.kind == kind and wait.longest_wait_s]
        if shares := [wait.waited_s / wait.longest_wait_s for wait in waits]:
            print(f"{kind}: {len(shares)} waits, {max(shares):.0%} of the announced one at most")
    took_s = max(service.until for service in found) - found[0].since if found else math.nan
    nearest_s, ideal_s = (first_come_s(found, is_ideal) for is_ideal in (False, True))
    print(f"all carries: {took_s:.0f} s; first come, first served: {nearest_s:.0f} s, ideal dispatcher {ideal_s:.0f} s")
    cabins = sum(wait.kind == "cabin" for wait in observer.waits)
    return [
        at_most("waits longer than announced", len(exceeded) + len(observer.overdue), 0),
        at_least("waits for a cabin that were observed", cabins, 2 * missions),
        at_least("throughput, of first come first served by the nearest elevator", nearest_s / took_s, 1.0),
        at_least("throughput, of first come first served by the first free elevator", ideal_s / took_s, 0.8),
    ]


# ---- the missions ----


def begin(place: MissionSystem, errands: Sequence[Errand]) -> float:
    """Start all missions; return the time between the first and the last start [s]."""
    agents = [place.agent(errand.leader) for errand in errands]
    for agent, errand in zip(agents, errands, strict=True):
        agent.load(dumps(ProgramBuilder("carry").move_table(errand.item, Destination(*errand.goal)).program()))

    def start(agent: Any) -> float:
        agent.run()
        return time.monotonic()

    with ThreadPoolExecutor(len(agents)) as threads:
        began = sorted(threads.map(start, agents))
    return began[-1] - began[0]


def ended(place: MissionSystem, errands: Sequence[Errand], deadline_s: float) -> Iterator[Outcome]:
    """Yield each mission as it ends, and the others after the deadline."""
    until, running, paces = time.monotonic() + deadline_s, list(errands), []
    while running:
        paces.append(float(place.server._get_state().achieved))
        for errand in running[:]:
            try:
                report = place.agent(errand.leader).state().program
            except RoboCorbaError as error:  # too busy to answer, or gone
                report = ProgramReport(reason=str(error))
            if report.result is not ProgramResult.NO_RESULT or time.monotonic() > until:
                running.remove(errand)
                yield outcome(place, errand, report)
        time.sleep(1.0)
    print(f"simulated seconds in a second: {statistics.median(paces):.2f} at the median, {min(paces):.2f} at least")


def outcome(place: MissionSystem, errand: Errand, report: ProgramReport) -> Outcome:
    files = list((place.folder / errand.leader / MISSIONS).glob("*/report.json"))
    known = json.loads(files[0].read_text()) if files else {}
    phases, at = known.get("phases", ()), place.poses()[errand.item]
    row = {
        "leader": errand.leader,
        "thing": errand.item,
        "robots": ", ".join(known.get("robots", ())),
        "result": report.result.name.lower(),
        "seconds": report.seconds,
        "agreed after, s": next((phase["began_s"] for phase in phases if phase["started_s"]), math.nan),
        "attempts": len({one["mission"] for one in known.get("events", ())}),
        "off, mm": 1000 * math.dist(at[1:3], errand.goal[1:3]) if at.floor == errand.goal.floor else math.inf,
        "tick skew p99, ms": (known.get("tick_skew_ms") or {}).get("p99"),
        "why": report.reason,
    }
    print(*row.values(), sep="\t", flush=True)
    return Outcome(row, known)


def booked_twice(outcomes: Sequence[Outcome]) -> list[str]:
    """Robots that began a mission before their previous one had ended, by the accepted plans."""
    spans: dict[str, list[tuple[float, float, str]]] = defaultdict(list)
    for row, report in outcomes:
        if not math.isnan(row["agreed after, s"]):
            for robot in report["robots"]:
                span = (report["began"] + row["agreed after, s"], report["began"] + report["seconds"])
                spans[robot].append((*span, row["leader"]))
    return [
        f"{robot}: {leader} and {other}"
        for robot, parts in spans.items()
        for (_, until, leader), (since, _, other) in itertools.pairwise(sorted(parts))
        if since < until
    ]


def states_mixed(outcomes: Sequence[Outcome]) -> list[str]:
    """Robots whose status messages to the leaders name one mission, another one, and the first one again."""
    received: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for _, report in outcomes:
        for event in report.get("events", ()):
            if event["type"] == "mission.state":
                received[event["source"]].append((event["sent"], event["mission"]))
    runs = {
        robot: [mission for mission, _ in itertools.groupby(mission for _, mission in sorted(sent))]
        for robot, sent in received.items()
    }
    return [f"{robot}: {missions}" for robot, missions in runs.items() if len(missions) != len(set(missions))]


def main(site: str = "rooms", missions: int = 10, robots: int = 30, riders: int = 4, seed: int = 1) -> bool:
    of, alone, observer = rooms(missions), list[str](), None
    if has_lifts := site == "elevators":
        plan, starts = depot(missions), at_boxes(missions)
        errands = [Errand(f"l{n}", f"box-{n}", Pose(UPPER, x_of(n), BOX_Y_M, 0.0)) for n in range(missions)]
        alone = random.Random(seed).sample([f"f{number}" for number in range(missions)], min(riders, missions))
    else:
        plan, starts = building(of), in_rooms(of, robots)
        errands = [Errand(room.leader, room.item, Pose(FLOOR, *room.goal)) for room in of]
    found: list[Service] = []
    with (
        folder_of_bench() as folder,
        mission_system(folder, plan, ",".join(SUBNETS)) as place,
        contextlib.ExitStack() as stack,
    ):
        place.start(starts)
        before = place.collisions
        if has_lifts:
            observer = stack.enter_context(Observer(place, alone))
        spread_s = begin(place, errands)
        outcomes = list(ended(place, errands, DEADLINE_S[site]))
        if observer:
            time.sleep(2.0)  # the last areas are released
            found = services(place, observer, missions)
        left = [name for name in starts if name in place.robots]
        wrong = place.left_behind(left, [errand.item for errand in errands], RELEASE_LIMIT_S)
        collisions = place.collisions - before
    twice, mixed, done = booked_twice(outcomes), states_mixed(outcomes), sum(one.is_right for one in outcomes)
    print(*twice, *mixed, *wrong, sep="\n")
    marks = [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions that ended, done or with a reason", sum(one.has_ended for one in outcomes), len(outcomes)),
        at_most("robots booked twice, by plans", len(twice), 0),
        at_most("robots in two missions at the same time, by their status messages", len(mixed), 0),
        at_most("errors afterwards", len(wrong), 0),
    ]
    if observer:
        marks += [at_least("missions done", done, len(outcomes)), at_most("collisions", collisions, 0)]
        marks += elevator_marks(observer, found, missions)
    title = f"{len(outcomes)} simultaneous missions, {len(starts)} robots: {done} done, {collisions} collisions"
    draw = bars({one.row["leader"]: one.row["seconds"] for one in outcomes}, "s")
    return summarize(f"many_missions_{site}", title, [one.row for one in outcomes], marks, draw)


if __name__ == "__main__":
    run(main, site="rooms|elevators", robots="at the site rooms", riders="robots that ride alone", seed="of the riders")
