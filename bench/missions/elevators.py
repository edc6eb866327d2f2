"""Ten simultaneous missions over two elevators: thirty robots of three sub-networks, and robots that ride alone.

    python -m bench.missions.elevators [--missions 10] [--riders 4]

Ten boxes stand along a hall with two elevators; two robots carry each of them to the floor above, and a third one is
free. The elevators are not in the middle: for most boxes the same one is nearer. All leaders begin within a second.
Meanwhile some of the free robots ride to the other floor by programs of their own, one after the other, and every
second one is killed while it waits for the cabin.

Every mission must be done. No robot may wait for reserved areas, or for a cabin, longer than was announced when it
asked. The time until all are done is compared with that of first come, first served, with the same durations: when
every mission takes the nearest elevator, and when a dispatcher without any delay gives each the first free one."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import random
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes

from bench.common.harness import run
from bench.missions.simultaneous import (
    Costs,
    Errand,
    Outcome,
    aftermath,
    begin,
    booked_twice,
    ended,
    started,
    states_mixed,
)
from robocorba.errors.base import RoboCorbaError
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, CabinSide, Elevator, ElevatorDoor, MapObject
from robocorba.missions.subplan import Ride
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.registry import Pose
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.buildings import rectangular
from testkit.missions import FLOOR, MissionSystem, RobotStart
from testkit.missions import missions as mission_system
from testkit.report import at_least, at_most, summarize

SUBNETS = ("west", "middle", "east")
UPPER = "L2"
#: Distance of two boxes, and depth of the hall [m].
PITCH_M, DEPTH_M = 3.6, 14.0
BOX_Y_M, ROBOT_Y_M = 3.4, 0.8
CABIN_M = 3.2
#: Places of the elevators along the hall, as shares of its length.
ELEVATORS = {"west lift": 0.4, "east lift": 0.9}
#: Time limit for all missions to end [s].
DEADLINE_S = 1800.0
#: Interval between looks at the reservations [s], and between the programs of riders [s].
LOOK_S, RIDE_EVERY_S = 0.2, 20.0


class Announced(NamedTuple):
    """A wait of a robot and its announced upper bound [s, simulated]. kind: "areas" or "cabin"."""

    kind: str
    robot: str
    waited_s: float
    longest_wait_s: float


class Service(NamedTuple):
    """A mission that has its areas from `since` until `until` [s]. leader, elevator: its own; nearest: elevator."""

    leader: str
    elevator: str
    nearest: str
    since: float
    until: float


# ---- the building ----


def depot(count: int) -> Building:
    """Two floors with `count` boxes on the lower one."""
    length = PITCH_M * count
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, CABIN_M - 0.6) for floor in (FLOOR, UPPER))
    at_y = DEPTH_M - CABIN_M / 2
    return rectangular(
        "depot",
        (length, DEPTH_M),
        [FLOOR, UPPER],
        *(
            ("", Elevator(name, (share * length, at_y), (CABIN_M, CABIN_M), doors, speed=1.0, door_time=2.0))
            for name, share in ELEVATORS.items()
        ),
        *(
            (FLOOR, MapObject(f"box-{n}", BoxShape((0.4, 0.6)), (x_of(n), BOX_Y_M), height=0.8, movable=True))
            for n in range(count)
        ),
    )


def x_of(number: int) -> float:
    """Place of a box along the hall [m]."""
    return PITCH_M * (number + 0.5)


def nearest(number: int, count: int) -> str:
    return min(ELEVATORS, key=lambda name: abs(ELEVATORS[name] * PITCH_M * count - x_of(number)))


def crew(count: int) -> dict[str, RobotStart]:
    """A leader l, a helper h and a free robot f at each box; neighbours are in different sub-networks."""
    found: dict[str, RobotStart] = {}
    for number, (kind, dx) in itertools.product(range(count), (("l", -1.1), ("h", 1.1), ("f", 0.0))):
        subnet = SUBNETS[(len(found) + number) % len(SUBNETS)]
        found[f"{kind}{number}"] = RobotStart(x_of(number) + dx, ROBOT_Y_M, math.pi / 2, subnet)
    return found


# ---- what is observed ----


class Observer:
    """Waits for areas and cabins, announced and actual. Use it in a `with`."""

    def __init__(self, place: MissionSystem) -> None:
        self._place, self._database = place, RemoteDatabase(place.orb, 5.0)
        self._stack = contextlib.ExitStack()
        self.waits: list[Announced] = []
        #: Robots with their first look at a request that waits: by this process's clock, with its bound [s].
        self._asked: dict[str, tuple[float, float]] = {}
        #: Since when robots have their areas, and those that no longer have them.
        self._granted: dict[str, float] = {}
        self.spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
        #: The latest end of a wait for areas that goes on, by its bound.
        self.overdue: set[str] = set()

    def __enter__(self) -> Observer:
        with contextlib.ExitStack() as stack:
            events = stack.enter_context(EventClient(self._place.orb, SUBNETS[0]))
            events.subscribe(self._on_boarding, "simulation.boarding")
            events.subscribe(self._on_collision, "simulation.collision")
            stack.enter_context(contextlib.closing(Repeating("reservations", self._look, LOOK_S).start()))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _on_boarding(self, event: Event) -> None:
        (robot,), found = event.payload["who"], event.payload
        self.waits.append(Announced("cabin", robot, found["waited_s"], found["longest_wait_s"]))

    def _on_collision(self, event: Event) -> None:
        poses = {name: pose for name, pose in self._place.poses().items() if name in event.payload["who"]}
        print(f"collision: {event.payload}, {poses}", flush=True)

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
                    self.waits.append(Announced("areas", robot, now - asked_at - LOOK_S, bound_s))


class Riders:
    """Free robots that ride to the other floor, one after the other. Every second one is killed as it waits."""

    def __init__(self, place: MissionSystem, names: Sequence[str]) -> None:
        self._place, self._left = place, list(names)
        self._database = place.orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        self._number = 0
        #: The one that is to be killed when it waits, and those that were.
        self._doomed = ""
        self.killed: list[str] = []
        self._next_at = time.monotonic() + RIDE_EVERY_S

    def update(self) -> None:
        """To be called periodically."""
        if self._doomed:
            self._kill_if_waiting()
        elif self._left and time.monotonic() > self._next_at:
            self._next_at = time.monotonic() + RIDE_EVERY_S
            self._start(self._left.pop(0))

    def _start(self, name: str) -> None:
        agent = self._place.agent(name)
        try:
            at = self._place.poses()[name]
            agent.load(dumps(ProgramBuilder("ride").mbase_path(UPPER, at.x, ROBOT_Y_M).program()))
            agent.run()
        except RoboCorbaError as error:  # it is in a mission
            print(f"{name} does not ride: {error}", flush=True)
            return
        self._number += 1
        if self._number % 2 == 0:
            self._doomed = name

    def _kill_if_waiting(self) -> None:
        name = self._doomed
        queued = {robot for state in self._database.elevators() for robot in state.queue}
        if name in queued:
            self._place.robots.pop(name).kill()
            self.killed.append(name)
            self._doomed = ""
        elif self._place.is_free(name):  # it has arrived
            self._doomed = ""


# ---- first come, first served ----


def services(place: MissionSystem, observer: Observer, count: int) -> list[Service]:
    """The missions in the order in which they got their areas."""
    found = []
    for number in range(count):
        leader = f"l{number}"
        kept = place.kept(leader)
        if not observer.spans[leader] or kept is None:
            continue
        since, until = observer.spans[leader][-1]
        rides = [step.elevator for step in kept.plan.subplans[0].steps if isinstance(step, Ride)]
        found.append(Service(leader, rides[0], nearest(number, count), since, until))
    return sorted(found, key=lambda service: service.since)


def by_nearest_s(found: Sequence[Service]) -> float:
    """Time until all are done if each takes the nearest elevator [s]."""
    busy: dict[str, float] = defaultdict(float)
    for service in found:
        busy[service.nearest] += service.until - service.since
    return max(busy.values())


def by_first_free_s(found: Sequence[Service]) -> float:
    """Time until all are done if each takes the elevator that is free first, without any pause [s]."""
    busy = dict.fromkeys(ELEVATORS, 0.0)
    for service in found:
        busy[min(busy, key=lambda name: busy[name])] += service.until - service.since
    return max(busy.values())


# ---- the bench ----


def outcomes_of(
    place: MissionSystem, errands: Sequence[Errand], riders: Riders, paces: list[float]
) -> Iterator[Outcome]:
    """Yield each mission as it ends, while others ride."""
    with contextlib.closing(Repeating("riders", riders.update, 0.2).start()):
        yield from ended(place, errands, paces, DEADLINE_S)


def main(missions: int = 10, riders: int = 4, seed: int = 1) -> bool:
    errands = [Errand(f"l{n}", f"box-{n}", Pose(UPPER, x_of(n), BOX_Y_M, 0.0)) for n in range(missions)]
    starts, paces = crew(missions), list[float]()
    alone = random.Random(seed).sample([f"f{number}" for number in range(missions)], riders)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        native.save(depot(missions), folder / "depot.yaml")
        with mission_system(folder, folder / "depot.yaml", ",".join(SUBNETS)) as place, started(place, starts):
            costs, before = Costs(place), place.collisions
            with Observer(place) as observer:
                spread_s = begin(place, errands)
                rides = Riders(place, alone)
                outcomes = list(outcomes_of(place, errands, rides, paces))
                costs.print("missions")
                time.sleep(2.0)  # the last areas are released
                found = services(place, observer, missions)
            wrong = aftermath(place, [name for name in starts if name not in rides.killed], [e.item for e in errands])
            collisions = place.collisions - before
    took_s = max(service.until for service in found) - found[0].since if found else math.nan
    waits = observer.waits
    exceeded = [wait for wait in waits if wait.waited_s > wait.longest_wait_s]
    twice, mixed, done = booked_twice(outcomes), states_mixed(outcomes), sum(one.is_right for one in outcomes)
    print(*twice, *mixed, *wrong, *exceeded, sep="\n")
    for service in found:
        print(f"{service.leader}: {service.elevator}, nearest {service.nearest}, {service.until - service.since:.0f} s")
    print(f"{done} of {len(outcomes)} done; {collisions} collisions; killed in a queue: {rides.killed}")
    print(f"load {os.getloadavg()[0]:.1f}; simulated seconds in a second: {statistics.median(paces):.2f} at the median")
    for kind in ("areas", "cabin"):
        if shares := [wait.waited_s / wait.longest_wait_s for wait in waits if wait[0] == kind and wait.longest_wait_s]:
            print(f"{kind}: {len(shares)} waits, {max(shares):.0%} of the announced one at most")
    nearest_s, first_free_s = (by_nearest_s(found), by_first_free_s(found)) if found else (math.nan, math.nan)
    print(
        f"all carries: {took_s:.0f} s; first come, first served: {nearest_s:.0f} s by the nearest elevator, "
        f"{first_free_s:.0f} s by the first free one"
    )
    marks = [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions done", done, len(outcomes)),
        at_most("waits longer than announced", len(exceeded) + len(observer.overdue), 0),
        at_least("waits for a cabin that were observed", sum(wait.kind == "cabin" for wait in waits), 2 * missions),
        at_least("throughput, of first come first served by the nearest elevator", nearest_s / took_s, 1.0),
        at_least("throughput, of first come first served by the first free elevator", first_free_s / took_s, 0.8),
        at_most("collisions", collisions, 0),
        at_most("robots booked twice, or in two missions at the same time", len(twice) + len(mixed), 0),
        at_most("errors afterwards", len(wrong), 0),
    ]
    rows = [
        {**one.row, "elevator": service.elevator if service else None}
        for one in outcomes
        for service in [next((each for each in found if each.leader == one.row["leader"]), None)]
    ]
    title = f"{len(outcomes)} missions over two elevators, {len(starts)} robots: {done} done in {took_s:.0f} s"
    return summarize("elevator_missions", title, rows, marks, partial(_draw, found), waits=waits)


def _draw(found: Sequence[Service], axes: Axes) -> None:
    """Draw when each mission had its areas, by elevator."""
    start = min((service.since for service in found), default=0.0)
    for name, color in zip(ELEVATORS, ("tab:blue", "tab:orange"), strict=True):
        mine = [service for service in found if service.elevator == name]
        axes.barh(
            [service.leader for service in mine],
            [service.until - service.since for service in mine],
            left=[service.since - start for service in mine],
            color=color,
            label=name,
        )
    axes.set(xlabel="s")
    axes.legend()


if __name__ == "__main__":
    run(main)
