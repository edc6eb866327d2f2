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

import contextlib
import itertools
import json
import math
import os
import signal
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import msgspec
import psutil
from matplotlib.axes import Axes

from bench.common.harness import progress, run
from robocorba.control.runner import ProgramReport, ProgramResult
from robocorba.errors.base import RoboCorbaError
from robocorba.maps import native
from robocorba.maps.model import BoxShape, Building, Door, Floor, FloorMap, GeometricalMap, MapObject, Wall
from robocorba.maps.topology import topological_map
from robocorba.names import MISSIONS
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.icons import Destination
from robocorba.programs.program import dumps
from robocorba.testing.json_process import Cpu, Process, checkout_command
from robocorba.testing.missions import FLOOR, MissionSystem, RobotStart
from robocorba.testing.missions import missions as mission_system
from robocorba.testing.processes import eventually
from robocorba.testing.report import at_least, at_most, summarize

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


class Outcome(NamedTuple):
    """The outcome of a mission: its row of the table, and the leader's report, empty if there is none."""

    row: dict[str, Any]
    report: dict[str, Any]

    @property
    def is_right(self) -> bool:
        return self.row["result"] == "done" and bool(self.row["off, mm"] < 50.0)

    @property
    def has_ended(self) -> bool:
        return self.is_right or (self.row["result"] == "failed" and bool(self.row["why"]))


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
    lines += [((0.0, side * CORRIDOR_M / 2), (east, side * CORRIDOR_M / 2)) for side in (1, -1)]
    for room in of:
        if (x := room.x + ROOM[0] / 2) < east:
            lines.append(((x, room.side * CORRIDOR_M / 2), (x, room.side * north)))
    walls = [Wall(f"wall-{number}", a, b) for number, (a, b) in enumerate(lines)]
    doors, items = [], []
    for room in of:
        y = room.side * CORRIDOR_M / 2
        doors.append(Door(f"door-{room.number}", (room.x - DOOR_M / 2, y), (room.x + DOOR_M / 2, y)))
        shape = BoxShape(BOX if room.has_box else TABLE)
        items.append(MapObject(room.item, shape, room.start, height=0.7, movable=True))
    plan = GeometricalMap(
        {wall.name: wall for wall in walls}, {item.name: item for item in items}, {door.name: door for door in doors}
    )
    found = Building("many rooms", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=outline), plan)})
    floor = found.floors[FLOOR]
    found.floors[FLOOR] = msgspec.structs.replace(floor, topological=topological_map(found, FLOOR))
    return found


def crew(of: Sequence[Room], count: int) -> dict[str, RobotStart]:
    """Leaders and as many other robots in the rooms, the rest in two rows along the corridor; neighbours are in
    different sub-networks."""
    places = [(room.x - 2.3, room.y + 1.7 * room.side, 0.0) for room in of]
    places += [(room.x + 2.3, room.y + 1.7 * room.side, math.pi) for room in of]
    left = count - len(places)
    east = max(room.x for room in of) + ROOM[0] / 2
    pitch = east / max(1, (left + 1) // 2)
    for number in range(max(0, left)):  # not before doors
        places.append((min(pitch * (number // 2 + 1), east - 0.7), 0.85 * (-1) ** number, 0.0))
    names = [room.leader for room in of] + [f"r{number}" for number in range(count - len(of))]
    return {
        name: RobotStart(*place, SUBNETS[(number + number // len(SUBNETS)) % len(SUBNETS)])
        for number, (name, place) in enumerate(zip(names, places, strict=False))
    }


# ---- the missions ----


def begin(place: MissionSystem, of: Sequence[Room]) -> float:
    """Start all missions; return the time between the first and the last start [s]."""
    agents = [place.agent(room.leader) for room in of]
    for agent, room in zip(agents, of, strict=True):
        agent.load(dumps(ProgramBuilder("carry").move_table(room.item, Destination(FLOOR, *room.goal)).program()))

    def start(agent: Any) -> float:
        agent.run()
        return time.monotonic()

    with ThreadPoolExecutor(len(agents)) as threads:
        began = sorted(threads.map(start, agents))
    return began[-1] - began[0]


def ended(place: MissionSystem, of: Sequence[Room], began: float, paces: list[float]) -> Iterator[Outcome]:
    """Yield each mission as it ends, and the others at the deadline. paces: periodically gets the simulated seconds in
    a second."""
    running = list(of)
    while running:
        paces.append(float(place.server._get_state().achieved))
        for room in running[:]:
            try:
                report = place.agent(room.leader).state().program
            except RoboCorbaError as error:  # too busy to answer, or gone
                report = ProgramReport(reason=str(error))
            if report.result is not ProgramResult.NO_RESULT or time.monotonic() - began > DEADLINE_S:
                running.remove(room)
                yield outcome(place, room, report)
        time.sleep(1.0)


def outcome(place: MissionSystem, room: Room, report: ProgramReport) -> Outcome:
    files = list((place.folder / room.leader / MISSIONS).glob("*/report.json"))
    known = json.loads(files[0].read_text()) if files else {}
    phases = known.get("phases", ())
    row = {
        "leader": room.leader,
        "thing": room.item,
        "robots": ", ".join(known.get("robots", ())),
        "result": report.result.name.lower(),
        "seconds": report.seconds,
        "agreed after, s": phases[0]["began_s"] if phases else math.nan,
        "attempts": len({one["mission"] for one in known.get("events", ())}),
        "off, mm": 1000 * math.dist(place.body(room.item)[:2], room.goal[:2]),
        "barrier skew, ms": max((phase["skew_ms"] for phase in phases if phase["skew_ms"] is not None), default=None),
        "tick skew p99, ms": (known.get("tick_skew_ms") or {}).get("p99"),
        "why": report.reason,
    }
    print(*row.values(), sep="\t", flush=True)
    return Outcome(row, known)


def booked_twice(outcomes: Sequence[Outcome]) -> list[str]:
    """Robots that began a mission before their previous one had ended, by the accepted plans."""
    spans: dict[str, list[tuple[float, float, str]]] = defaultdict(list)
    for row, report in outcomes:
        if report.get("phases"):
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


class Costs:
    """CPU time of robots and servers since the last call of `print`."""

    def __init__(self, place: MissionSystem) -> None:
        self._robots = Cpu([process.pid for process in place.robots.values()])
        self._servers = Cpu([process.pid for process in place.running.note_descendants()])
        self._at = time.monotonic()

    def print(self, what: str) -> None:
        """Print the mean CPU load and memory of a robot, and the CPU load of all servers together."""
        before, self._at = self._at, time.monotonic()
        robots, servers = (100 * sum(cpu.spent_s()) / (self._at - before) for cpu in (self._robots, self._servers))
        memory = [process.memory_info().rss / 1e6 for process in self._robots.processes if process.is_running()]
        mean, memory_mb = robots / len(self._robots.processes), sum(memory) / max(1, len(memory))
        print(f"{what}: {mean:.1f} % of a core a robot, {servers:.0f} % all servers, {memory_mb:.0f} MB")


@contextlib.contextmanager
def started(place: MissionSystem, starts: Mapping[str, RobotStart]) -> Iterator[None]:
    """A ready process for each robot."""
    command = checkout_command("bench.missions.nursery")
    with Process(command, place.folder / "nursery.log", environment={"OPENBLAS_NUM_THREADS": "1"}) as nursery:
        nursery.receive(START_LIMIT_S)
        for name, at in starts.items():
            (place.folder / name).mkdir()
            where = ("--floor", FLOOR, "--at", f"{at.x},{at.y},{at.heading}", "--channel", at.channel)
            own = ("--naming", str(place.running.naming), "--state", str(place.folder / name))
            pid = nursery.ask([str(_out(place, name)), name, *where, *own], START_LIMIT_S)
            place.robots[name] = cast(Any, psutil.Process(pid))
        try:
            for name in progress(list(starts), "waiting for robots"):
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


def aftermath(place: MissionSystem, names: Sequence[str], items: Sequence[str]) -> list[str]:
    """Errors in the state of robots and objects after all missions have ended."""
    wrong: list[str] = []
    try:
        eventually(lambda: all(map(place.is_free, names)), RELEASE_LIMIT_S)
    except AssertionError:
        for name in [name for name in names if not place.is_free(name)]:
            state = place.agent(name).state()
            place.robots[name].send_signal(signal.SIGUSR1)  # prints its stacks
            time.sleep(1.0)
            doing = f"{state.condition.name.lower()} {state.program.name} {state.program.kind} {state.reason}"
            wrong.append(f"{name} is {doing}\n{_out(place, name).read_text()[-4000:]}")
    if held := place.holding():
        wrong.append(f"held: {held}")
    if not place.is_stationary((*names, *items)):
        wrong.append("something moves")
    return wrong


def main(missions: int = 10, robots: int = 30) -> bool:
    of = rooms(missions)
    starts, paces = crew(of, robots), list[float]()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        native.save(building(of), folder / "many-rooms.yaml")
        with mission_system(folder, folder / "many-rooms.yaml", ",".join(SUBNETS)) as place, started(place, starts):
            costs = Costs(place)
            time.sleep(IDLE_S)
            costs.print("waiting")
            before = place.collisions
            began = time.monotonic()
            spread_s = begin(place, of)
            outcomes = list(ended(place, of, began, paces))
            costs.print("missions")
            wrong = aftermath(place, list(starts), [room.item for room in of])
            collisions = place.collisions - before
    twice, mixed, done = booked_twice(outcomes), states_mixed(outcomes), sum(one.is_right for one in outcomes)
    print(*twice, *mixed, *wrong, sep="\n")
    print(f"{done} of {len(outcomes)} done; {collisions} collisions; load {os.getloadavg()[0]:.1f}")
    print(f"simulated seconds in a second: {statistics.median(paces):.2f} at the median, {min(paces):.2f} at least")
    marks = [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions that ended, done or with a reason", sum(one.has_ended for one in outcomes), len(outcomes)),
        at_most("robots booked twice, by plans", len(twice), 0),
        at_most("robots in two missions at the same time, by their status messages", len(mixed), 0),
        at_most("errors afterwards", len(wrong), 0),
    ]
    title = f"{len(outcomes)} simultaneous missions, {len(starts)} robots: {done} done, {collisions} collisions"
    return summarize("many_missions", title, [one.row for one in outcomes], marks, partial(_draw, outcomes))


def _draw(outcomes: Sequence[Outcome], axes: Axes) -> None:
    """Draw the time from the first call to the agreement, and from there to the end."""
    names, seconds = [one.row["leader"] for one in outcomes], [one.row["seconds"] for one in outcomes]
    waited = [min(s, one.row["agreed after, s"]) for s, one in zip(seconds, outcomes, strict=True)]
    axes.barh(names, seconds, label="mission")
    axes.barh(names, waited, label="looking for helpers")
    axes.set(xlabel="s")
    axes.legend()


if __name__ == "__main__":
    run(main)
