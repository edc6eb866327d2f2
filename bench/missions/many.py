"""Ten simultaneous missions: thirty robots of three sub-networks in one building.

    python -m bench.missions.many [--missions 10] [--robots 30]

Ten rooms lie along both sides of a shared corridor. In every other room three robots carry a table, in the others two
robots carry a box; some boxes go out through the door into the corridor. Each room has a leader and one more robot; the
other robots are in the corridor, where several leaders compete for them. All leaders begin within a second.

Every mission must end within a deadline: done, or with a reason. The plans and the status messages to the leaders show
whether a robot was in two missions at the same time. Afterwards all robots must be free, hold nothing and be
stationary. The CPU time of the processes is measured, idle and in missions: it shows whether delays are due to too few
cores."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, cast

import msgspec
import psutil
from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from robocorba.control.runner import ProgramReport, ProgramResult
from robocorba.errors.base import RoboCorbaError
from robocorba.maps import native
from robocorba.maps.model import BoxShape, Building, Door, Floor, FloorMap, GeometricalMap, MapObject, Wall
from robocorba.maps.topology import topological_map
from robocorba.names import MISSIONS
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.icons import Destination
from robocorba.programs.program import dumps
from robocorba.testing.missions import FLOOR, MissionSystem, Start, missions
from robocorba.testing.processes import eventually
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, summarize

NAME = "many_missions"
SUBNETS = ("west", "middle", "east")
#: Size of a room, width of the corridor between the two rows, and width of a room's door [m].
ROOM, CORRIDOR_M, DOOR_M = (6.0, 5.0), 3.4, 1.8
TABLE, BOX = (1.2, 0.8), (0.6, 0.4)
#: Distance that objects are carried within a room, and from a door to a goal in the corridor [m].
ALONG_M, OUTSIDE_M = 1.2, 1.1
#: Rooms whose box goes out into the corridor.
GOES_OUT = (3, 7)
#: Time limits for all missions to end, and for all robots to be free afterwards [s].
DEADLINE_S, RELEASE_LIMIT_S = 900.0, 120.0
#: Time over which the CPU time of idle robots is measured [s].
IDLE_S = 10.0
#: Time limit for the start of a robot [s].
START_LIMIT_S = 120.0


class Room(NamedTuple):
    """x, y: its middle. side: of the corridor, 1 above and -1 below. thing, start, goal: of its object."""

    number: int
    x: float
    y: float
    side: int

    @property
    def thing(self) -> str:
        return f"{'box' if self.has_box else 'table'}-{self.number}"

    @property
    def has_box(self) -> bool:
        return self.number % 2 == 1

    @property
    def start(self) -> tuple[float, float]:
        return (self.x, self.y) if self.goes_out else (self.x - ALONG_M / 2, self.y)

    @property
    def goes_out(self) -> bool:
        return self.number in GOES_OUT

    @property
    def goal(self) -> tuple[float, float, float]:
        if self.goes_out:
            return self.x, self.y - self.side * (ROOM[1] / 2 + OUTSIDE_M), math.pi / 2
        return self.x + ALONG_M / 2, self.y, 0.0


class Outcome(NamedTuple):
    """The outcome of a mission. waited_s: until all robots had agreed. off_m: distance of the object from its goal.
    report: the leader's, empty if there is none."""

    leader: str
    thing: str
    result: str
    reason: str
    seconds: float
    waited_s: float
    attempts: int
    off_m: float
    report: dict[str, Any]

    @property
    def is_right(self) -> bool:
        return self.result == "done" and self.off_m < 0.05

    def row(self) -> dict[str, Any]:
        ticks = (self.report.get("tick_skew_ms") or {}).get("p99")
        skews = [phase["skew_ms"] for phase in self.report.get("phases", ()) if phase["skew_ms"] is not None]
        return {
            "leader": self.leader,
            "thing": self.thing,
            "robots": ", ".join(self.report.get("robots", ())),
            "result": self.result,
            "seconds": self.seconds,
            "agreed after, s": self.waited_s,
            "attempts": self.attempts,
            "off, mm": 1000 * self.off_m,
            "barrier skew, ms": max(skews, default=None),
            "tick skew p99, ms": ticks,
            "why": self.reason,
        }


# ---- the building ----


def rooms(count: int) -> list[Room]:
    """Rooms in two rows, those above the corridor first."""
    above = (count + 1) // 2
    places = [(number % above, 1 if number < above else -1) for number in range(count)]
    half = CORRIDOR_M / 2 + ROOM[1] / 2
    return [Room(number, (column + 0.5) * ROOM[0], side * half, side) for number, (column, side) in enumerate(places)]


def building(of: Sequence[Room]) -> Building:
    """The corridor lies along y = 0."""
    east = max(room.x for room in of) + ROOM[0] / 2
    north = CORRIDOR_M / 2 + ROOM[1]
    outline = ((0.0, -north), (east, -north), (east, north), (0.0, north))
    lines = [*zip(outline, (*outline[1:], outline[0]), strict=True)]
    for side in (1, -1):
        lines.append(((0.0, side * CORRIDOR_M / 2), (east, side * CORRIDOR_M / 2)))
    for room in of:
        if (x := room.x + ROOM[0] / 2) < east:
            lines.append(((x, room.side * CORRIDOR_M / 2), (x, room.side * north)))
    walls = {f"wall-{number}": Wall(f"wall-{number}", a, b) for number, (a, b) in enumerate(lines)}
    doors, things = {}, {}
    for room in of:
        y = room.side * CORRIDOR_M / 2
        name = f"door-{room.number}"
        doors[name] = Door(name, (room.x - DOOR_M / 2, y), (room.x + DOOR_M / 2, y))
        shape = BoxShape(BOX if room.has_box else TABLE)
        things[room.thing] = MapObject(room.thing, shape, room.start, height=0.7, movable=True)
    plan = GeometricalMap(walls, things, doors)
    found = Building("many rooms", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=outline), plan)})
    floor = found.floors[FLOOR]
    found.floors[FLOOR] = msgspec.structs.replace(floor, topological=topological_map(found, FLOOR))
    return found


def crew(of: Sequence[Room], count: int) -> dict[str, Start]:
    """Leaders and as many other robots in the rooms, the rest in two rows along the corridor; neighbours are in
    different sub-networks."""
    places = [(room.x - 2.3, room.y + 1.7 * room.side, 0.0) for room in of]
    places += [(room.x + 2.3, room.y + 1.7 * room.side, math.pi) for room in of]
    left = count - len(places)
    east = max(room.x for room in of) + ROOM[0] / 2
    pitch = east / max(1, (left + 1) // 2)
    for number in range(max(0, left)):  # not before doors
        places.append((min(pitch * (number // 2 + 1), east - 0.7), 0.85 * (-1) ** number, 0.0))
    names = [f"l{room.number}" for room in of] + [f"r{number}" for number in range(count - len(of))]
    return {
        name: Start(*place, SUBNETS[(number + number // len(SUBNETS)) % len(SUBNETS)])
        for number, (name, place) in enumerate(zip(names, places, strict=False))
    }


# ---- the missions ----


def begin(place: MissionSystem, of: Sequence[Room]) -> float:
    """Start all missions; return the time between the first and the last start [s]."""
    agents = [place.agent(f"l{room.number}") for room in of]
    for agent, room in zip(agents, of, strict=True):
        agent.load(dumps(ProgramBuilder("carry").move_table(room.thing, Destination(FLOOR, *room.goal)).program()))

    def run(agent: Any) -> float:
        agent.run()
        return time.monotonic()

    with ThreadPoolExecutor(len(agents)) as threads:
        began = sorted(threads.map(run, agents))
    return began[-1] - began[0]


def ended(
    place: MissionSystem, of: Sequence[Room], began: float, paces: list[float]
) -> Iterator[tuple[Room, ProgramReport]]:
    """Yield each mission as it ends, and the others at the deadline. paces: periodically gets the simulated seconds in
    a second."""
    running = list(of)
    while running:
        paces.append(float(place.server._get_state().achieved))
        for room in running[:]:
            try:
                report = place.agent(f"l{room.number}").state().program
            except RoboCorbaError as error:  # too busy to answer, or gone
                report = ProgramReport(reason=str(error))
            if report.result is not ProgramResult.NO_RESULT or time.monotonic() - began > DEADLINE_S:
                running.remove(room)
                yield room, report
        time.sleep(1.0)


def outcome(place: MissionSystem, room: Room, report: ProgramReport) -> Outcome:
    files = list((place.folder / f"l{room.number}" / MISSIONS).glob("*/report.json"))
    known = json.loads(files[0].read_text()) if files else {}
    attempts = {one["mission"] for one in known.get("events", ())}
    at = place.body(room.thing)
    return Outcome(
        f"l{room.number}",
        room.thing,
        report.result.name.lower(),
        report.reason,
        report.seconds,
        known["phases"][0]["began_s"] if known.get("phases") else math.nan,
        len(attempts),
        math.dist(at[:2], room.goal[:2]),
        known,
    )


def booked_twice(outcomes: Sequence[Outcome]) -> list[str]:
    """Robots that began a mission before their previous one had ended, by the accepted plans."""
    spans: dict[str, list[tuple[float, float, str]]] = {}
    for one in outcomes:
        if one.report.get("phases"):
            began = one.report["began"]
            until = began + one.report["seconds"]
            for robot in one.report["robots"]:
                spans.setdefault(robot, []).append((began + one.waited_s, until, one.leader))
    found = []
    for robot, parts in spans.items():
        parts.sort()
        for (_, until, leader), (since, _, other) in pairwise(parts):
            if since < until:
                found.append(f"{robot}: {leader} and {other}")
    return found


def states_mixed(outcomes: Sequence[Outcome]) -> list[str]:
    """Robots whose status messages to the leaders name one mission, another one, and the first one again."""
    heard: dict[str, list[tuple[float, str]]] = {}
    for one in outcomes:
        for event in one.report.get("events", ()):
            if event["type"] == "mission.state":
                heard.setdefault(event["source"], []).append((event["sent"], event["mission"]))
    mixed = []
    for robot, said in heard.items():
        said.sort()
        runs = [mission for number, (_, mission) in enumerate(said) if not number or said[number - 1][1] != mission]
        if len(runs) != len(set(runs)):
            mixed.append(f"{robot}: {runs}")
    return mixed


class Costs:
    """CPU time of robots and servers since the last call of `look`."""

    def __init__(self, place: MissionSystem) -> None:
        self._robots = [psutil.Process(process.pid) for process in place.robots.values()]
        self._servers = place.running.note_descendants()
        self._at, self._before = 0.0, [0.0, 0.0]
        self.look()

    def look(self) -> tuple[float, float, float]:
        """Mean CPU load of a robot and of all servers together [cores]; mean memory of a robot [MB]."""
        now = time.monotonic()
        spent = [sum(map(_cpu_s, group)) for group in (self._robots, self._servers)]
        passed = now - self._at
        robots, servers = ((after - before) / passed for after, before in zip(spent, self._before, strict=True))
        self._at, self._before = now, spent
        memory = [process.memory_info().rss for process in self._robots if process.is_running()]
        return robots / len(self._robots), servers, sum(memory) / max(1, len(memory)) / 1e6


def _cpu_s(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.NoSuchProcess:
        return 0.0
    return float(times.user + times.system)


@contextlib.contextmanager
def robots(place: MissionSystem, starts: Mapping[str, Start]) -> Iterator[None]:
    """A ready process for each robot."""
    command = (sys.executable, "-m", "bench.missions.nursery")
    with Process(command, place.folder / "nursery.log", environment={"OPENBLAS_NUM_THREADS": "1"}) as nursery:
        nursery.receive(START_LIMIT_S)
        for name, at in starts.items():
            (place.folder / name).mkdir()
            where = ("--floor", FLOOR, "--at", f"{at.x},{at.y},{at.heading}", "--channel", at.channel)
            own = ("--naming", str(place.running.naming), "--state", str(place.folder / name))
            pid = nursery.ask([str(_out(place, name)), name, *where, *own], START_LIMIT_S)
            place.robots[name] = cast(Any, psutil.Process(pid))
        try:
            for name in starts:
                with PROGRESS.status(f"waiting for {name}, one of {len(starts)} robots"):
                    eventually(partial(_is_ready, place, name), START_LIMIT_S, f"{name} is ready")
            yield
        finally:
            place.end()


def _is_ready(place: MissionSystem, name: str) -> bool:
    out = _out(place, name).read_text() if _out(place, name).exists() else ""
    assert place.robots[name].is_running(), out  # type: ignore[attr-defined]
    return "ready\n" in out


def _out(place: MissionSystem, name: str) -> Path:
    return place.folder / name / "out"


def aftermath(place: MissionSystem, names: Sequence[str], things: Sequence[str]) -> list[str]:
    """Errors in the state of robots and objects after all missions have ended."""
    wrong: list[str] = []

    def others() -> list[str]:
        return [name for name in names if not place.is_free(name)]

    try:
        eventually(lambda: not others(), RELEASE_LIMIT_S)
    except AssertionError:
        states = {name: place.agent(name).state() for name in others()}
        for name, state in states.items():
            place.robots[name].send_signal(signal.SIGUSR1)
            time.sleep(1.0)
            doing = f"{state.condition.name.lower()} {state.program.name} {state.program.kind} {state.reason}"
            wrong.append(f"{name} is {doing}\n{_out(place, name).read_text()[-4000:]}")
    if held := place.holding():
        wrong.append(f"held: {held}")
    if not place.is_stationary((*names, *things)):
        wrong.append("something moves")
    return wrong


def marks(outcomes: Sequence[Outcome], spread_s: float, wrong: Sequence[str]) -> list[Mark]:
    return [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions that ended, done or with a reason", sum(_has_ended(one) for one in outcomes), len(outcomes)),
        at_most("robots booked twice, by plans", len(booked_twice(outcomes)), 0),
        at_most("robots in two missions at the same time, by their status messages", len(states_mixed(outcomes)), 0),
        at_most("errors afterwards", len(wrong), 0),
    ]


def _has_ended(one: Outcome) -> bool:
    return one.is_right or (one.result == "failed" and bool(one.reason))


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", type=int, default=10, help="default: %(default)s")
    parser.add_argument("--robots", type=int, default=30, help="default: %(default)s")
    options = parser.parse_args()
    of = rooms(options.missions)
    starts = crew(of, options.robots)
    outcomes: list[Outcome] = []
    paces: list[float] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        native.save(building(of), folder / "many-rooms.yaml")
        with missions(folder, folder / "many-rooms.yaml", ",".join(SUBNETS)) as place, robots(place, starts):
            costs = Costs(place)
            time.sleep(IDLE_S)
            idle = costs.look()
            before = place.collisions
            began = time.monotonic()
            spread_s = begin(place, of)
            for room, report in ended(place, of, began, paces):
                outcomes.append(outcome(place, room, report))
                print(*outcomes[-1].row().values(), sep="\t", flush=True)
            busy = costs.look()
            wrong = aftermath(place, list(starts), [room.thing for room in of])
            collisions = place.collisions - before
    for line in (*booked_twice(outcomes), *states_mixed(outcomes), *wrong):
        print(line)
    done = sum(one.is_right for one in outcomes)
    print(f"{done} of {len(outcomes)} done; {collisions} collisions; load {os.getloadavg()[0]:.1f}")
    for what, (robot, servers, memory_mb) in (("waiting", idle), ("missions", busy)):
        print(f"{what}: {100 * robot:.1f} % of a core a robot, {100 * servers:.0f} % all servers, {memory_mb:.0f} MB")
    print(f"simulated seconds in a second: {statistics.median(paces):.2f} at the median, {min(paces):.2f} at least")
    title = f"{len(outcomes)} simultaneous missions, {len(starts)} robots: {done} done, {collisions} collisions"
    is_reached = summarize(
        RESULTS / NAME,
        title,
        [one.row() for one in outcomes],
        marks(outcomes, spread_s, wrong),
        partial(_draw, outcomes),
    )
    return 0 if is_reached else 1


def _draw(outcomes: Sequence[Outcome], axes: Axes) -> None:
    """Draw the time from the first call to the agreement, and from there to the end."""
    names = [one.leader for one in outcomes]
    waited = [one.seconds if math.isnan(one.waited_s) else one.waited_s for one in outcomes]
    axes.barh(names, waited, label="looking for helpers")
    axes.barh(
        names, [one.seconds - until for one, until in zip(outcomes, waited, strict=True)], left=waited, label="mission"
    )
    axes.set(xlabel="s")
    axes.legend()


if __name__ == "__main__":
    sys.exit(main())
