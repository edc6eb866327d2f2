"""Motions of the joints are smooth and within the limits, and the virtual controller follows them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import (
    GRIP,
    JOINT_ACCELERATION,
    JOINT_LOWER,
    JOINT_SPEED,
    JOINT_UPPER,
    JOINTS,
    SHUT_RAD,
    Side,
)
from robocorba.robot.motion.joint_motion import FINGER_N_PER_RAD, SETTLE_S, GripMotion, JointMotion
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.virtual_controller import VirtualController

TICK_S = 0.02
POSTURES = st.lists(st.floats(0.0, 1.0), min_size=len(JOINTS), max_size=len(JOINTS)).map(
    lambda shares: JOINT_LOWER + np.array(shares) * (JOINT_UPPER - JOINT_LOWER)
)


class Arms:
    """A virtual controller that is led by motions; `stop_at` holds a joint at an angle."""

    def __init__(self, joints: Floats, blocked: int | None = None, stop_at: float = math.inf) -> None:
        self.servo = VirtualController(joints, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, JOINT_ACCELERATION)
        self.time = 0.0
        self.track = [joints]
        self._blocked, self._stop_at = blocked, stop_at

    def run(self, motion: Motion) -> None:
        begin = self.time
        while (command := motion.command(self._state(), self.time - begin)) is not None:
            if command.joints is not None and command.joint_velocities is not None:
                self.servo.command(command.joints, command.joint_velocities, self.time + 0.1)
            self.time += TICK_S
            self.servo.advance(self.time, TICK_S)
            if self._blocked is not None and self.servo.joints[self._blocked] > self._stop_at:
                self.servo.joints[self._blocked], self.servo.velocities[self._blocked] = self._stop_at, 0.0
            self.track.append(self.servo.joints.copy())
            assert self.time < begin + 120.0

    def _state(self) -> RobotState:
        return RobotState(self.time, joints=self.servo.joints.copy(), joint_velocities=self.servo.velocities.copy())


def moving(waypoints: list[Floats], seconds: float = 0.0) -> JointMotion:
    return JointMotion(np.array(waypoints), JOINTS, JOINT_SPEED, JOINT_ACCELERATION, seconds)


@settings(deadline=None, max_examples=6)
@given(POSTURES, st.lists(POSTURES, min_size=1, max_size=4))
def test_any_motion_keeps_the_limits(begin: Floats, waypoints: list[Floats]) -> None:
    arms = Arms(begin)
    arms.run(moving([begin, *waypoints]))
    assert np.abs(arms.servo.joints - waypoints[-1]).max() < math.radians(0.1)
    track = np.array(arms.track)
    assert (track >= JOINT_LOWER - 1e-9).all() and (track <= JOINT_UPPER + 1e-9).all()
    assert (np.abs(np.diff(track, axis=0)) <= JOINT_SPEED * TICK_S + 1e-9).all()


@settings(deadline=None, max_examples=20)
@given(POSTURES, POSTURES, st.floats(0.0, 5.0))
def test_a_motion_keeps_accelerations_and_its_duration(begin: Floats, end: Floats, seconds: float) -> None:
    assume(not np.array_equal(begin, end))
    motion = moving([begin, end], seconds)
    assert motion.seconds >= seconds
    times = np.linspace(0.0, motion.seconds, 400)[:-1]
    wishes = [motion.command(RobotState(joints=begin), time) for time in times.tolist()]
    velocities = np.array([wish.joint_velocities for wish in wishes if wish])
    assert (np.abs(velocities) <= JOINT_SPEED).all()
    assert (np.abs(np.diff(velocities, axis=0)) / (times[1] - times[0]) <= JOINT_ACCELERATION + 1e-6).all()


def test_joints_that_do_not_arrive_are_named_and_those_within_the_tolerance_settle() -> None:
    begin, end = np.zeros(18), np.zeros(18)
    end[3] = 1.0
    with pytest.raises(MotionFailed, match=r"left_4 is 28\.6 deg from its target"):
        Arms(begin, blocked=3, stop_at=0.5).run(moving([begin, end]))
    motion, arms = moving([begin, end]), Arms(begin, blocked=3, stop_at=1.0 - math.radians(0.2))
    arms.run(motion)
    assert motion.seconds + SETTLE_S < arms.time < motion.seconds + SETTLE_S + 0.2


def test_fingers_stop_at_an_object_and_press_on_it() -> None:
    begin, end = np.zeros(18), np.zeros(18)
    finger = GRIP[Side.LEFT]
    begin[finger], end[finger] = -0.8, SHUT_RAD
    arms = Arms(begin, blocked=finger, stop_at=-0.2)
    motion = GripMotion(np.array([begin, end]), JOINTS, JOINT_SPEED, JOINT_ACCELERATION, [finger], 20.0)
    arms.run(motion)
    command = motion.command(arms._state(), 0.0)
    assert command is not None and command.joints is not None
    pressing = (command.joints[finger] - arms.servo.joints[finger]) * FINGER_N_PER_RAD
    assert pressing == pytest.approx(20.0, abs=1.0)


def test_a_servo_stands_when_commands_end() -> None:
    servo = VirtualController(np.zeros(18), JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, JOINT_ACCELERATION)
    servo.command(np.full(18, 0.5), np.full(18, 0.3), 0.1)
    for tick in range(1, 200):
        servo.advance(tick * TICK_S, TICK_S)
    still = servo.joints.copy()
    servo.advance(5.0, TICK_S)
    assert np.array_equal(servo.joints, still)
    assert np.abs(servo.velocities).max() < 1e-9
