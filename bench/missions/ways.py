"""Carries with a robot or a chair in the way.

    python -m bench.missions.ways --missions 30 [--only CASE]

Three robots of two sub-networks carry a table to and fro in a hall. Before each mission, or while they carry, something
is put in their way: a free robot, which steps aside when asked; a robot that runs a program; a stranger, which never
answers; a chair. Each mission must be done with the table at its goal, or be refused with the name of what can't
move, and nothing may touch anything."""

from __future__ import annotations

import contextlib
import math
import random
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from omniORB import CORBA

from bench.common.harness import progress, run
from robocorba.events.corba.event_client import EventClient
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, MapObject
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.buildings import rectangular
from testkit.missions import FLOOR, MissionSystem, RobotStart
from testkit.missions import missions as mission_system
from testkit.processes import eventually
from testkit.report import at_most, quantile, summarize

TABLE, CHAIR = "table", "chair"
#: Size of the hall [m], and the ends of the table's way.
HALL_M = (15.0, 9.0)
GOALS = ((3.5, 4.5), (11.5, 4.5))
CARRIERS = {
    "a": RobotStart(1.0, 1.0, 0.0, "lab"),
    "b": RobotStart(1.0, 8.0, 0.0, "lab"),
    "c": RobotStart(5.0, 1.0, math.pi, "hall"),
}
#: The robot that is put in the way. It is farther from the table than the others, so that it does not carry.
OTHER, OTHER_AT = "z", RobotStart(14.2, 8.2, math.pi, "hall")
STRANGER = "stranger"
#: Where the chair and the other robot are between missions.
CHAIR_AT = (14.2, 0.8)
#: Who, and when it is put in the way.
CASES = (
    *(f"{who} before" for who in ("free robot", "busy robot", "stranger", "chair")),
    *(f"{who} meanwhile" for who in ("free robot", "busy robot", "stranger", "chair", "chair for 5 s")),
    "free robot drives into it meanwhile",
)
LIMIT_S = 300.0
NEAR_M = 0.01
#: Reach of table and carriers from the table's middle [m], and gap to what comes in their way meanwhile [m].
REACH_M, GAPS_M = 1.6, (0.4, 1.2)


class Outcome(NamedTuple):
    """The outcome of a mission. took_s: in all. wrong: errors found."""

    case: str
    result: str
    reason: str
    took_s: float
    phases: tuple[str, ...]
    wrong: tuple[str, ...]


def hall() -> Building:
    return rectangular(
        "hall",
        HALL_M,
        [FLOOR],
        (FLOOR, MapObject(TABLE, BoxShape((1.2, 0.8)), GOALS[0], height=0.7, movable=True)),
        (FLOOR, MapObject(CHAIR, BoxShape((0.5, 0.5)), CHAIR_AT, height=0.9, movable=True)),
    )


class Trials:
    """Successive missions in one system."""

    def __init__(self, place: MissionSystem, seed: int) -> None:
        self.place, self._random = place, random.Random(seed)
        self._administrator = place.orb.reference(
            (place.running.state / "administrator.ior").read_text(), RoboCorba.SimulationAdministrator
        )
        place.start({**CARRIERS, OTHER: OTHER_AT})
        self._stranger: Any = None

    def mission(self, case: str) -> Outcome:
        """Run a mission with something in its way."""
        table = self.place.body(TABLE)
        goal = max(GOALS, key=lambda each: math.dist(each, table[:2]))
        touched: list[str] = []
        began = time.monotonic()
        with contextlib.ExitStack() as stack:
            events = stack.enter_context(EventClient(self.place.orb, "lab"))
            events.subscribe(lambda event: touched.append(" and ".join(event.payload["who"])), "simulation.collision")
            if "before" in case:
                middle = 0.4 * table.x + 0.6 * goal[0], goal[1] + self._random.uniform(-0.8, 0.8)
                stack.enter_context(self._blocked(case, middle))
            user = self.place.mission("a", TABLE, f"{FLOOR}:{goal[0]},{goal[1]}")
            if "meanwhile" in case:
                self.place.carrying("a", TABLE, user, self._random.uniform(0.3, 3.0))
                self._intrude(stack, case, goal, user)
            result, rest = self.place.result(user, LIMIT_S)
        wrong = [f"touched: {', '.join(dict.fromkeys(touched))}"] if touched else []
        off_m = math.dist(self.place.body(TABLE)[:2], goal)
        names = (CHAIR,) if "chair" in case else (OTHER, STRANGER)
        if result == "done" and off_m > NEAR_M:
            wrong.append(f"the table is {1000 * off_m:.0f} mm from its goal")
        elif result != "done" and not any(name in rest for name in names):
            wrong.append(f"ended without naming what is in the way: {rest}")
        took_s = time.monotonic() - began
        phases = tuple(phase["name"] for phase in self.place.report("a")["phases"])
        self._restore()
        return Outcome(case, result if result == "done" else "refused", rest, took_s, phases, tuple(wrong))

    # ---- what is in the way ----

    @contextlib.contextmanager
    def _blocked(self, case: str, at: tuple[float, float]) -> Iterator[None]:
        """Somebody or something stands at a point."""
        with contextlib.ExitStack() as stack:
            if "chair" in case:
                self._put(CHAIR, at)
            elif "stranger" in case:
                stack.enter_context(self._strange_robot(at))
            else:
                self._put(OTHER, at)
                if "busy" in case:
                    self._occupy()
                    stack.callback(self.place.agent(OTHER).abort)
            yield

    def _intrude(
        self, stack: contextlib.ExitStack, case: str, goal: tuple[float, float], user: subprocess.Popen[str]
    ) -> None:
        """Put something before the table, which moves on."""
        table = self.place.body(TABLE)
        towards = math.atan2(goal[1] - table.y, goal[0] - table.x)
        ahead_m = REACH_M + self._random.uniform(*GAPS_M)
        aside_m = self._random.uniform(-1.0, 1.0)
        at = (
            table.x + ahead_m * math.cos(towards) - aside_m * math.sin(towards),
            table.y + ahead_m * math.sin(towards) + aside_m * math.cos(towards),
        )
        if "drives" in case:
            side = 1.5 if at[1] < HALL_M[1] / 2 else -1.5
            self._put(OTHER, (at[0] + 0.5 * math.cos(towards), at[1] + side))
            builder = ProgramBuilder("across")
            builder.mbase_to(*at, speed=0.3)
            agent = self.place.agent(OTHER)
            agent.load(dumps(builder.program()))
            agent.run()
            return
        stack.enter_context(self._blocked(case, at))
        if "for 5 s" in case:
            time.sleep(5.0)
            self._put(CHAIR, CHAIR_AT)

    def _put(self, body: str, at: tuple[float, float]) -> None:
        """Place a body at a point, or as near to it as there is room."""
        for number in range(40):
            turn, away_m = 2.4 * number, 0.05 * number
            pose = RoboCorba.Pose(FLOOR, at[0] + away_m * math.cos(turn), at[1] + away_m * math.sin(turn), 0.0)
            with contextlib.suppress(RoboCorba.PlaceTaken):
                self._administrator.place(body, pose)
                return
        raise AssertionError(f"no room for {body} at {at}")

    def _occupy(self) -> None:
        """The other robot runs a program that takes long."""
        builder = ProgramBuilder("standing")
        builder.wait(LIMIT_S)
        agent = self.place.agent(OTHER)
        agent.load(dumps(builder.program()))
        agent.run()

    @contextlib.contextmanager
    def _strange_robot(self, at: tuple[float, float]) -> Iterator[None]:
        """A robot that answers no requests."""
        limits = RoboCorba.MotionLimits(1.0, 2.0, 2.0, 4.0)
        about = RoboCorba.RobotDescription(STRANGER, RoboCorba.Pose(FLOOR, *at, 0.0), 0.3, 500.0, limits)
        session = self.place.server.registerRobot(about)

        def keep() -> None:
            with contextlib.suppress(CORBA.Exception):
                session.heartbeat()

        lease = Repeating("lease of the stranger", keep, 0.3).start()
        try:
            yield
        finally:
            lease.close()
            session.deregister()

    def _restore(self) -> None:
        eventually(lambda: all(map(self.place.is_free, (*CARRIERS, OTHER))), 60.0, "all are free")
        self._put(CHAIR, CHAIR_AT)
        self._put(OTHER, (OTHER_AT.x, OTHER_AT.y))


def row(case: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    took = [one.took_s for one in outcomes]
    return {
        "in the way": case,
        "missions": len(outcomes),
        "done": sum(one.result == "done" for one in outcomes),
        "refused": sum(one.result != "done" and not one.wrong for one in outcomes),
        "asked to step aside": sum(any("clearing" in phase for phase in one.phases) for one in outcomes),
        "waited": sum(any("waiting: " in phase for phase in one.phases) for one in outcomes),
        "tried again": sum("recovering" in one.phases for one in outcomes),
        "wrong": sum(bool(one.wrong) for one in outcomes),
        "s": quantile(took, 0.5),
        "most": max(took),
    }


def main(missions: int = 30, seed: int = 1, only: str = "") -> bool:
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as name:
        native.save(hall(), Path(name) / "hall.yaml")
        with mission_system(Path(name), Path(name) / "hall.yaml") as place:
            trials, order = Trials(place, seed), random.Random(seed)
            cases: list[str] = []
            while len(cases) < missions:
                cases += [only] if only else order.sample(CASES, len(CASES))
            for case in progress(cases[:missions], "missions"):
                one = trials.mission(case)
                outcomes.append(one)
                print(*one[:3], f"{one.took_s:.1f} s", ", ".join(one.phases), one.wrong, sep="\t", flush=True)
    by_case = {case: [one for one in outcomes if one.case == case] for case in sorted({o.case for o in outcomes})}
    unnamed = sum(bool(one.wrong) for one in outcomes)
    touches = sum(any("touched" in each for each in one.wrong) for one in outcomes)
    marks = [
        at_most("missions neither done nor refused with what can't move", unnamed, 0),
        at_most("missions in which something touched something", touches, 0),
    ]

    def draw(axes: Axes) -> None:
        axes.plot([one.took_s for one in outcomes], [one.case for one in outcomes], "o")
        axes.set(xlabel="s from the command to the end")

    title = f"{missions} carries with something in the way"
    return summarize("mission_ways", title, [row(*each) for each in by_case.items()], marks, draw)


if __name__ == "__main__":
    run(main, seed="of cases and places", only="this case only")
