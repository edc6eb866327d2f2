"""Example: a robot that drives along a path, across floors by elevator.

    python -m robocorba.clients.drive NAME FLOOR X Y FLOOR X Y

The naming service is that of ROBOCORBA_NAMING, by default 127.0.0.1:2809."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.printing import fail, line
from robocorba.system.settings import Settings

RADIUS_M, MASS_KG = 0.4, 127.0
LIMITS = RoboCorba.MotionLimits(1.0, 1.75, 1.0, 1.75)
#: Interval between commands [s].
COMMAND_INTERVAL_S = 0.05
#: Validity of each command [s of simulated time].
VALID_S = 0.3
#: Distance at which a point of the path counts as reached [m].
TOLERANCE_M = 0.05
#: Timeouts for reaching a point, and for an elevator [s of simulated time].
POINT_TIMEOUT_S, ELEVATOR_TIMEOUT_S = 60.0, 300.0


class NotArrived(RoboCorbaError):
    """The robot did not reach a point, or its elevator did not come."""


def drive(robot: Any, path: Sequence[Any], report: Callable[[str], None] = lambda text: None) -> None:
    """Drive a session's robot along a path. Raises NotArrived, InvalidRide, ElevatorFull."""
    for point, after in zip(path, [*path[1:], None], strict=True):
        if point.kind == RoboCorba.ELEVATOR_ENTRY:
            report(f"calls {point.elevator}")
            robot.callElevator(point.elevator, after.position.floor)
            _wait(robot, lambda state: state.riding.phase == RoboCorba.BOARDING, f"{point.elevator} did not come")
        if point.kind == RoboCorba.ELEVATOR_EXIT:
            _wait(robot, lambda state: state.riding.phase == RoboCorba.ALIGHTING, f"{point.elevator} did not arrive")
            report(f"is on {point.position.floor}")
        _go_to(robot, point.position, point.elevator if point.kind == RoboCorba.ELEVATOR_ENTRY else "")


def _go_to(robot: Any, goal: Any, cabin_of: str = "") -> None:
    """Drive straight to a point. cabin_of: the elevator into whose cabin that is; the robot drives only while it has a
    ride."""
    state = robot.state()
    deadline = state.time + POINT_TIMEOUT_S
    while math.dist((state.at.x, state.at.y), (goal.x, goal.y)) > TOLERANCE_M:
        if state.time > deadline:
            raise NotArrived(
                f"({goal.x:.2f}, {goal.y:.2f}) on {goal.floor} was not reached; touched {state.touched or 'a wall'}"
            )
        if cabin_of and state.riding.phase == RoboCorba.NO_RIDE:
            robot.brake()
            raise NotArrived(f"{cabin_of}: the ride was lost on the way into the cabin")
        robot.command(_towards(state.at, goal), VALID_S)
        time.sleep(COMMAND_INTERVAL_S)
        state = robot.state()
    robot.command(RoboCorba.Velocity(0.0, 0.0, 0.0), VALID_S)


def _towards(at: Any, goal: Any) -> Any:
    """The velocity towards a goal: slower near it, and turning to face it."""
    dx, dy = goal.x - at.x, goal.y - at.y
    distance = math.hypot(dx, dy)
    speed = min(LIMITS.speed, 2.0 * distance)
    bearing = math.remainder(math.atan2(dy, dx) - at.heading, math.tau)
    turn = max(-LIMITS.turn, min(LIMITS.turn, 2.0 * bearing)) if distance > 4 * TOLERANCE_M else 0.0
    return RoboCorba.Velocity(speed * math.cos(bearing), speed * math.sin(bearing), turn)


def _wait(robot: Any, condition: Callable[[Any], bool], failure: str) -> None:
    state = robot.state()
    deadline = state.time + ELEVATOR_TIMEOUT_S
    while not condition(state):
        if state.time > deadline or state.riding.phase == RoboCorba.NO_RIDE:
            raise NotArrived(failure)
        time.sleep(COMMAND_INTERVAL_S)
        state = robot.state()


def log_on(orb: Orb, name: str, path: Sequence[Any]) -> Any:
    """Log a robot on at the start of a path; returns its session."""
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
            drive(robot, path, lambda text: line(f"{name} {text}"))
            at = robot.state().at
            line(f"{name} has arrived: {at.floor} ({at.x:.2f}, {at.y:.2f})")
        finally:
            robot.deregister()


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (RoboCorbaError, CORBA.UserException, TypeError, ValueError) as error:
        fail(f"drive: {error_of(error)}")
