"""The mobility unit: states, answers, segments, jogs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from robocorba.smartpal_stand_in.codes import Alarm, AlarmType, MobilityState, ReturnCode
from robocorba.smartpal_stand_in.mobility import Mobility
from robocorba.smartpal_stand_in.robot import SmartPal
from robocorba.smartpal_stand_in.unit import UnitPolicy
from tests.smartpal.robots import ready, run, speed, until_stopped

OK, WRONG, RANGE, FAST, OFF = (
    ReturnCode.OK,
    ReturnCode.WRONG_STATE,
    ReturnCode.OUT_OF_RANGE,
    ReturnCode.TOO_FAST,
    ReturnCode.SERVO_OFF,
)
NAN = math.nan


def test_from_power_up_to_ready() -> None:
    robot = SmartPal()
    base = robot.mobility
    assert base.mobility_state is MobilityState.UNPOWERED
    assert base.servo_on() is WRONG
    assert base.jog(100.0, 0.0, 0.0) is OFF
    assert base.power_on() is OK
    assert base.mobility_state is MobilityState.POWERED
    assert base.servo_on() is OK
    assert base.mobility_state is MobilityState.POWERED  # it takes a while
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.READY
    assert base.move_by(10.0, 0.0, 0.0) is OK
    assert base.mobility_state is MobilityState.BUSY
    assert base.power_off() is OK
    assert base.mobility_state is MobilityState.UNPOWERED
    assert not base.is_servo_on


@pytest.mark.parametrize(
    ("order", "answer"),
    [
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
    ],
)
def test_answers_while_it_stands(order: Callable[[Mobility], ReturnCode], answer: ReturnCode) -> None:
    assert order(ready().mobility) is answer


def test_answers_while_it_moves() -> None:
    robot = ready()
    base = robot.mobility
    assert base.move_by(500.0, 0.0, 0.0) is OK
    run(robot, 0.3)
    assert base.move_by(1.0, 0.0, 0.0) is WRONG
    assert base.jog(1.0, 0.0, 0.0) is WRONG
    assert base.set_position(0.0, 0.0, 0.0) is WRONG
    assert base.pause() is OK
    assert base.mobility_state is MobilityState.PAUSED
    run(robot, 1.0)
    assert speed(robot) < 0.002
    assert base.move_by(1.0, 0.0, 0.0, is_continuous=True) is WRONG
    assert base.resume() is OK
    until_stopped(robot)
    assert base.position[0] == pytest.approx(500.0, abs=2.0)


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
    assert robot.mobility.set_position(1000.0, 2000.0, 0.0) is OK
    assert order(robot.mobility) is OK
    until_stopped(robot)
    x, y, theta = robot.mobility.position
    assert (x, y) == pytest.approx(place[:2], abs=2.5)
    assert abs(math.remainder(theta - place[2], 360.0)) < 0.2


def test_at_power_up_it_is_slow() -> None:
    robot = ready(is_fast=False)
    robot.mobility.jog(1000.0, 0.0, 0.0)
    run(robot, 0.15)
    assert speed(robot) < 0.1 * 0.15 + 0.002
    for _ in range(20):
        robot.mobility.jog(1000.0, 0.0, 0.0)
        run(robot, 0.1)
    assert speed(robot) == pytest.approx(0.1, abs=0.005)


def test_a_jog_ends_with_its_time() -> None:
    robot = ready()
    assert robot.mobility.set_jog_timeout(100) is OK
    for _ in range(15):
        assert robot.mobility.jog(300.0, 0.0, 0.0) is OK
        run(robot, 0.02)
    assert robot.mobility.mobility_state is MobilityState.BUSY
    run(robot, 0.075)
    assert speed(robot) > 0.29
    run(robot, 0.1)
    assert speed(robot) < 0.005
    assert robot.mobility.mobility_state is MobilityState.READY


def test_a_continuous_way_takes_the_place_of_another_without_a_halt() -> None:
    robot = ready()
    assert robot.mobility.move_by(400.0, 0.0, 0.0) is OK
    run(robot, 0.4)
    before = speed(robot)
    assert robot.mobility.move_by(600.0, 0.0, 0.0, is_continuous=True) is OK
    slowest = before
    for _ in range(50):
        robot.step()
        slowest = min(slowest, speed(robot))
    assert slowest > 0.8 * before
    until_stopped(robot)
    assert robot.mobility.position[0] > 650.0


def test_a_jog_is_in_the_base_s_own_frame() -> None:
    robot = ready()
    assert robot.mobility.set_position(0.0, 0.0, 90.0) is OK
    for _ in range(30):
        robot.mobility.jog(300.0, 0.0, 0.0)
        run(robot, 0.02)
    robot.mobility.stop()
    until_stopped(robot)
    x, y, _ = robot.mobility.position
    assert abs(x) < 2.0
    assert y > 100.0


def test_an_alarm_stops_it_until_it_is_cleared() -> None:
    robot = ready()
    base = robot.mobility
    base.move_by(1000.0, 0.0, 0.0)
    run(robot, 0.4)
    hot = Alarm(7, AlarmType.FAULT, "hot")
    base.set_persistent_alarm(hot)
    assert base.mobility_state is MobilityState.ALARM
    assert base.active_alarms(5) == [hot]
    assert base.active_alarms(0) == base.active_alarms(-3) == []
    run(robot, 0.1)
    assert speed(robot) < 0.005
    assert base.clear_alarms() is ReturnCode.FAILED
    base.set_persistent_alarm(None)
    assert base.clear_alarms() is OK
    assert base.mobility_state is MobilityState.POWERED
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.READY
    assert not base.is_moving  # it has forgotten where it went


def test_a_fault_may_leave_the_servo_off() -> None:
    robot = ready(policy=UnitPolicy(restores_servo=False))
    base = robot.mobility
    base.alarm(Alarm(7, AlarmType.FAULT, "hot"))
    assert base.clear_alarms() is OK
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.POWERED
    assert base.servo_on() is OK


def test_a_fault_switches_no_servo_on_that_was_off() -> None:
    robot = ready()
    base = robot.mobility
    assert base.servo_off() is OK
    base.alarm(Alarm(7, AlarmType.FAULT, "hot"))
    assert base.clear_alarms() is OK
    run(robot, 0.4)
    assert base.mobility_state is MobilityState.POWERED


@pytest.mark.parametrize("unlocks", [True, False])
def test_power_off_and_on_may_unlock_it(unlocks: bool) -> None:
    """As a client does that clears alarms and switches power and servo, but knows no `unlock`."""
    robot = ready(policy=UnitPolicy(unlocks_by_power=unlocks))
    base = robot.mobility
    robot.faults.emergency_switch(True)
    assert (base.power_off(), base.power_on()) == (OK, WRONG)
    robot.faults.emergency_switch(False)
    assert base.clear_alarms() is OK
    assert base.mobility_state is MobilityState.LOCKED
    assert base.power_off() is OK
    assert (base.power_on(), base.servo_on()) == ((OK, OK) if unlocks else (WRONG, WRONG))
    run(robot, 0.4)
    assert base.mobility_state is (MobilityState.READY if unlocks else MobilityState.LOCKED)


@pytest.mark.parametrize(("slack", "answer"), [(1e-7, OK), (0.0, ReturnCode.OUT_OF_RANGE)])
def test_limits_have_the_slack_of_rounding(slack: float, answer: ReturnCode) -> None:
    """Of clients that compute degrees from radians."""
    robot = ready(policy=UnitPolicy(limit_slack=slack))
    assert robot.mobility.set_velocity(1000.00001, 100.0000001) is answer
    assert robot.mobility.set_acceleration(1000.00001, 100.0000001) is answer
    assert robot.mobility.set_velocity(1000.1, 100.0) is ReturnCode.OUT_OF_RANGE


def test_a_warning_is_a_caution() -> None:
    robot = ready()
    robot.mobility.alarm(Alarm(8, AlarmType.WARNING, "low battery"))
    assert robot.mobility.mobility_state is MobilityState.CAUTION
    assert robot.mobility.move_by(10.0, 0.0, 0.0) is OK


def test_the_emergency_switch_locks_it() -> None:
    robot = ready()
    base = robot.mobility
    robot.faults.emergency_switch(True)
    assert {unit.state.name for unit in robot.units.values()} == {"LOCKED"}
    assert base.unlock() is WRONG
    assert base.clear_alarms() is ReturnCode.FAILED
    robot.faults.emergency_switch(False)
    assert base.mobility_state is MobilityState.LOCKED
    assert robot.lumbar.state.name == "ALARM"
    assert base.unlock() is OK
    assert base.clear_alarms() is OK
    assert base.mobility_state is MobilityState.POWERED


def test_a_base_that_is_held_fast_is_stuck_and_does_not_leap_when_it_is_free() -> None:
    robot = ready()
    robot.faults.stuck("Mobility", True)
    for _ in range(20):
        robot.mobility.jog(300.0, 0.0, 0.0)
        run(robot, 0.02)
    assert robot.mobility.mobility_state is MobilityState.STUCK
    robot.faults.none()
    assert robot.mobility.clear_alarms() is OK
    before = robot.mobility.position
    run(robot, 0.3)
    assert robot.mobility.position == pytest.approx(before, abs=2.0)
