"""A motion of an arm in its queue: points to pass one after the other, and how fast."""

from __future__ import annotations

import numpy as np

from robocorba.smartpal.glide import Glide
from robocorba.spatial.grids import Floats


class Motion:
    """points (n, 7), rad, at equal parts of the way, at least two. speed, acceleration: in whole ways a second."""

    def __init__(self, points: Floats, speed: float, acceleration: float) -> None:
        self.points, self._speed, self._acceleration = points, speed, acceleration
        self._way = Glide()

    @property
    def end(self) -> Floats:
        return np.asarray(self.points[-1])

    @property
    def rate(self) -> float:
        """Which part of it is done."""
        return self._way.at

    @property
    def is_done(self) -> bool:
        return self._way.at >= 1.0

    def step(self, is_paused: bool) -> tuple[Floats, Floats]:
        """Where the joints shall be after a step, and how fast, rad/s."""
        if is_paused:
            self._way.run(0.0, self._acceleration)
        else:
            self._way.go(1.0, self._speed, self._acceleration)
        parts = len(self.points) - 1
        place = min(max(self._way.at, 0.0), 1.0) * parts
        part = min(int(place), parts - 1)
        ahead = self.points[part + 1] - self.points[part]
        return self.points[part] + (place - part) * ahead, ahead * (parts * self._way.speed)


def joint_motion(start: Floats, end: Floats, speed: float, acceleration: float) -> Motion:
    """All joints begin and end together; the one with the longest way at `speed`, rad/s."""
    way = max(float(np.abs(end - start).max()), 1e-9)
    return Motion(np.vstack([start, end]), speed / way, acceleration / way)


def most_line_speed(points: Floats, most_joint_speed: Floats) -> float:
    """In whole ways a second, so that no joint is faster than it can be, rad/s (7,)."""
    steepest = np.abs(np.diff(points, axis=0)).max(axis=0) * (len(points) - 1)
    return float((most_joint_speed / np.maximum(steepest, 1e-9)).min())
