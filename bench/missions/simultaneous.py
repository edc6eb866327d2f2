"""Missions that robots of one system do at the same time: start, outcome, state afterwards, and cost."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from robocorba.errors.base import RoboCorbaError
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination
from robocorba.robot.programs.program import dumps
from robocorba.simulation.registry import Pose
from robocorba.system.names import MISSIONS
from testkit.json_process import Cpu
from testkit.missions import MissionSystem, RobotStart
from testkit.processes import eventually

#: Time limits for all missions to end if nothing else is said, and for all robots to be free afterwards [s].
DEADLINE_S, RELEASE_LIMIT_S = 900.0, 120.0
#: Time limit for the start of a robot [s].
START_LIMIT_S = 120.0
#: Largest distance of an object from its goal [mm].
NEAR_MM = 50.0


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


def ended(
    place: MissionSystem, errands: Sequence[Errand], paces: list[float], deadline_s: float = DEADLINE_S
) -> Iterator[Outcome]:
    """Yield each mission as it ends, and the others after the deadline. paces: periodically gets the simulated seconds
    in a second."""
    began = time.monotonic()
    running = list(errands)
    while running:
        paces.append(float(place.server._get_state().achieved))
        for errand in running[:]:
            try:
                report = place.agent(errand.leader).state().program
            except RoboCorbaError as error:  # too busy to answer, or gone
                report = ProgramReport(reason=str(error))
            if report.result is not ProgramResult.NO_RESULT or time.monotonic() - began > deadline_s:
                running.remove(errand)
                yield outcome(place, errand, report)
        time.sleep(1.0)


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
        "barrier skew, ms": max((phase["skew_ms"] for phase in phases if phase["skew_ms"] is not None), default=None),
        "tick skew p99, ms": (known.get("tick_skew_ms") or {}).get("p99"),
        "why": report.reason,
        "faults": "; ".join(known.get("faults", ())),
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
    try:
        place.start(starts)
        yield
    finally:
        place.end()


def aftermath(place: MissionSystem, names: Sequence[str], items: Sequence[str]) -> list[str]:
    """Errors in the state of robots and objects after all missions have ended."""
    wrong: list[str] = []
    try:
        eventually(lambda: all(map(place.is_free, names)), RELEASE_LIMIT_S)
    except AssertionError:
        for name in [name for name in names if not place.is_free(name)]:
            state = place.agent(name).state()
            doing = f"{state.condition.name.lower()} {state.program.name} {state.program.kind} {state.reason}"
            wrong.append(f"{name} is {doing}")
    if held := place.holding():
        wrong.append(f"held: {held}")
    if not place.is_stationary((*names, *items)):
        wrong.append("something moves")
    return wrong
