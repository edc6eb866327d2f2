"""The check of programs from a robot's present state, in the robot's own process."""

from __future__ import annotations

from robocorba.planning.request import Place
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.agent_state import AgentState
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.programs.base_checks import Planner
from robocorba.robot.programs.checker import Start, check
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.senses import Senses, program_ranges_m


class Checker:
    """Checks a program from the robot's present state, with the objects and robots around it. Thread-safe: simultaneous
    checks don't wait for each other, so that one whose planner hangs delays no other."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        InverseKinematics()  # compiles its kernels

    def __call__(
        self,
        wanted: Program,
        state: AgentState,
        objects: TemporaryObstacles = NO_OBSTACLES,
        robots: TemporaryObstacles = NO_OBSTACLES,
        senses: Senses | None = None,
    ) -> CheckReport:
        at, ranges_m = state.at, program_ranges_m(senses)
        place = Place(at.floor, at.x, at.y)
        start = Start(place, at.heading, state.actor.joints, objects, robots, state.adaptor, ranges_m)
        # Kinematics of its own: they are not thread-safe, and are built in 3 ms.
        return check(wanted, InverseKinematics(), self._planner, start)
