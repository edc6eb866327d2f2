"""A robot that drives along a path, over floors and elevators.

    python -m robocorba.clients.drive NAME FLOOR X Y FLOOR X Y

The naming service is that of ROBOCORBA_NAMING, 127.0.0.1:2809 if it is not set."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from omniORB import CORBA

from robocorba.corba.conversion.errors import error_of
from robocorba.corba.orb import Orb
from robocorba.errors.base import RoboCorbaError
from robocorba.settings import Settings
from robocorba.stubs import RoboCorba

RADIUS_M, MASS_KG = 0.4, 127.0
LIMITS = RoboCorba.MotionLimits(1.0, 1.75, 1.0, 1.75)
#: Between commands, and how long each of them holds, s of simulated time.
TICK_S, VALID_S = 0.05, 0.3
#: How near a point of the path counts as there; where the next one is in another direction, m.
NEAR_M = 0.05
#: A point that is not reached, or an elevator that does not come, within so much simulated time is given up, s.
POINT_LIMIT_S, ELEVATOR_LIMIT_S = 60.0, 300.0


class Lost(RoboCorbaError):
    """The robot did not get where it should."""


def drive(robot: Any, path: Sequence[Any], tell: Callable[[str], None] = lambda text: None) -> None:
    """Drive a session's robot along a path. Raises Lost; InvalidRide and ElevatorFull where an elevator refuses it."""
    for point, after in zip(path, [*path[1:], None], strict=True):
        if point.kind == RoboCorba.ELEVATOR_ENTRY:
            tell(f"calls {point.elevator}")
            robot.callElevator(point.elevator, after.position.floor)
            _wait(robot, lambda state: state.riding.phase == RoboCorba.BOARDING, f"{point.elevator} did not come")
        if point.kind == RoboCorba.ELEVATOR_EXIT:
            _wait(robot, lambda state: state.riding.phase == RoboCorba.ALIGHTING, f"{point.elevator} did not arrive")
            tell(f"is on {point.position.floor}")
        _go_to(robot, point.position)


def _go_to(robot: Any, goal: Any) -> None:
    state = robot.state()
    deadline = state.time + POINT_LIMIT_S
    while math.dist((state.at.x, state.at.y), (goal.x, goal.y)) > NEAR_M:
        if state.time > deadline:
            raise Lost(
                f"({goal.x:.2f}, {goal.y:.2f}) on {goal.floor} was not reached; touched {state.touched or 'a wall'}"
            )
        robot.command(_towards(state.at, goal), VALID_S)
        time.sleep(TICK_S)
        state = robot.state()
    robot.command(RoboCorba.Velocity(0.0, 0.0, 0.0), VALID_S)


def _towards(at: Any, goal: Any) -> Any:
    """Slower near the goal, facing it."""
    dx, dy = goal.x - at.x, goal.y - at.y
    distance = math.hypot(dx, dy)
    speed = min(LIMITS.speed, 2.0 * distance)
    beside = math.remainder(math.atan2(dy, dx) - at.heading, math.tau)
    turn = max(-LIMITS.turn, min(LIMITS.turn, 2.0 * beside)) if distance > 4 * NEAR_M else 0.0
    return RoboCorba.Velocity(speed * math.cos(beside), speed * math.sin(beside), turn)


def _wait(robot: Any, is_there: Callable[[Any], bool], otherwise: str) -> None:
    state = robot.state()
    deadline = state.time + ELEVATOR_LIMIT_S
    while not is_there(state):
        if state.time > deadline or state.riding.phase == RoboCorba.NO_RIDE:
            raise Lost(otherwise)
        time.sleep(TICK_S)
        state = robot.state()


def log_on(orb: Orb, name: str, path: Sequence[Any]) -> Any:
    """The session of a robot that stands where a path begins."""
    server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    at = path[0].position
    start = RoboCorba.Pose(at.floor, at.x, at.y, path[0].heading)
    return server.registerRobot(RoboCorba.RobotDescription(name, start, RADIUS_M, MASS_KG, LIMITS))


def main(name: str, *places: str) -> None:
    floor, x, y, goal_floor, goal_x, goal_y = places
    with Orb(Settings.read().naming) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        goal = RoboCorba.Point(goal_floor, float(goal_x), float(goal_y))
        path = planner.getPath(RoboCorba.Point(floor, float(x), float(y)), goal)
        robot = log_on(orb, name, path)
        try:
            drive(robot, path, lambda text: print(f"{name} {text}", flush=True))
            at = robot.state().at
            print(f"{name} is there: {at.floor} ({at.x:.2f}, {at.y:.2f})", flush=True)
        finally:
            robot.deregister()


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except CORBA.UserException as refused:
        sys.exit(f"drive: {error_of(refused)}")
    except (RoboCorbaError, TypeError, ValueError) as wrong:
        sys.exit(f"drive: {wrong}")
