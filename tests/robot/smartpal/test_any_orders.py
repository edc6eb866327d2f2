"""Whatever is ordered in whatever order: states stay legal, nothing moves that may not, limits are kept."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.robot.kinematics.smartpal import JOINT_LOWER, JOINT_SPEED, JOINT_UPPER, Side
from robocorba.robot.smartpal_stand_in.codes import Alarm, AlarmType, AxesState, ReturnCode
from robocorba.robot.smartpal_stand_in.robot import SmartPal
from tests.robot.smartpal.robots import ready

UNITS = ("Mobility", "Lumbar", "MnpL", "MnpR", "GripperL", "GripperR")
ORDERS = ("power_on", "power_off", "servo_on", "servo_off", "stop", "pause", "resume", "clear_alarms")
angles = st.lists(st.floats(-200, 200), min_size=7, max_size=7)
way = st.floats(-1500, 1500)


class AnyOrders(RuleBasedStateMachine):
    robot: SmartPal

    @initialize()
    def switch_on(self) -> None:
        self.robot = ready()

    @rule(unit=st.sampled_from(UNITS), order=st.sampled_from(ORDERS))
    def switch(self, unit: str, order: str) -> None:
        assert isinstance(getattr(self.robot.units[unit], order)(), ReturnCode)

    @rule(unit=st.sampled_from(UNITS), kind=st.sampled_from(AlarmType), lasts=st.booleans())
    def alarm(self, unit: str, kind: AlarmType, lasts: bool) -> None:
        self.robot.units[unit].set_persistent_alarm(Alarm(9, kind, "by the test") if lasts else None)

    @rule(pressed=st.booleans())
    def press(self, pressed: bool) -> None:
        self.robot.faults.emergency_switch(pressed)

    @rule(unit=st.sampled_from(UNITS), on=st.booleans())
    def jam(self, unit: str, on: bool) -> None:
        self.robot.faults.stuck(unit, on)

    @rule(side=st.sampled_from(Side), to=angles, speed=st.floats(-10, 100), relative=st.booleans())
    def move_joints(self, side: Side, to: list[float], speed: float, relative: bool) -> None:
        self.moves(side, self.robot.arms[side].move_joints(to, speed, relative))

    @rule(side=st.sampled_from(Side), to=angles)
    def jog_joints(self, side: Side, to: list[float]) -> None:
        self.moves(side, self.robot.arms[side].jog_joints([angle / 2 for angle in to]))

    @rule(ahead=way, left=way, turn=st.floats(-150, 150))
    def jog(self, ahead: float, left: float, turn: float) -> None:
        self.robot.mobility.jog(ahead, left, turn)

    @rule(x=way, y=way, theta=st.floats(-200, 200), continuous=st.booleans())
    def move(self, x: float, y: float, theta: float, continuous: bool) -> None:
        self.robot.mobility.move_by(x, y, theta, continuous)

    @rule(lower=st.floats(-15, 5), upper=st.floats(-5, 130))
    def lean(self, lower: float, upper: float) -> None:
        self.robot.lumbar.move([lower, upper], 30.0, 60.0)

    @rule(steps=st.integers(1, 60))
    def pass_time(self, steps: int) -> None:
        for _ in range(steps):
            self.robot.step()

    @rule()
    def stop_all(self) -> None:
        """Whatever it does, it stops within half a second."""
        for unit in self.robot.units.values():
            assert unit.stop() is ReturnCode.OK
        for _ in range(250):
            self.robot.step()
        assert not any(unit.is_moving for unit in self.robot.units.values())
        assert not self.robot.dynamics.base_velocity.any()
        assert not self.robot.dynamics.joint_velocities.any()

    def moves(self, side: Side, answer: ReturnCode) -> None:
        may = self.robot.arms[side].state in (AxesState.BUSY, AxesState.JOG_BUSY)
        assert answer is not ReturnCode.OK or may

    @invariant()
    def limits_are_kept(self) -> None:
        dynamics = self.robot.dynamics
        assert np.all(dynamics.joints >= JOINT_LOWER - 1e-6)
        assert np.all(dynamics.joints <= JOINT_UPPER + 1e-6)
        assert np.all(np.abs(dynamics.joint_velocities) <= JOINT_SPEED + 1e-6)
        assert math.hypot(*dynamics.base_velocity[:2]) <= 1.2
        assert np.all(np.isfinite(dynamics.state.true_joints))

    @invariant()
    def what_is_off_does_not_go_on(self) -> None:
        for unit in self.robot.units.values():
            state = unit.state
            assert isinstance(state, AxesState)
            if not unit.is_servo_on:
                assert state.name in ("UNPOWERED", "POWERED", "ALARM", "STUCK", "LOCKED")
                assert not unit.is_jogging
                assert unit.may_move() is not ReturnCode.OK


AnyOrders.TestCase.settings = settings(max_examples=8, stateful_step_count=25, deadline=None)
TestAnyOrders = AnyOrders.TestCase
