"""How an actual robot's protective field stops it before a chair that no map has.

    python -m bench.robots.protection [--tries 100] [--speed 0.8]

The stand-in of an actual robot stands in a hall; a chair is in its own world only. In each try the robot drives at the
chair from another side, in another direction of its own frame, until it stands. Distances are between the robot's rim
and the chair, by the robot's odometry."""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from shapely import Point, Polygon, affinity, box

from bench.common.harness import folder_of_bench, progress, run
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, Floor, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from testkit.actual_robot import running_stand_in
from testkit.buildings import with_all
from testkit.processes import running_system
from testkit.report import Mark, at_least, at_most, distribution, quantile, summarize
from testkit.virtual_and_actual import robot_process

ROBOT, FLOOR, LIMIT_S, MAX_TRIALS = "A", "L1", 120.0, 20
#: Side of the hall and of the chair, and distance from which the robot drives at the chair's middle [m].
HALL_M, CHAIR_M, FROM_M = 12.0, 0.45, 2.4
#: The base stands at most before the chair at this distance, and at least [m].
MARGIN_M, FAR_M = 0.05, 0.30
#: Below this speed the base stands [m/s]; its encoders have noise.
STANDS_M_S = 0.02
CHAIR: Polygon = affinity.rotate(
    box(*(HALL_M / 2 - CHAIR_M / 2,) * 2, *(HALL_M / 2 + CHAIR_M / 2,) * 2), math.pi / 5, use_radians=True
)


class Approach(NamedTuple):
    """fastest_m_s: before it braked, when it was at `brakes_at_m` from the chair. It stands `stands_s` later, at
    `stands_at_m`."""

    fastest_m_s: float
    brakes_at_m: float
    stands_s: float
    stands_at_m: float


def hall(has_chair: bool) -> Building:
    outline = ((0.0, 0.0), (HALL_M, 0.0), (HALL_M, HALL_M), (0.0, HALL_M))
    parts = [("", Floor(name=FLOOR, level=1, elevation=0.0, outline=outline))]
    chair = MapObject("chair", BoxShape((CHAIR_M, CHAIR_M)), (HALL_M / 2, HALL_M / 2), math.pi / 5)
    return with_all(Building("hall"), [*parts, *([(FLOOR, chair)] if has_chair else [])])


class Stage:
    """The robot, whose agent is `agent`. contacts: that its bumper has counted."""

    def __init__(self, agent: RemoteAgent, contacts: Callable[[], float]) -> None:
        self.agent, self.contacts = agent, contacts
        self._side, self._bearing = math.pi, 0.0

    def approach(self, speed: float, choice: random.Random) -> tuple[Approach, ProgramReport]:
        """Go to another side, and drive at the chair until the base has stood for 3 s: what happens then. A try in
        which the robot stops for another reason, as a busy machine's stand-in does, does not count."""
        while True:
            self._go_to_another_side(choice)
            bearing = self._bearing + math.atan2(choice.uniform(-0.15, 0.15), FROM_M)
            self._run(
                ProgramBuilder("at it").mbase_velocity(speed * math.cos(bearing), speed * math.sin(bearing), 0.0, 60.0)
            )
            track = list(self._track())
            report = track[-1].program
            if "sees something" in report.reason:
                return approach_of(track), report
            assert min(map(gap_m, track)) >= MARGIN_M, report

    def _go_to_another_side(self, choice: random.Random) -> None:
        """Where the chair is not straight ahead of it."""
        for _ in range(MAX_TRIALS):
            if self.agent.state().condition is AgentCondition.STOPPED:
                self.agent.reset_stop()
            self._side += choice.uniform(-1.0, 1.0)
            x, y = (HALL_M / 2 + FROM_M * part for part in (math.cos(self._side), math.sin(self._side)))
            self._bearing = choice.uniform(-1.0, 1.0)
            heading = math.remainder(self._side + math.pi - self._bearing, math.tau)
            self._run(ProgramBuilder("away").mbase_to(x, y, heading, 0.5))
            if list(self._track())[-1].program.result is ProgramResult.DONE:
                return
        raise AssertionError(f"it gets nowhere: {self.agent.state()}")

    def _run(self, builder: ProgramBuilder) -> None:
        self.agent.load(dumps(builder.program()))
        self.agent.run()

    def _track(self) -> Iterator[AgentState]:
        """States until the program has ended."""
        until = time.monotonic() + LIMIT_S
        while time.monotonic() < until:
            state = self.agent.state()
            yield state
            if state.program.result is not ProgramResult.NO_RESULT:
                return
            time.sleep(0.01)
        raise AssertionError("the program does not end")


def gap_m(state: AgentState) -> float:
    return float(CHAIR.distance(Point(state.at.x, state.at.y))) - RADIUS_M


def approach_of(track: list[AgentState]) -> Approach:
    speeds = [math.hypot(*state.actor.velocity[:2]) for state in track]
    fastest = max(speeds)
    last_fast = max(number for number, speed in enumerate(speeds) if speed > 0.95 * fastest)
    stands = next(number for number, speed in enumerate(speeds) if number > last_fast and speed < STANDS_M_S)
    took_s = track[stands].actor.time - track[last_fast].actor.time
    return Approach(fastest, gap_m(track[last_fast]), took_s, min(map(gap_m, track)))


@contextlib.contextmanager
def stage(folder: Path, speed: float) -> Iterator[Stage]:
    """All processes, until the end of the `with`."""
    at = HALL_M / 2 - FROM_M, HALL_M / 2, 0.0
    native.save(hall(has_chair=False), folder / "hall.yaml")
    native.save(hall(has_chair=True), folder / "world.yaml")
    where = ("--floor", FLOOR, "--at", ",".join(map(str, at)), "--adaptor", "smartpal")
    world = ("--world", str(folder / "world.yaml"), "--world-at", *map(str, at))
    with (
        running_system(folder, "--building", str(folder / "hall.yaml")) as (running, _),
        Orb(running.naming) as orb,
        running_stand_in(folder / "actual", *world, orb=orb) as actual,
        robot_process(folder, orb, ROBOT, *where, "--", "--naming", str(actual.naming)) as robot,
    ):
        servant = orb.resolve(f"Robots/{ROBOT}", RoboCorba.RobotAgent)
        servant.setSpeedCap(speed)

        def contacts() -> float:
            return float(sum(each.value for each in servant._get_sensors().readings() if each.name == "bumper"))

        yield Stage(robot.agent, contacts)


def row(number: int, found: Approach) -> dict[str, Any]:
    return {
        "try": number,
        "speed, m/s": found.fastest_m_s,
        "brakes at, cm": 1e2 * found.brakes_at_m,
        "stands after, s": found.stands_s,
        "stands at, cm": 1e2 * found.stands_at_m,
    }


def marks(found: list[Approach], contacts: float) -> list[Mark]:
    at = [each.stands_at_m for each in found]
    return [
        at_least("nearest to the chair, cm", 1e2 * min(at), 1e2 * MARGIN_M),
        at_most("farthest stand from the chair, cm", 1e2 * max(at), 1e2 * FAR_M),
        at_most("contacts", contacts, 0.0),
    ]


def main(tries: int = 100, speed: float = 0.8) -> bool:
    choice, found = random.Random(1), []
    with folder_of_bench() as folder, stage(folder, speed) as place:
        for _ in progress(range(tries), "tries"):
            found.append(place.approach(speed, choice)[0])
        contacts = place.contacts()
    rows = [row(number, each) for number, each in enumerate(found, 1)]
    title = f"a chair that no map has, at {quantile([each.fastest_m_s for each in found], 0.5):.2f} m/s"
    draw = distribution({"stands at, cm": [each["stands at, cm"] for each in rows]}, "distance from the chair, cm")
    return summarize("protection", title, rows, marks(found, contacts), draw)


if __name__ == "__main__":
    run(main)
