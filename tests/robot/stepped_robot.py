"""A robot whose movements and simulated building advance in turns, in one thread: as fast as the computer, and always
the same. Paths, drives, rides and physics are real; the controller only applies what a motion wants."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from shapely import Polygon

from robocorba.errors.robots import MotionFailed, RobotError
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Path, PathRequest
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.base import BaseMovements
from robocorba.robot.collision_avoidance.neighbours import OtherRobot
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY
from robocorba.robot.kinematics.smartpal import BASE_LIMITS
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs.base_checks import Planner
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Description, Pose
from robocorba.simulation.store import SimulationStore
from tests.robot.places import InProcessSession

#: Longest motion [s].
MOTION_LIMIT_S = 300.0


class Alone:
    """Nearby of a robot without others."""

    name, policy, seen = "A", DEFAULT_POLICY, NO_OBSTACLES

    def __init__(self, building: Building) -> None:
        self._building = building

    def others(self, x: float, y: float) -> list[OtherRobot]:
        return []

    def clearance_m(self, x: float, y: float) -> float:
        return 10.0

    def shaft(self, elevator: str) -> Polygon | None:
        return shaft_polygon(self._building.elevators[elevator])

    def check_seen(self) -> None:
        pass

    def seen_on(self, line: Sequence[XY], radius_m: float) -> str:
        return ""

    def seen_around(self, x: float, y: float) -> Floats:
        return np.zeros((0, 2))

    def with_seen(self, obstacles: TemporaryObstacles, robot: XY) -> TemporaryObstacles:
        return obstacles

    def movable_objects(self, held: str) -> TemporaryObstacles:
        return NO_OBSTACLES

    def temporary_obstacles(self, also: str = "", goal: XY | None = None, held: str = "") -> TemporaryObstacles:
        return NO_OBSTACLES


class ByElevator:
    """A planner that uses one elevator only."""

    def __init__(self, planner: Planner, building: Building) -> None:
        self._planner, self._building = planner, building
        self.elevator = ""

    def paths(self, request: PathRequest) -> Any:
        others = frozenset(self._building.elevators) - {self.elevator}
        paths: list[Path] = list(self._planner.paths(request._replace(avoid_elevators=others)))
        return paths


class World:
    """A simulated building that advances when it is asked to."""

    def __init__(self, building: Building, folder: FilePath) -> None:
        self.building = building
        self._closing = contextlib.ExitStack()
        store = self._closing.enter_context(SimulationStore(folder / "simulation.sqlite"))
        self.agent = ManagementAgent(building, 1, store)
        #: Called after each step.
        self.after_step: Callable[[], None] = lambda: None

    def step(self) -> None:
        self.agent.step()
        self.after_step()

    def close(self) -> None:
        self._closing.close()


class Session(InProcessSession):
    """Of the robot A. calls: how often it has called an elevator."""

    def __init__(self, world: World, at: Pose) -> None:
        super().__init__(world, Description("A", at))  # type: ignore[arg-type]
        self.calls = 0
        self.log_on()

    def call_elevator(self, elevator: str, destination: str, party: str = "", *group: Any) -> None:
        self.calls += 1
        self._session.call_elevator(elevator, destination, party or None, *group)


class Controller:
    """speed_cap: [m/s]."""

    speed_cap = BASE_LIMITS.speed
    is_paused = False

    def __init__(self, session: Session) -> None:
        self._session = session

    @property
    def state(self) -> RobotState:
        found = self._session.latest
        return RobotState(
            found.time, found.at.x, found.at.y, found.at.heading, found.velocity, np.zeros(18), np.zeros(18)
        )

    def cancel(self, why: RobotError) -> None:
        raise why

    def check(self) -> None:
        pass


class SteppedRobot(BaseMovements):
    """on_cycle: called in each control cycle."""

    def __init__(self, world: World, session: Session, planner: Planner) -> None:
        super().__init__(Controller(session), session, planner, Alone(world.building))  # type: ignore[arg-type]
        self._world, self._steps_of = world, session
        self.on_cycle: Callable[[], None] = lambda: None

    def move(self, motion: Motion) -> None:
        began = self.clock()
        while self.clock() - began < MOTION_LIMIT_S:
            command = motion.command(self.controller.state, self.clock() - began)
            self._steps_of.command(command.velocity if command else (0.0, 0.0, 0.0), 2 * STEP_S)
            self._step()
            if command is None:
                return
        raise MotionFailed("the motion does not end")

    def wait(self, seconds: float, is_met: Callable[[], bool] = lambda: False) -> bool:
        until = self.clock() + seconds
        while self.clock() < until:
            if is_met():
                return True
            self._step()
        return is_met()

    def _step(self) -> None:
        self._world.step()
        self._steps_of.state()
        self.on_cycle()
