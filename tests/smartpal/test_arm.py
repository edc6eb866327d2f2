"""The arm unit: answers, states, the queue of motions, lines, jogs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, JOINT_LOWER, JOINT_UPPER, Side
from robocorba.smartpal_stand_in.arm import MAX_MOTIONS, Arm
from robocorba.smartpal_stand_in.codes import AxesState, ReturnCode
from robocorba.smartpal_stand_in.robot import SmartPal
from tests.smartpal.robots import ready, run, until_stopped

OK, WRONG, RANGE, FAST, OFF = (
    ReturnCode.OK,
    ReturnCode.WRONG_STATE,
    ReturnCode.OUT_OF_RANGE,
    ReturnCode.TOO_FAST,
    ReturnCode.SERVO_OFF,
)
BENT = [5.0, -10.0, 0.0, 80.0, 0.0, 5.0, 0.0]
NAN = math.nan


def bent(side: Side = Side.LEFT) -> tuple[SmartPal, Arm]:
    """A robot that holds a forearm level."""
    robot = ready()
    arm = robot.arms[side]
    assert arm.move_joints(BENT, 90.0) is OK
    until_stopped(robot)
    run(robot, 0.2)
    return robot, arm


def test_from_power_up_to_ready() -> None:
    robot = SmartPal()
    arm = robot.arms[Side.RIGHT]
    assert arm.state is AxesState.UNPOWERED
    assert arm.servo_on() is WRONG
    assert arm.move_joints(BENT, 10.0) is OFF
    assert arm.jog_joints([0.0] * 7) is OFF
    assert arm.power_on() is OK
    assert arm.state is AxesState.POWERED
    assert arm.servo_on() is OK
    run(robot, 0.4)
    assert arm.state is AxesState.READY
    assert arm.servo_off() is OK
    assert arm.state is AxesState.POWERED


@pytest.mark.parametrize(
    ("order", "answer"),
    [
        (lambda arm: arm.move_joints(BENT[:6], 10.0), RANGE),
        (lambda arm: arm.move_joints([180.1, *BENT[1:]], 10.0), RANGE),
        (lambda arm: arm.move_joints([NAN, *BENT[1:]], 10.0), RANGE),
        (lambda arm: arm.move_joints(BENT, 0.0), RANGE),
        (lambda arm: arm.move_joints(BENT, 90.1), FAST),
        (lambda arm: arm.move_joints([0.0, 15.0, *[0.0] * 5], 10.0, is_relative=True), RANGE),
        (lambda arm: arm.jog_joints([0.0] * 8), RANGE),
        (lambda arm: arm.jog_joints([NAN] * 7), RANGE),
        (lambda arm: arm.jog_joints([90.1, *[0.0] * 6]), FAST),
        (lambda arm: arm.jog_line(False, [701.0, *[0.0] * 5], 0.0), FAST),
        (lambda arm: arm.jog_line(False, [0.0] * 6, 91.0), FAST),
        (lambda arm: arm.jog_line(True, [math.inf, *[0.0] * 5], 0.0), RANGE),
        (lambda arm: arm.move_line(False, [2000.0, *[0.0] * 5], 0.0, (100.0, 10.0)), RANGE),
        (lambda arm: arm.move_line(False, [100.0, *[0.0] * 5], 0.0, (100.0, 0.0)), RANGE),
        (lambda arm: arm.move_line(False, [100.0, *[0.0] * 5], 0.0, (701.0, 10.0)), FAST),
        (lambda arm: arm.set_joint_acceleration(499), ReturnCode.TOO_MUCH_ACCELERATION),
        (lambda arm: arm.set_joint_acceleration(10_001), RANGE),
        (lambda arm: arm.set_joint_acceleration(500), OK),
        (lambda arm: arm.set_line_acceleration(250, 249), ReturnCode.TOO_MUCH_ACCELERATION),
        (lambda arm: arm.set_line_acceleration(250, 250), OK),
        (lambda arm: arm.set_jog_timeout(19), RANGE),
        (lambda arm: arm.set_jog_timeout(100), OK),
        (lambda arm: arm.set_control_point_offset([1001.0, *[0.0] * 5]), RANGE),
        (lambda arm: arm.pause(), WRONG),
        (lambda arm: arm.resume(), WRONG),
        (lambda arm: arm.stop(), OK),
    ],
)
def test_answers_while_it_stands(order: Callable[[Arm], ReturnCode], answer: ReturnCode) -> None:
    assert order(ready().arms[Side.LEFT]) is answer


def test_motions_wait_their_turn_and_the_queue_is_bounded() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    for _ in range(MAX_MOTIONS):
        assert arm.move_joints([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 60.0, is_relative=True) is OK
    assert arm.move_joints(BENT, 60.0) is ReturnCode.QUEUE_FULL
    assert arm.state is AxesState.BUSY
    assert arm.jog_joints([1.0] * 7) is WRONG
    assert arm.jog_line(False, [1.0] * 6, 0.0) is WRONG
    assert arm.set_control_point_offset([0.0] * 6) is WRONG
    until_stopped(robot)
    run(robot, 0.2)
    assert arm.feedback == pytest.approx([32.0, 0.0, 0.0, 32.0, 0.0, 0.0, 0.0], abs=0.05)


def test_joints_end_together_at_the_speed_that_was_asked_for() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    assert arm.set_joint_acceleration(500) is OK
    assert arm.move_joints([60.0, -30.0, 0.0, 30.0, 0.0, 0.0, 0.0], 45.0) is OK
    run(robot, 0.8)
    assert arm.feedback[0] == pytest.approx(-2 * arm.feedback[1], abs=0.3)
    assert 0 < arm.motion_rate < 100
    speeds = np.degrees(robot.dynamics.state.joint_velocities[ARM[Side.LEFT]])
    assert speeds[0] == pytest.approx(45.0, abs=1.0)
    # 60 degrees at 45 degrees/s, and 0.25 s to get there and back.
    assert until_stopped(robot) == pytest.approx(60 / 45 + 0.25 - 0.8, abs=0.02)
    assert arm.motion_rate == 100


def test_pause_and_resume() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    arm.move_joints([60.0, *[0.0] * 6], 45.0)
    run(robot, 0.8)
    assert arm.pause() is OK
    assert arm.state is AxesState.PAUSED
    run(robot, 1.0)
    at = arm.feedback[0]
    run(robot, 0.5)
    assert arm.feedback[0] == pytest.approx(at, abs=0.05)
    assert arm.move_joints(BENT, 10.0) is WRONG
    assert arm.resume() is OK
    until_stopped(robot)
    run(robot, 0.2)
    assert arm.feedback[0] == pytest.approx(60.0, abs=0.05)


def test_stop_forgets_the_queue() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    for _ in range(3):
        arm.move_joints([20.0, *[0.0] * 6], 90.0, is_relative=True)
    run(robot, 0.5)
    assert arm.stop() is OK
    run(robot, 0.15)
    assert arm.state is AxesState.READY
    assert np.abs(robot.dynamics.state.joint_velocities[ARM[Side.LEFT]]).max() < 0.02
    assert arm.feedback[0] < 30.0


@pytest.mark.parametrize("side", Side)
def test_a_line_is_straight_and_ends_where_it_shall(side: Side) -> None:
    robot, arm = bent(side)
    start = arm.control_point(arm.command)
    last = [start[0] + 80.0, start[1], start[2] + 60.0, *start[3:6]]
    answer = arm.move_line(False, last, start[6] + 10.0, (100.0, 60.0))
    assert answer is OK
    for _ in range(40):
        run(robot, 0.05)
        at = np.array(arm.control_point(arm.command)[:3]) - start[:3]
        along = np.array([0.8, 0.0, 0.6])
        assert np.linalg.norm(at - (at @ along) * along) < 0.5
    until_stopped(robot)
    run(robot, 0.2)
    end = arm.control_point(arm.feedback)
    assert end[:3] == pytest.approx(last[:3], abs=0.7)
    assert end[3:6] == pytest.approx(last[3:], abs=0.2)
    assert end[6] == pytest.approx(start[6] + 10.0, abs=0.3)


def test_frames_of_lines() -> None:
    _, arm = bent()
    start = arm.control_point(arm.command)
    ahead = HandPose(0.0, 0.0, 0.0, *np.radians(start[3:6])).rotation[:, 0]  # x of the hand
    assert arm.move_line(True, [50.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, (100.0, 60.0)) is OK
    assert arm.move_line(False, [0.0, 0.0, 30.0, 0.0, 0.0, 0.0], 0.0, (100.0, 60.0), is_relative=True) is OK
    end = arm.control_point(np.degrees(arm._end).tolist())
    assert end[:3] == pytest.approx(np.array(start[:3]) + 50.0 * ahead + (0.0, 0.0, 30.0), abs=0.05)
    assert end[3:] == pytest.approx(start[3:], abs=0.05)


def test_a_line_that_no_joint_can_follow_as_fast_is_slower() -> None:
    robot, arm = bent()
    start = arm.control_point(arm.command)
    slow = [*start[:5], start[5] + 20.0]
    assert arm.move_line(False, slow, start[6], (700.0, 90.0)) in (OK, ReturnCode.SPEED_WARNING)
    fast = arm.move_line(True, [-250.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, (700.0, 90.0))
    assert fast is ReturnCode.SPEED_WARNING
    for _ in range(200):
        run(robot, 0.01)
        assert np.abs(robot.dynamics.joint_velocities[ARM[Side.LEFT]]).max() <= math.radians(90.0) * 1.01


def test_the_control_point_can_be_moved() -> None:
    _, arm = bent()
    before = np.array(arm.control_point(arm.command)[:3])
    assert arm.set_control_point_offset([100.0, 0.0, 0.0, 0.0, 0.0, 0.0]) is OK
    after = np.array(arm.control_point(arm.command)[:3])
    assert np.linalg.norm(after - before) == pytest.approx(100.0, abs=1e-6)
    last = [*after[:2], after[2] + 40.0, *arm.control_point(arm.command)[3:6]]
    assert arm.move_line(False, last, arm.control_point(arm.command)[6], (100.0, 60.0)) is OK
    assert arm.control_point(np.degrees(arm._end).tolist())[:3] == pytest.approx(last[:3], abs=0.05)


def test_a_jog_holds_for_its_time() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    assert arm.set_jog_timeout(100) is OK
    assert arm.set_joint_acceleration(500) is OK
    for _ in range(20):
        assert arm.jog_joints([30.0, *[0.0] * 6]) is OK
        run(robot, 0.02)
    assert arm.state is AxesState.JOG_BUSY
    assert arm.move_joints(BENT, 10.0) is WRONG
    run(robot, 0.07)
    speeds = robot.dynamics.state.joint_velocities
    assert math.degrees(speeds[0]) == pytest.approx(30.0, abs=0.5)
    run(robot, 0.12)
    assert arm.state is AxesState.READY
    assert abs(math.degrees(robot.dynamics.state.joint_velocities[0])) < 2.0


def test_jogs_halt_at_limits() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    for _ in range(250):
        assert arm.jog_joints([0.0, -60.0, 0.0, -60.0, 0.0, 60.0, -60.0]) is OK
        run(robot, 0.02)
        assert np.all(robot.dynamics.state.true_joints[ARM[Side.LEFT]] <= JOINT_UPPER[ARM[Side.LEFT]] + 0.003)
        assert np.all(robot.dynamics.state.true_joints[ARM[Side.LEFT]] >= JOINT_LOWER[ARM[Side.LEFT]] - 0.003)
    assert arm.feedback == pytest.approx([0.0, -109.5, 0.0, -1.5, 0.0, 44.0, -89.5], abs=0.1)


def test_an_arm_that_runs_into_the_body_is_stuck() -> None:
    robot = ready()
    arm = robot.arms[Side.LEFT]
    answers = []
    for _ in range(100):
        answers.append(arm.jog_joints([0.0, 30.0, 0.0, 0.0, 0.0, 0.0, -30.0]))
        run(robot, 0.02)
    assert answers[0] is OK
    assert answers[-1] is WRONG
    assert arm.state is AxesState.STUCK


@pytest.mark.parametrize("side", Side)
def test_a_line_jog_moves_the_control_point_straight(side: Side) -> None:
    robot, arm = bent(side)
    start = np.array(arm.control_point(arm.command))
    for _ in range(50):
        assert arm.jog_line(False, [50.0, 0.0, 0.0, 0.0, 0.0, 0.0], 8.0) is OK
        run(robot, 0.02)
    moved = np.array(arm.control_point(arm.command)) - start
    assert moved[0] == pytest.approx(50.0, abs=4.0)
    assert np.abs(moved[1:3]).max() < 1.0
    assert np.abs(moved[3:6]).max() < 1.0
    assert moved[6] == pytest.approx(8.0, abs=1.5)


def test_redundancy_mirrors() -> None:
    robot = ready()
    joints = [20.0, -30.0, 15.0, 60.0, 10.0, 5.0, -5.0]
    left, right = (robot.arms[side].control_point(joints) for side in Side)
    assert left[6] == pytest.approx(right[6], abs=1e-6)
    assert left[0] == pytest.approx(right[0], abs=1e-6)
    assert left[1] == pytest.approx(-right[1], abs=1e-6)
