"""The units of the stand-in: answers, states, ways, jogs, alarms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, JOINT_LOWER, JOINT_UPPER, Side
from robocorba.robot.smartpal_stand_in.arm import MAX_MOTIONS, Arm
from robocorba.robot.smartpal_stand_in.codes import Alarm, AlarmType, AxesState, MobilityState, ReturnCode
from robocorba.robot.smartpal_stand_in.mobility import Mobility
from robocorba.robot.smartpal_stand_in.robot import SmartPal
from robocorba.robot.smartpal_stand_in.unit import UnitPolicy
from tests.robot.smartpal.robots import ready, run, speed, until_stopped

OK, WRONG, RANGE, FAST, OFF = (
    ReturnCode.OK,
    ReturnCode.WRONG_STATE,
    ReturnCode.OUT_OF_RANGE,
    ReturnCode.TOO_FAST,
    ReturnCode.SERVO_OFF,
)
ACCELERATION = ReturnCode.TOO_MUCH_ACCELERATION
BENT, STRAIGHT = [5.0, -10.0, 0.0, 80.0, 0.0, 5.0, 0.0], [0.0] * 7
NAN = math.nan
HOT = Alarm(7, AlarmType.FAULT, "hot")


def arm_and_robot(is_bent: bool = False, side: Side = Side.LEFT) -> tuple[Arm, SmartPal]:
    """is_bent: it holds a forearm level."""
    robot = ready()
    if is_bent:
        assert robot.arms[side].move_joints(BENT, 90.0) is OK
        settle(robot)
    return robot.arms[side], robot


def settle(robot: SmartPal) -> float:
    """Returns the seconds until all units have stopped."""
    seconds = until_stopped(robot)
    run(robot, 0.2)
    return seconds


def repeat(robot: SmartPal, times: int, order: Callable[[], ReturnCode], every_s: float = 0.02) -> list[ReturnCode]:
    """Repeat an order, as a jog needs it; returns the answers."""
    answers = []
    for _ in range(times):
        answers.append(order())
        run(robot, every_s)
    return answers


# ---- all units ----


@pytest.mark.parametrize("name", ["Mobility", "MnpR", "Lumbar", "GripperL"])
def test_from_power_up_to_ready(name: str) -> None:
    robot = SmartPal()
    unit = robot.units[name]
    powered_by: Any = robot.arms[Side.LEFT] if name.startswith("Gripper") else unit
    states = MobilityState if name == "Mobility" else AxesState

    def has(state: str) -> bool:
        return (robot.mobility.mobility_state if name == "Mobility" else unit.state) is states[state]

    moves = {
        "Mobility": [lambda: robot.mobility.jog(100.0, 0.0, 0.0), lambda: robot.mobility.move_by(10.0, 0.0, 0.0)],
        "MnpR": [
            lambda: robot.arms[Side.RIGHT].jog_joints(STRAIGHT),
            lambda: robot.arms[Side.RIGHT].move_joints(BENT, 10.0),
        ],
        "Lumbar": [lambda: robot.lumbar.move([-5.0, 20.0], 30.0, 60.0)],
        "GripperL": [lambda: robot.grippers[Side.LEFT].move([-58.0], 120.0, 480.0)],
    }[name]
    assert has("UNPOWERED") and unit.servo_on() is WRONG
    assert {move() for move in moves} == {OFF}
    assert powered_by.power_on() is OK and has("POWERED")
    assert unit.servo_on() is OK and has("POWERED")  # it takes a while
    run(robot, 0.4)
    assert has("READY") and moves[-1]() is OK and has("BUSY")
    settle(robot)
    assert unit.servo_off() is OK and has("POWERED")
    assert unit.servo_on() is OK and powered_by.power_off() is OK
    run(robot, 0.01)
    assert has("UNPOWERED") and not unit.is_servo_on
    powered_by.power_on()
    run(robot, 0.4)
    assert has("POWERED")  # its servo does not come back by itself


ANSWERS: list[tuple[Callable[[Any], ReturnCode], ReturnCode]] = [
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
    (lambda arm: arm.set_joint_acceleration(499), ACCELERATION),
    (lambda arm: arm.set_joint_acceleration(10_001), RANGE),
    (lambda arm: arm.set_joint_acceleration(500), OK),
    (lambda arm: arm.set_line_acceleration(250, 249), ACCELERATION),
    (lambda arm: arm.set_line_acceleration(250, 250), OK),
    (lambda arm: arm.set_jog_timeout(19), RANGE),
    (lambda arm: arm.set_jog_timeout(100), OK),
    (lambda arm: arm.set_control_point_offset([1001.0, *[0.0] * 5]), RANGE),
    (lambda arm: arm.pause(), WRONG),
    (lambda arm: arm.resume(), WRONG),
    (lambda arm: arm.stop(), OK),
    (lambda base: base.jog(1000.0, 1.0, 0.0), FAST),
    (lambda base: base.jog(0.0, 0.0, -100.1), FAST),
    (lambda base: base.jog(NAN, 0.0, 0.0), RANGE),
    (lambda base: base.set_velocity(1000.1, 10.0), RANGE),
    (lambda base: base.set_velocity(0.0, 10.0), RANGE),
    (lambda base: base.set_acceleration(100.0, 100.1), RANGE),
    (lambda base: base.set_jog_timeout(19), RANGE),
    (lambda base: base.set_jog_timeout(10_001), RANGE),
    (lambda base: base.set_jog_timeout(20), OK),
    (lambda base: base.set_position(NAN, 0.0, 0.0), RANGE),
    (lambda base: base.move_by(0.0, math.inf, 0.0), RANGE),
    (lambda base: base.move_to(2e6, 0.0, 0.0), RANGE),
    (lambda base: base.pause(), WRONG),
    (lambda base: base.resume(), WRONG),
    (lambda base: base.unlock(), WRONG),
    (lambda base: base.stop(), OK),
    (lambda base: base.clear_alarms(), OK),
    (lambda lumbar: lumbar.move([0.6, 0.0], 10.0, 10.0), RANGE),
    (lambda lumbar: lumbar.move([0.0, -0.6], 10.0, 10.0), RANGE),
    (lambda lumbar: lumbar.move([0.0, NAN], 10.0, 10.0), RANGE),
    (lambda lumbar: lumbar.move([0.0, 0.0], 30.1, 10.0), FAST),
    (lambda lumbar: lumbar.move([0.0, 0.0], 0.0, 10.0), FAST),
    (lambda lumbar: lumbar.move([0.0, 0.0], NAN, 10.0), FAST),
    (lambda lumbar: lumbar.move([0.0, 0.0], 10.0, 60.1), ACCELERATION),
    (lambda lumbar: lumbar.move_cooperative(122.0, 10.0, 10.0), RANGE),
    (lambda lumbar: lumbar.pause(), WRONG),
    (lambda gripper: gripper.move([-58.1], 10.0, 10.0), RANGE),
    (lambda gripper: gripper.move([8.1], 10.0, 10.0), RANGE),
    (lambda gripper: gripper.move([math.inf], 10.0, 10.0), RANGE),
]


def test_answers_while_it_stands() -> None:
    robot = ready()
    for number, (order, answer) in enumerate(ANSWERS):
        left = {"arm": robot.arms, "gripper": robot.grippers}
        (name,) = order.__code__.co_varnames
        unit = left[name][Side.LEFT] if name in left else {"base": robot.mobility, "lumbar": robot.lumbar}[name]
        assert order(unit) is answer, f"order {number} of {name}"


#: By unit: a long motion, where the unit is, and where the motion ends [mm, deg].
LONG: dict[str, tuple[Callable[[SmartPal], ReturnCode], Callable[[SmartPal], float], float]] = {
    "Mobility": (
        lambda robot: robot.mobility.move_by(500.0, 0.0, 0.0),
        lambda robot: robot.mobility.position[0],
        500.0,
    ),
    "MnpL": (
        lambda robot: robot.arms[Side.LEFT].move_joints([60.0, *[0.0] * 6], 45.0),
        lambda robot: robot.arms[Side.LEFT].feedback[0],
        60.0,
    ),
    "Lumbar": (lambda robot: robot.lumbar.move([None, 60.0], 30.0, 60.0), lambda robot: robot.lumbar.feedback[1], 60.0),
}


@pytest.mark.parametrize("is_stopped", [False, True])
@pytest.mark.parametrize("name", LONG)
def test_a_unit_pauses_and_resumes_and_its_stop_forgets_what_waits(name: str, is_stopped: bool) -> None:
    (order, at, end), robot = LONG[name], ready()
    unit = robot.units[name]
    assert order(robot) is OK
    order(robot)  # only an arm lets it wait
    run(robot, 0.4)
    assert (unit.stop() if is_stopped else unit.pause()) is OK
    run(robot, 0.8)
    assert unit.state is (AxesState.READY if is_stopped else AxesState.PAUSED)
    held = at(robot)
    assert held < 0.9 * end
    run(robot, 0.5)
    assert at(robot) == pytest.approx(held, abs=4e-3 * end)
    assert unit.resume() is (WRONG if is_stopped else OK)
    settle(robot)
    assert at(robot) == pytest.approx(held if is_stopped else end, abs=4e-3 * end)


# ---- the mobile base ----


@pytest.mark.parametrize(
    ("order", "place"),
    [
        (lambda base: base.move_by(300.0, 0.0, 0.0), (1300.0, 2000.0, 0.0)),
        (lambda base: base.move_by(300.0, -200.0, 90.0), (1300.0, 1800.0, 90.0)),
        (lambda base: base.move_by(0.0, 0.0, -120.0), (1000.0, 2000.0, -120.0)),
        (lambda base: base.move_to(700.0, 2100.0, 170.0), (700.0, 2100.0, 170.0)),
        (lambda base: base.move_around(0.0, 200.0, 90.0), (1200.0, 2200.0, 90.0)),
        (lambda base: base.move_around(0.0, -200.0, -90.0), (1200.0, 1800.0, -90.0)),
        (lambda base: base.move_wagon(0.0, 300.0), (1000.0, 2300.0, 90.0)),
        (lambda base: base.move_wagon(1300.0, 2300.0, is_absolute=True), (1300.0, 2300.0, 45.0)),
        (lambda base: base.move_by(0.0, 0.0, 0.0), (1000.0, 2000.0, 0.0)),
    ],
)
def test_ways_end_where_they_shall(order: Callable[[Mobility], Any], place: tuple[float, float, float]) -> None:
    robot = ready()
    assert robot.mobility.move_by(100.0, 50.0, 40.0) is OK
    until_stopped(robot)
    assert robot.mobility.set_position(1000.0, 2000.0, 0.0) is OK
    assert order(robot.mobility) is OK
    until_stopped(robot)
    x, y, theta = robot.mobility.position
    assert (x, y) == pytest.approx(place[:2], abs=2.5)
    assert abs(math.remainder(theta - place[2], 360.0)) < 0.2


def test_answers_while_it_moves_and_at_power_up_it_is_slow() -> None:
    robot = ready()
    base = robot.mobility
    assert base.move_by(500.0, 0.0, 0.0) is OK
    run(robot, 0.3)
    for order in (base.move_by, base.jog, base.set_position):
        assert order(1.0, 0.0, 0.0) is WRONG
    assert base.pause() is OK and base.mobility_state is MobilityState.PAUSED
    assert base.move_by(1.0, 0.0, 0.0, is_continuous=True) is WRONG
    robot = ready(is_fast=False)
    robot.mobility.jog(1000.0, 0.0, 0.0)
    run(robot, 0.15)
    assert speed(robot) < 0.1 * 0.15 + 0.002
    repeat(robot, 20, lambda: robot.mobility.jog(1000.0, 0.0, 0.0), 0.1)
    assert speed(robot) == pytest.approx(0.1, abs=0.005)


def test_a_jog_of_the_base_ends_with_its_time_and_a_continuous_way_has_no_halt() -> None:
    robot = ready()
    base = robot.mobility
    assert base.set_position(0.0, 0.0, 90.0) is OK and base.set_jog_timeout(100) is OK
    assert set(repeat(robot, 15, lambda: base.jog(300.0, 0.0, 0.0))) == {OK}
    assert base.mobility_state is MobilityState.BUSY
    run(robot, 0.075)
    assert speed(robot) > 0.29
    run(robot, 0.1)
    assert speed(robot) < 0.005
    assert base.mobility_state is MobilityState.READY
    assert abs(base.position[0]) < 2.0 and base.position[1] > 75.0
    robot = ready()
    assert robot.mobility.move_by(400.0, 0.0, 0.0) is OK
    run(robot, 0.4)
    before, speeds = speed(robot), []
    assert robot.mobility.move_by(600.0, 0.0, 0.0, is_continuous=True) is OK
    for _ in range(50):
        robot.step()
        speeds.append(speed(robot))
    assert min(speeds) > 0.8 * before
    until_stopped(robot)
    assert robot.mobility.position[0] > 650.0


def test_an_alarm_stops_it_until_it_is_cleared() -> None:
    robot = ready()
    base = robot.mobility
    base.move_by(1000.0, 0.0, 0.0)
    run(robot, 0.4)
    base.set_persistent_alarm(HOT)
    assert base.mobility_state is MobilityState.ALARM
    assert base.active_alarms(5) == [HOT]
    assert base.active_alarms(0) == base.active_alarms(-3) == []
    run(robot, 0.1)
    assert speed(robot) < 0.005
    assert base.clear_alarms() is ReturnCode.FAILED
    base.set_persistent_alarm(None)
    assert base.clear_alarms() is OK and base.mobility_state is MobilityState.POWERED
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.READY
    assert not base.is_moving  # it has forgotten where it went
    base.alarm(Alarm(8, AlarmType.WARNING, "low battery"))
    assert base.mobility_state is MobilityState.CAUTION
    assert base.move_by(10.0, 0.0, 0.0) is OK


@pytest.mark.parametrize(("restores_servo", "was_on"), [(False, True), (True, False)])
def test_a_fault_may_leave_the_servo_off_and_switches_none_on(restores_servo: bool, was_on: bool) -> None:
    robot = ready(policy=UnitPolicy(restores_servo=restores_servo))
    base = robot.mobility
    if not was_on:
        assert base.servo_off() is OK
    base.alarm(HOT)
    assert base.clear_alarms() is OK
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.POWERED
    assert base.servo_on() is OK


@pytest.mark.parametrize("unlocks", [True, False])
def test_the_emergency_switch_locks_it_and_power_off_and_on_may_unlock_it(unlocks: bool) -> None:
    """As a client does that clears alarms and switches power and servo, but knows no `unlock`."""
    robot = ready(policy=UnitPolicy(unlocks_by_power=unlocks))
    base = robot.mobility
    robot.faults.emergency_switch(True)
    assert {unit.state.name for unit in robot.units.values()} == {"LOCKED"}
    assert (base.unlock(), base.clear_alarms()) == (WRONG, ReturnCode.FAILED)
    assert (base.power_off(), base.power_on()) == (OK, WRONG)
    robot.faults.emergency_switch(False)
    assert robot.lumbar.state.name == "ALARM"
    assert base.clear_alarms() is OK
    assert base.mobility_state is MobilityState.LOCKED
    assert base.power_off() is OK
    assert (base.power_on(), base.servo_on()) == ((OK, OK) if unlocks else (WRONG, WRONG))
    run(robot, 0.4)
    assert base.mobility_state is (MobilityState.READY if unlocks else MobilityState.LOCKED)
    assert base.unlock() is (WRONG if unlocks else OK)


@pytest.mark.parametrize("halt", [lambda robot: OK, lambda robot: robot.mobility.stop()], ids=["timeout", "stop"])
def test_a_base_at_its_limits_halts_without_an_alarm(halt: Callable[[SmartPal], ReturnCode]) -> None:
    """Also where jogs are late and it brakes as hard as it can, while it turns."""
    robot = ready()
    for ahead, left, turn in ((900.0, 300.0, 100.0), (-600.0, 700.0, -100.0), (0.0, 0.0, 60.0)):
        repeat(robot, 60, lambda jog=(ahead, left, turn): robot.mobility.jog(*jog))  # type: ignore[misc]
        assert halt(robot) is OK
        settle(robot)
        assert robot.mobility.mobility_state is MobilityState.READY


@pytest.mark.parametrize(("slack", "answer"), [(1e-7, OK), (0.0, RANGE)])
def test_limits_have_the_slack_of_rounding(slack: float, answer: ReturnCode) -> None:
    """Of clients that compute degrees from radians."""
    base = ready(policy=UnitPolicy(limit_slack=slack)).mobility
    assert base.set_velocity(1000.00001, 100.0000001) is answer
    assert base.set_acceleration(1000.00001, 100.0000001) is answer
    assert base.set_velocity(1000.1, 100.0) is RANGE


def test_a_base_that_is_held_fast_is_stuck_and_does_not_leap_when_it_is_free() -> None:
    robot = ready()
    robot.faults.stuck("Mobility", True)
    repeat(robot, 20, lambda: robot.mobility.jog(300.0, 0.0, 0.0))
    assert robot.mobility.mobility_state is MobilityState.STUCK
    robot.faults.none()
    assert robot.mobility.clear_alarms() is OK
    before = robot.mobility.position
    run(robot, 0.3)
    assert robot.mobility.position == pytest.approx(before, abs=2.0)


# ---- the arms ----


def test_motions_wait_their_turn_in_a_bounded_queue_and_joints_end_together() -> None:
    arm, robot = arm_and_robot()
    for _ in range(MAX_MOTIONS):
        assert arm.move_joints([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 60.0, is_relative=True) is OK
    assert arm.move_joints(BENT, 60.0) is ReturnCode.QUEUE_FULL
    assert arm.state is AxesState.BUSY
    assert arm.jog_joints([1.0] * 7) is WRONG
    assert arm.jog_line(False, [1.0] * 6, 0.0) is WRONG
    assert arm.set_control_point_offset([0.0] * 6) is WRONG
    settle(robot)
    assert arm.feedback == pytest.approx([32.0, 0.0, 0.0, 32.0, 0.0, 0.0, 0.0], abs=0.05)
    arm, robot = arm_and_robot()
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


@pytest.mark.parametrize("side", Side)
def test_a_line_is_straight_and_ends_where_it_shall(side: Side) -> None:
    arm, robot = arm_and_robot(True, side)
    start = arm.control_point(arm.command)
    last = [start[0] + 80.0, start[1], start[2] + 60.0, *start[3:6]]
    assert arm.move_line(False, last, start[6] + 10.0, (100.0, 60.0)) is OK
    along = np.array([0.8, 0.0, 0.6])
    for _ in range(40):
        run(robot, 0.05)
        at = np.array(arm.control_point(arm.command)[:3]) - start[:3]
        assert np.linalg.norm(at - (at @ along) * along) < 0.5
    settle(robot)
    end = arm.control_point(arm.feedback)
    assert end[:3] == pytest.approx(last[:3], abs=0.7)
    assert end[3:6] == pytest.approx(last[3:], abs=0.2)
    assert end[6] == pytest.approx(start[6] + 10.0, abs=0.3)


def test_frames_of_lines_and_a_control_point_that_is_moved() -> None:
    arm, _ = arm_and_robot(True)
    start = arm.control_point(arm.command)
    ahead = HandPose(0.0, 0.0, 0.0, *np.radians(start[3:6])).rotation[:, 0]  # x of the hand
    assert arm.move_line(True, [50.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, (100.0, 60.0)) is OK
    assert arm.move_line(False, [0.0, 0.0, 30.0, 0.0, 0.0, 0.0], 0.0, (100.0, 60.0), is_relative=True) is OK
    end = arm.control_point(np.degrees(arm._end).tolist())
    assert end[:3] == pytest.approx(np.array(start[:3]) + 50.0 * ahead + (0.0, 0.0, 30.0), abs=0.05)
    assert end[3:] == pytest.approx(start[3:], abs=0.05)
    arm, _ = arm_and_robot(True)
    before = np.array(arm.control_point(arm.command)[:3])
    assert arm.set_control_point_offset([100.0, 0.0, 0.0, 0.0, 0.0, 0.0]) is OK
    after = np.array(arm.control_point(arm.command)[:3])
    assert np.linalg.norm(after - before) == pytest.approx(100.0, abs=1e-6)
    last = [*after[:2], after[2] + 40.0, *arm.control_point(arm.command)[3:6]]
    assert arm.move_line(False, last, arm.control_point(arm.command)[6], (100.0, 60.0)) is OK
    assert arm.control_point(np.degrees(arm._end).tolist())[:3] == pytest.approx(last[:3], abs=0.05)


def test_a_jog_of_an_arm_holds_for_its_time() -> None:
    arm, robot = arm_and_robot()
    assert arm.set_jog_timeout(100) is OK and arm.set_joint_acceleration(500) is OK
    assert set(repeat(robot, 20, lambda: arm.jog_joints([30.0, *[0.0] * 6]))) == {OK}
    assert arm.state is AxesState.JOG_BUSY
    assert arm.move_joints(BENT, 10.0) is WRONG
    run(robot, 0.07)
    assert math.degrees(robot.dynamics.state.joint_velocities[0]) == pytest.approx(30.0, abs=0.5)
    run(robot, 0.12)
    assert arm.state is AxesState.READY
    assert abs(math.degrees(robot.dynamics.state.joint_velocities[0])) < 2.0


def test_jogs_halt_at_limits_and_an_arm_that_runs_into_the_body_is_stuck() -> None:
    arm, robot = arm_and_robot()
    for _ in range(250):
        assert arm.jog_joints([0.0, -60.0, 0.0, -60.0, 0.0, 60.0, -60.0]) is OK
        run(robot, 0.02)
        joints = robot.dynamics.state.true_joints[ARM[Side.LEFT]]
        assert np.all(joints <= JOINT_UPPER[ARM[Side.LEFT]] + 0.003)
        assert np.all(joints >= JOINT_LOWER[ARM[Side.LEFT]] - 0.003)
    assert arm.feedback == pytest.approx([0.0, -109.5, 0.0, -1.5, 0.0, 44.0, -89.5], abs=0.1)
    arm, robot = arm_and_robot()
    answers = repeat(robot, 100, lambda: arm.jog_joints([0.0, 30.0, 0.0, 0.0, 0.0, 0.0, -30.0]))
    assert (answers[0], answers[-1]) == (OK, WRONG)
    assert arm.state is AxesState.STUCK


@pytest.mark.parametrize("side", Side)
def test_a_line_jog_moves_the_control_point_straight(side: Side) -> None:
    arm, robot = arm_and_robot(True, side)
    start = np.array(arm.control_point(arm.command))
    assert set(repeat(robot, 50, lambda: arm.jog_line(False, [50.0, 0.0, 0.0, 0.0, 0.0, 0.0], 8.0))) == {OK}
    moved = np.array(arm.control_point(arm.command)) - start
    assert moved[0] == pytest.approx(50.0, abs=4.0)
    assert np.abs(moved[1:6]).max() < 1.0
    assert moved[6] == pytest.approx(8.0, abs=1.5)
    left, right = (robot.arms[each].control_point(BENT) for each in Side)
    assert (left[1], left[6]) == pytest.approx((-right[1], right[6]), abs=1e-6)


# ---- lumbar and grippers ----


@pytest.mark.parametrize(
    ("order", "ends"),
    [
        (lambda robot: robot.lumbar.move([-5.0, 20.0], 30.0, 60.0), (-5.0, 20.0)),
        (lambda robot: robot.lumbar.move([-3.0, None], 30.0, 60.0), (-3.0, 0.0)),
        (lambda robot: robot.lumbar.move([None, 15.0], 30.0, 60.0), (0.0, 15.0)),
        (lambda robot: robot.lumbar.move_cooperative(20.5, 30.0, 60.0), (0.5, 20.0)),
        (lambda robot: robot.lumbar.move_cooperative(-4.0, 30.0, 60.0), (-4.0, 0.0)),
        (lambda robot: robot.grippers[Side.RIGHT].move([-58.0], 120.0, 480.0), (-58.0,)),
    ],
)
def test_axes_go_where_they_shall(order: Callable[[SmartPal], ReturnCode], ends: tuple[float, ...]) -> None:
    robot = ready()
    unit: Any = robot.lumbar if len(ends) == 2 else robot.grippers[Side.RIGHT]
    assert order(robot) is OK
    assert unit.state is AxesState.BUSY
    settle(robot)
    assert unit.feedback == pytest.approx(ends, abs=0.1)
    assert unit.command == pytest.approx(ends, abs=1e-9)
