"""MuJoCo's dynamics of the stand-in, stepped by the test; its thread, and the settings of its process."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.map_editor.samples import sample_path
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import ARM, MASS_KG, Side
from robocorba.robot.smartpal_stand_in.dynamics import JOINT_NOISE_RAD, SERVO_LAG_S, STEP_S, Dynamics
from robocorba.robot.smartpal_stand_in.robot import SmartPal
from robocorba.robot.smartpal_stand_in.setpoint import Setpoint
from robocorba.servers.smartpal import world_of
from robocorba.system.repeating import Repeating
from robocorba.system.settings import InvalidSetting, SmartPalSettings
from testkit.processes import eventually
from tests.robot.smartpal.robots import ready, run, speed
from tests.waits import stays

COMMON = ["--endpoint", "127.0.0.1:2", "--naming", "127.0.0.1:1"]


def steps(dynamics: Dynamics, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        dynamics.step()


def test_it_weighs_what_the_robot_weighs_holds_its_posture_and_follows_with_lag() -> None:
    dynamics = Dynamics()
    assert dynamics.mass_kg == pytest.approx(MASS_KG)
    dynamics.joints[ARM[Side.LEFT]] = np.radians([60, -40, 10, 60, 0, 0, 0])
    steps(dynamics, 1.0)
    assert np.abs(dynamics.state.true_joints - dynamics.joints).max() < 1e-3
    dynamics = Dynamics()
    dynamics.joint_velocities[0] = 0.5
    for _ in range(500):
        dynamics.joints[0] += 0.5 * STEP_S
        dynamics.step()
    assert dynamics.joints[0] - dynamics.state.true_joints[0] == pytest.approx(0.5 * SERVO_LAG_S, abs=0.002)
    assert dynamics.state.joint_velocities[0] == pytest.approx(0.5, abs=0.01)


def test_the_same_seed_and_orders_give_the_same_run_and_encoders_err() -> None:
    def end(seed: int) -> Floats:
        robot = ready(seed)
        robot.mobility.move_by(200.0, 100.0, 30.0)
        robot.arms[Side.RIGHT].move_joints([10.0, -20.0, 0.0, 30.0, 0.0, 0.0, 0.0], 40.0)
        run(robot, 1.0)
        state = robot.dynamics.state
        assert 0.0 < np.abs(state.joints - state.true_joints).max() < 5 * JOINT_NOISE_RAD
        return np.concatenate((state.base, state.joints))

    first = end(5)
    assert np.array_equal(first, end(5)) and not np.array_equal(first, end(6))


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


@settings(max_examples=30, deadline=None)
@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.05, 2), st.floats(0.1, 10), st.floats(-1, 1))
def test_a_setpoint_reaches_its_target_within_its_limits(
    at: float, target: float, most: float, acceleration: float, speed: float
) -> None:
    setpoint = Setpoint(at, min(most, max(-most, round(speed, 3))))
    limit_s = 2 * abs(target - at) / most + 4 * most / acceleration + 1.0
    before = setpoint.speed
    for _ in range(round(limit_s / STEP_S)):
        setpoint.step_towards(target, most, acceleration)
        assert abs(setpoint.speed) <= most + 1e-9
        assert abs(setpoint.speed - before) <= acceleration * STEP_S + 1e-9
        before = setpoint.speed
    assert (setpoint.position, setpoint.speed) == (target, 0.0)


def test_time_passes_until_it_is_closed_and_outlives_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    passed: list[float] = []

    def step() -> None:
        passed.append(time.monotonic())
        if len(passed) == 5:
            raise RuntimeError("by the test")

    robot = SmartPal()
    monkeypatch.setattr(robot, "step", step)
    clock = Repeating("dynamics", robot.catch_up, 0.003)
    began = time.monotonic()
    clock.start()
    eventually(lambda: len(passed) > 50)
    clock.close()
    assert len(passed) - 1 <= (passed[-1] - began) / STEP_S, "never ahead of real time"
    assert "dynamics" not in {thread.name for thread in threading.enumerate()}
    ended = len(passed)
    stays(lambda: len(passed) == ended, 0.05)


def test_settings(tmp_path: Path) -> None:
    given = [*COMMON, "--state", str(tmp_path), "--seed", "3", "--x=-1.5", "--y", "2", "--heading", "0.5"]
    read = SmartPalSettings.read(given)
    assert (read.seed, read.start) == (3, (-1.5, 2.0, 0.5))
    usual = SmartPalSettings.read(COMMON)
    assert usual.start == (0, 0, 0)
    assert (usual.restores_servo, usual.unlocks_by_power, usual.limit_slack) == (True, True, 1e-7)
    strict = SmartPalSettings.read([*COMMON, "--servo-after-fault", "off", "--unlock", "unlock", "--limit-slack", "0"])
    assert (strict.restores_servo, strict.unlocks_by_power, strict.limit_slack) == (False, False, 0.0)
    assert world_of(read) is None and read.world_at == read.start
    of_world = ["--world", str(sample_path("paper-scene")), "--world-at", "-1", "2.5", "0", "--range-lost", "0.1"]
    sensing = SmartPalSettings.read([*given, *of_world])
    assert (sensing.world_at, sensing.range_noise_m, sensing.range_lost) == ((-1.0, 2.5, 0.0), 0.0, 0.1)
    world = world_of(sensing)
    assert world and world.sensor("laser").spec.noise.lost == 0.1
    with pytest.raises(InvalidSetting, match=r"--world-floor.*has the floors L1"):
        world_of(SmartPalSettings.read([*given, *of_world, "--world-floor", "L9"]))
    wrong_ones = (["--seed", "-1"], ["--limit-slack", "1"], ["--x", "nan"], ["--heading", "inf"])
    for wrong in (*wrong_ones, ["--range-lost", "2"], ["--range-noise", "nan"], ["--world-at", "0", "nan", "0"]):
        with pytest.raises(InvalidSetting, match=wrong[0]):
            SmartPalSettings.read([*COMMON, *wrong])
