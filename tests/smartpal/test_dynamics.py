"""MuJoCo's dynamics of the stand-in, stepped by the test."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocorba.kinematics.smartpal import ARM, JOINTS, MASS_KG, Side
from robocorba.smartpal_stand_in.dynamics import BASE_AXES, JOINT_NOISE_RAD, SERVO_LAG_S, STEP_S, Dynamics
from robocorba.smartpal_stand_in.robot import SmartPal
from tests.smartpal.robots import ready, run, speed


def steps(dynamics: Dynamics, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        dynamics.step()


def test_it_weighs_what_the_robot_weighs_and_holds_its_posture() -> None:
    dynamics = Dynamics()
    assert dynamics.mass_kg == pytest.approx(MASS_KG)
    dynamics.joints[ARM[Side.LEFT]] = np.radians([60, -40, 10, 60, 0, 0, 0])
    steps(dynamics, 1.0)
    assert np.abs(dynamics.state.true_joints - dynamics.joints).max() < 1e-3


def test_joints_follow_with_lag() -> None:
    dynamics = Dynamics()
    dynamics.joint_velocities[0] = 0.5
    for _ in range(500):
        dynamics.joints[0] += 0.5 * STEP_S
        dynamics.step()
    assert dynamics.joints[0] - dynamics.state.true_joints[0] == pytest.approx(0.5 * SERVO_LAG_S, abs=0.002)
    assert dynamics.state.joint_velocities[0] == pytest.approx(0.5, abs=0.01)


def test_encoders_err_by_their_seed() -> None:
    one, same, other = Dynamics(3), Dynamics(3), Dynamics(4)
    for dynamics in (one, same, other):
        steps(dynamics, 0.5)
    assert np.array_equal(one.state.joints, same.state.joints)
    assert not np.array_equal(one.state.joints, other.state.joints)
    errors = one.state.joints - one.state.true_joints
    assert 0.0 < np.abs(errors).max() < 5 * JOINT_NOISE_RAD


def test_the_same_seed_and_orders_give_the_same_run() -> None:
    def drive(robot: SmartPal) -> np.ndarray:
        robot.mobility.move_by(200.0, 100.0, 30.0)
        robot.arms[Side.RIGHT].move_joints([10.0, -20.0, 0.0, 30.0, 0.0, 0.0, 0.0], 40.0)
        run(robot, 1.0)
        return np.concatenate((robot.dynamics.state.base, robot.dynamics.state.joints))

    assert np.array_equal(drive(ready(5)), drive(ready(5)))


def test_a_jammed_axis_does_not_move() -> None:
    dynamics = Dynamics()
    first = len(BASE_AXES)
    dynamics.jam(slice(first, first + 1), True)
    dynamics.joints[:2] = 0.3, -0.3
    steps(dynamics, 0.5)
    assert abs(dynamics.state.true_joints[0]) < 0.005
    assert dynamics.state.true_joints[1] == pytest.approx(-0.3, abs=0.01)
    dynamics.jam(slice(first, first + 1), False)
    steps(dynamics, 0.5)
    assert dynamics.state.true_joints[0] == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("direction", [0.0, 1.0, 2.5, math.pi])
def test_the_base_stands_within_100_ms_from_0_45_m_s(direction: float) -> None:
    robot = ready()
    for _ in range(40):
        robot.mobility.jog(450.0 * math.cos(direction), 450.0 * math.sin(direction), 0.0)
        run(robot, 0.02)
    assert speed(robot) == pytest.approx(0.45, abs=0.01)
    robot.mobility.stop()
    run(robot, 0.1)
    assert speed(robot) < 0.005
    assert len(robot.dynamics.state.joints) == len(JOINTS)
