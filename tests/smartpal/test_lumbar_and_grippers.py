"""Lumbar and gripper units."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from robocorba.kinematics.smartpal import Side
from robocorba.smartpal_stand_in.codes import AxesState, ReturnCode
from robocorba.smartpal_stand_in.lumbar import StandInLumbar
from robocorba.smartpal_stand_in.robot import SmartPal
from tests.smartpal.robots import ready, run, until_stopped

OK, WRONG, RANGE, FAST = ReturnCode.OK, ReturnCode.WRONG_STATE, ReturnCode.OUT_OF_RANGE, ReturnCode.TOO_FAST
ACCELERATION = ReturnCode.TOO_MUCH_ACCELERATION


@pytest.mark.parametrize(
    ("order", "ends"),
    [
        (lambda lumbar: lumbar.move([-5.0, 20.0], 30.0, 60.0), (-5.0, 20.0)),
        (lambda lumbar: lumbar.move([-3.0, None], 30.0, 60.0), (-3.0, 0.0)),
        (lambda lumbar: lumbar.move([None, 15.0], 30.0, 60.0), (0.0, 15.0)),
        (lambda lumbar: lumbar.move_cooperative(20.5, 30.0, 60.0), (0.5, 20.0)),
        (lambda lumbar: lumbar.move_cooperative(-4.0, 30.0, 60.0), (-4.0, 0.0)),
    ],
)
def test_the_lumbar_goes_where_it_shall(
    order: Callable[[StandInLumbar], ReturnCode], ends: tuple[float, float]
) -> None:
    robot = ready()
    assert order(robot.lumbar) is OK
    assert robot.lumbar.state is AxesState.BUSY
    until_stopped(robot)
    run(robot, 0.2)
    assert robot.lumbar.feedback == pytest.approx(ends, abs=0.05)
    assert robot.lumbar.command == pytest.approx(ends, abs=1e-9)


@pytest.mark.parametrize(
    ("order", "answer"),
    [
        (lambda lumbar: lumbar.move([0.6, 0.0], 10.0, 10.0), RANGE),
        (lambda lumbar: lumbar.move([0.0, -0.6], 10.0, 10.0), RANGE),
        (lambda lumbar: lumbar.move([0.0, math.nan], 10.0, 10.0), RANGE),
        (lambda lumbar: lumbar.move([0.0, 0.0], 30.1, 10.0), FAST),
        (lambda lumbar: lumbar.move([0.0, 0.0], 0.0, 10.0), FAST),
        (lambda lumbar: lumbar.move([0.0, 0.0], math.nan, 10.0), FAST),
        (lambda lumbar: lumbar.move([0.0, 0.0], 10.0, 60.1), ACCELERATION),
        (lambda lumbar: lumbar.move_cooperative(122.0, 10.0, 10.0), RANGE),
        (lambda lumbar: lumbar.pause(), WRONG),
    ],
)
def test_what_the_lumbar_refuses(order: Callable[[StandInLumbar], ReturnCode], answer: ReturnCode) -> None:
    assert order(ready().lumbar) is answer


def test_a_new_target_takes_the_place_of_the_one_before() -> None:
    robot = ready()
    lumbar = robot.lumbar
    lumbar.move([None, 60.0], 30.0, 60.0)
    run(robot, 1.0)
    assert lumbar.move([-2.0, 5.0], 30.0, 60.0) is OK
    until_stopped(robot)
    run(robot, 0.2)
    assert lumbar.feedback == pytest.approx([-2.0, 5.0], abs=0.05)


def test_pause_resume_and_stop() -> None:
    robot = ready()
    lumbar = robot.lumbar
    lumbar.move([None, 60.0], 30.0, 60.0)
    run(robot, 1.0)
    assert lumbar.pause() is OK
    run(robot, 0.8)
    held = lumbar.feedback[1]
    run(robot, 0.5)
    assert lumbar.feedback[1] == pytest.approx(held, abs=0.05)
    assert lumbar.resume() is OK
    run(robot, 0.8)
    assert lumbar.feedback[1] > held + 1.0
    assert lumbar.stop() is OK
    run(robot, 0.3)
    assert lumbar.state is AxesState.READY
    assert lumbar.feedback[1] < 59.0


@pytest.mark.parametrize("side", Side)
def test_a_gripper_has_its_power_from_its_arm(side: Side) -> None:
    robot = SmartPal()
    gripper, arm = robot.grippers[side], robot.arms[side]
    assert gripper.state is AxesState.UNPOWERED
    assert gripper.servo_on() is WRONG
    arm.power_on()
    assert gripper.servo_on() is OK
    run(robot, 0.4)
    assert gripper.state is AxesState.READY
    assert gripper.move([-58.0], 120.0, 480.0) is OK
    until_stopped(robot)
    run(robot, 0.2)
    assert gripper.feedback == pytest.approx([-58.0], abs=0.1)
    arm.power_off()
    run(robot, 0.01)
    assert gripper.state is AxesState.UNPOWERED
    arm.power_on()
    run(robot, 0.4)
    assert gripper.state is AxesState.POWERED  # its servo does not come back by itself


@pytest.mark.parametrize("position", [-58.1, 8.1, math.inf])
def test_what_a_gripper_refuses(position: float) -> None:
    assert ready().grippers[Side.LEFT].move([position], 10.0, 10.0) is RANGE
