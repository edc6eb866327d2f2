"""How an actual robot's protective field stops it before a chair that no map has.

    python -m bench.robots.protection [--tries 100] [--speed 0.8]

The stand-in of an actual robot stands in a hall; a chair is in its own world only. In each try the robot drives at the
chair from another side, in another direction of its own frame, until it stands. Distances are between the robot's rim
and the chair, by the robot's odometry."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterator
from pathlib import Path

from shapely import Point, Polygon, affinity, box

from bench.common.harness import folder_of_bench, progress, run, sampled
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from testkit.actual_robot import running_stand_in
from testkit.buildings import rectangular
from testkit.processes import eventually, running_system
from testkit.report import at_least, at_most, summarize
from testkit.virtual_and_actual import robot_process

ROBOT, FLOOR, LIMIT_S, MAX_TRIALS = "A", "L1", 120.0, 20
#: Side of the hall and of the chair, and distance from which the robot drives at the chair's middle [m].
HALL_M, CHAIR_M, FROM_M = 12.0, 0.45, 2.4
#: The base stands at most before the chair at this distance, and at least [m].
MARGIN_M, FAR_M = 0.05, 0.30
CHAIR: Polygon = affinity.rotate(
    box(*(HALL_M / 2 - CHAIR_M / 2,) * 2, *(HALL_M / 2 + CHAIR_M / 2,) * 2), math.pi / 5, use_radians=True
)


def contacts_of(orb: Orb, name: str) -> float:
    """That a robot's bumper has counted since it logged on."""
    agent = orb.resolve(f"Robots/{name}", RoboCorba.RobotAgent)
    return float(sum(each.value for each in agent._get_sensors().readings() if each.name == "bumper"))


def hall(*things: MapObject) -> Building:
    return rectangular("hall", (HALL_M, HALL_M), [FLOOR], *((FLOOR, thing) for thing in things))


class Stage:
    """The robot, whose agent is `agent`."""

    def __init__(self, orb: Orb, agent: RemoteAgent) -> None:
        self.orb, self.agent = orb, agent
        self._side, self._bearing = math.pi, 0.0
        #: Why it stood in other tries.
        self.others: list[str] = []

    def contacts(self) -> float:
        return contacts_of(self.orb, ROBOT)

    def approach(self, speed: float, choice: random.Random) -> tuple[float, ProgramReport]:
        """Go to another side, and drive at the chair until the program ends: the smallest distance from it [m], and why
        the robot stands. A try in which it stops for another reason, as a busy machine's stand-in does, is noted and
        repeated."""
        while True:
            self._go_to_another_side(choice)
            bearing = self._bearing + math.atan2(choice.uniform(-0.15, 0.15), FROM_M)
            velocity = speed * math.cos(bearing), speed * math.sin(bearing), 0.0
            track = self._run(ProgramBuilder("at it").mbase_velocity(*velocity, 60.0))
            nearest_m, report = min(map(gap_m, track)), track[-1].program
            if "sees something" in report.reason:
                return nearest_m, report
            assert nearest_m >= MARGIN_M, report
            self.others.append(report.reason)

    def _go_to_another_side(self, choice: random.Random) -> None:
        """Where the chair is not straight ahead of it."""
        for _ in range(MAX_TRIALS):
            if self.agent.state().condition is AgentCondition.STOPPED:
                self.agent.reset_stop()
            self._side += choice.uniform(-1.0, 1.0)
            x, y = (HALL_M / 2 + FROM_M * part for part in (math.cos(self._side), math.sin(self._side)))
            self._bearing = choice.uniform(-1.0, 1.0)
            heading = math.remainder(self._side + math.pi - self._bearing, math.tau)
            if self._run(ProgramBuilder("away").mbase_to(x, y, heading, 0.5))[-1].program.result is ProgramResult.DONE:
                return
        raise AssertionError(f"it gets nowhere: {self.agent.state()}")

    def _run(self, builder: ProgramBuilder) -> list[AgentState]:
        """The states until the program has ended."""
        self.agent.load(dumps(builder.program()))
        self.agent.run()
        with sampled(self.agent.state, 0.01) as states:
            going = ProgramResult.NO_RESULT
            eventually(lambda: any(state.program.result is not going for _, state in states[-1:]), LIMIT_S, "its end")
        return [state for _, state in states]


def gap_m(state: AgentState) -> float:
    return float(CHAIR.distance(Point(state.at.x, state.at.y))) - RADIUS_M


@contextlib.contextmanager
def stage(folder: Path, speed: float) -> Iterator[Stage]:
    """All processes, until the end of the `with`."""
    at = HALL_M / 2 - FROM_M, HALL_M / 2, 0.0
    chair = MapObject("chair", BoxShape((CHAIR_M, CHAIR_M)), (HALL_M / 2, HALL_M / 2), math.pi / 5)
    native.save(hall(), folder / "hall.yaml")
    native.save(hall(chair), folder / "world.yaml")
    where = ("--floor", FLOOR, "--at", ",".join(map(str, at)), "--adaptor", "smartpal")
    world = ("--world", str(folder / "world.yaml"), "--world-at", *map(str, at))
    with (
        running_system(folder, "--building", str(folder / "hall.yaml")) as (running, _),
        Orb(running.naming) as orb,
        running_stand_in(folder / "actual", *world, orb=orb) as actual,
        robot_process(folder, orb, ROBOT, *where, "--", "--naming", str(actual.naming)) as robot,
    ):
        orb.resolve(f"Robots/{ROBOT}", RoboCorba.RobotAgent).setSpeedCap(speed)
        yield Stage(orb, robot.agent)


def main(tries: int = 100, speed: float = 0.8) -> bool:
    choice = random.Random(1)
    with folder_of_bench() as folder, stage(folder, speed) as place:
        found = [place.approach(speed, choice)[0] for _ in progress(range(tries), "tries")]
        contacts = place.contacts()
    rows = [{"try": number, "stands at, m": at_m} for number, at_m in enumerate(found, 1)]
    marks = [
        at_least("nearest to the chair, m", min(found), MARGIN_M),
        at_most("farthest stand from the chair, m", max(found), FAR_M),
        at_most("contacts", contacts, 0.0),
        at_most("tries that ended for another reason", len(place.others), 0),
    ]
    return summarize("protection", f"a chair that no map has, at {speed:g} m/s", rows, marks)


if __name__ == "__main__":
    run(main)
