"""A queued motion of an arm: joint positions to pass in turn, and how fast."""

from __future__ import annotations

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.smartpal_stand_in.setpoint import Setpoint


class UnitMotion:
    """points (n, 7): at least two, at equal fractions of the motion [rad]. rate, acceleration: of the fraction
    completed [1/s, 1/s^2]."""

    def __init__(self, points: Floats, rate: float, acceleration: float) -> None:
        self.points, self._rate, self._acceleration = points, rate, acceleration
        self._progress = Setpoint()

    @property
    def end(self) -> Floats:
        return np.asarray(self.points[-1])

    @property
    def fraction(self) -> float:
        """The fraction completed, 0 to 1."""
        return self._progress.position

    @property
    def is_done(self) -> bool:
        return self._progress.position >= 1.0

    def step(self, is_paused: bool) -> tuple[Floats, Floats]:
        """Joint positions (7,) and velocities (7,) after one step [rad, rad/s]."""
        if is_paused:
            self._progress.step_at_velocity(0.0, self._acceleration)
        else:
            self._progress.step_towards(1.0, self._rate, self._acceleration)
        intervals = len(self.points) - 1
        progress = min(max(self._progress.position, 0.0), 1.0) * intervals
        index = min(int(progress), intervals - 1)
        ahead = self.points[index + 1] - self.points[index]
        return self.points[index] + (progress - index) * ahead, ahead * (intervals * self._progress.speed)


def joint_motion(start: Floats, end: Floats, speed: float, acceleration: float) -> UnitMotion:
    """All joints begin and end together; the one that moves farthest has `speed` [rad/s]."""
    farthest = max(float(np.abs(end - start).max()), 1e-9)
    return UnitMotion(np.vstack([start, end]), speed / farthest, acceleration / farthest)


def max_line_rate(points: Floats, max_joint_speed: Floats) -> float:
    """The highest rate [1/s] at which no joint exceeds its `max_joint_speed` (7,) [rad/s]."""
    steepest = np.abs(np.diff(points, axis=0)).max(axis=0) * (len(points) - 1)
    return float((max_joint_speed / np.maximum(steepest, 1e-9)).min())
