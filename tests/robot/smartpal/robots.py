"""A robot whose time passes when the test says so."""

from __future__ import annotations

import math

from robocorba.robot.smartpal_stand_in.codes import ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import STEP_S
from robocorba.robot.smartpal_stand_in.robot import SmartPal
from robocorba.robot.smartpal_stand_in.unit import SERVO_ON_S, UnitPolicy


def run(robot: SmartPal, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        robot.step()


def until_stopped(robot: SmartPal, limit_s: float = 30.0) -> float:
    """Seconds until all units have stopped."""
    passed = 0.0
    while any(unit.is_moving for unit in robot.units.values()):
        assert passed < limit_s
        robot.step()
        passed += STEP_S
    return passed


def ready(seed: int = 1, is_fast: bool = True, policy: UnitPolicy = UnitPolicy()) -> SmartPal:  # noqa: B008
    """With power and servos on; its base's limits at their maximum (`is_fast`) or as at power-up."""
    robot = SmartPal(seed, policy=policy)
    for unit in (robot.mobility, robot.lumbar, *robot.arms.values()):
        assert unit.power_on() is ReturnCode.OK
    for unit in robot.units.values():
        assert unit.servo_on() is ReturnCode.OK
    run(robot, SERVO_ON_S + 2 * STEP_S)
    if is_fast:
        assert robot.mobility.set_velocity(1000.0, 100.0) is ReturnCode.OK
        assert robot.mobility.set_acceleration(1000.0, 100.0) is ReturnCode.OK
    return robot


def speed(robot: SmartPal) -> float:
    """Of the base, without noise [m/s]."""
    return math.hypot(*robot.dynamics.state.base_velocity[:2])
