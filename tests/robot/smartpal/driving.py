"""A small high controller for tests: brings an adaptor's robot to a place and a posture at 50 Hz."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from tests.waits import pause

TICK_S = 0.02
SPEED_M_S, JOINT_RAD_S = 0.45, 0.5


def ticks(limit_s: float) -> Callable[[], bool]:
    """Waits for the next tick; False when the time is over."""
    begun = time.monotonic()
    due = begun

    def wait() -> bool:
        nonlocal due
        due = max(due + TICK_S, time.monotonic())
        pause(max(0.0, due - time.monotonic()))
        return due < begun + limit_s

    return wait


def drive_to(
    adaptor: RobotAdaptor, x: float, y: float, heading: float, posture: Floats, limit_s: float = 15.0
) -> RobotState:
    """The base as the crow flies, and the joints at an even pace; the state when both have stood there for 0.3 s."""
    state = RobotState()
    assert adaptor.read(state)
    at, speeds = state.joints.copy(), np.zeros(3)
    there_for = 0
    wait = ticks(limit_s)
    while wait():
        assert adaptor.read(state)
        left = posture - at
        step = np.clip(left, -JOINT_RAD_S * TICK_S, JOINT_RAD_S * TICK_S)
        at = at + step
        ways = np.array([x - state.x, y - state.y, math.remainder(heading - state.heading, math.tau)])
        wanted = 2.0 * ways
        wanted[:2] *= min(1.0, SPEED_M_S / max(1e-9, math.hypot(*wanted[:2])))
        wanted[2] = max(-1.0, min(1.0, wanted[2]))
        speeds += np.clip(wanted - speeds, -0.9 * TICK_S, 0.9 * TICK_S)
        cosine, sine = math.cos(state.heading), math.sin(state.heading)
        ahead, aside = speeds[0] * cosine + speeds[1] * sine, speeds[1] * cosine - speeds[0] * sine
        assert adaptor.write(ActorCommand((ahead, aside, float(speeds[2])), at, step / TICK_S))
        is_there = math.hypot(*ways[:2]) < 0.005 and abs(ways[2]) < 0.005
        is_there = is_there and float(np.abs(posture - state.joints).max()) < 0.005
        there_for = there_for + 1 if is_there else 0
        if there_for >= 15:
            return state
    raise AssertionError(f"not there within {limit_s:g} s: {state}")
