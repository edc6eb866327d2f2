"""Motions of the base, with an ideal base that keeps its acceleration limits."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.robots import MotionFailed
from robocorba.robot.motion.driving import ARRIVED_M, ARRIVED_RAD, CORNER_TOLERANCE_M, Drive
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import RobotState
from robocorba.simulation.physics import Limits

TICK_S = 0.02
LIMITS = Limits()


class Base:
    """An ideal omni-directional base; a wall may hold it at an x."""

    def __init__(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0, wall_x: float = math.inf) -> None:
        self.state = RobotState(0.0, x, y, heading)
        self.track = [(x, y)]
        self.fastest = 0.0
        self._wall_x, self._moving = wall_x, (0.0, 0.0)

    def run(self, motion: Motion, limit_s: float = 200.0) -> float:
        """Run the motion to its end; returns its duration [s]."""
        begin = self.state.time
        while (command := motion.command(self.state, self.state.time - begin)) is not None:
            assert self.state.time < begin + limit_s
            self._step(command.velocity)
        return self.state.time - begin

    def _step(self, wanted: tuple[float, float, float]) -> None:
        state = self.state
        vx, vy = self._moving
        c, s = math.cos(state.heading), math.sin(state.heading)
        dx, dy = c * wanted[0] - s * wanted[1] - vx, s * wanted[0] + c * wanted[1] - vy
        share = min(1.0, LIMITS.acceleration * TICK_S / max(math.hypot(dx, dy), 1e-12))
        most = LIMITS.turn_acceleration * TICK_S
        turn = state.velocity[2] + max(-most, min(most, wanted[2] - state.velocity[2]))
        vx, vy = self._moving = vx + dx * share, vy + dy * share
        x, y = min(self._wall_x, state.x + vx * TICK_S), state.y + vy * TICK_S
        velocity = c * vx + s * vy, c * vy - s * vx, turn
        heading = state.heading + velocity[2] * TICK_S
        self.state = RobotState(state.time + TICK_S, x, y, heading, velocity)
        self.track.append((x, y))
        self.fastest = max(self.fastest, math.hypot(*velocity[:2]))


POINTS = st.tuples(st.floats(-8, 8), st.floats(-8, 8))


@settings(deadline=None, max_examples=12)
@given(st.lists(POINTS, min_size=1, max_size=5), st.floats(-7, 7), st.floats(0.1, 1.0))
def test_a_drive_ends_exactly_at_its_goal(points: list[tuple[float, float]], heading: float, speed: float) -> None:
    base = Base()
    base.run(Drive(points, heading, speed, LIMITS), 2000.0)
    state = base.state
    assert math.dist((state.x, state.y), points[-1]) <= ARRIVED_M
    assert abs(math.remainder(state.heading - heading, math.tau)) <= ARRIVED_RAD
    assert base.fastest <= speed + 1e-9


def test_corners_are_cut_no_more_than_allowed_and_speed_limits_of_segments_are_kept() -> None:
    base = Base()
    base.run(Drive([(3.0, 0.0), (3.0, 3.0), (0.0, 3.0)], None, 1.0, LIMITS))
    for corner in ((3.0, 0.0), (3.0, 3.0)):
        assert min(math.dist(at, corner) for at in base.track) < 3 * CORNER_TOLERANCE_M
    off = [min(abs(y), abs(x - 3.0), abs(y - 3.0)) for x, y in base.track]
    assert max(off) < 2 * CORNER_TOLERANCE_M
    base = Base()
    base.run(Drive([(2.0, 0.0), (4.0, 0.0), (6.0, 0.0)], None, 1.0, LIMITS, [1.0, 0.3, 1.0]))
    steps = [(x, (after - x) / TICK_S) for (x, _), (after, _) in zip(base.track, base.track[1:], strict=False)]
    assert max(speed for x, speed in steps if 2.0 < x < 3.9) <= 0.3 + 1e-6
    assert max(speed for x, speed in steps if x < 2.0) > 0.8
    assert max(speed for x, speed in steps if x > 4.0) > 0.8


def test_a_stuck_robot_is_reported() -> None:
    base = Base(wall_x=1.0)
    with pytest.raises(MotionFailed, match=r"stuck at \(1\.00, 0\.00\), 2\.00 m before \(3\.00, 0\.00\)"):
        base.run(Drive([(3.0, 0.0)], None, 0.5, LIMITS))
