"""The trajectory of a carried body; bitwise identical on every robot.

The body moves straight from pose to pose, turning evenly, and stops at each of them. In between the speed rises and
falls as a smooth step, so that velocity and acceleration are continuous.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from robocorba.errors.robots import InvalidPlan
from robocorba.map_editor.spatial.pose import Limits, Pose2D
from robocorba.missions.subplan import Row

#: Limits of each carrier, and of the body's origin. None of the turn's acceleration: that follows from theirs.
CARRY_LIMITS = Limits(speed=0.25, turn_speed=0.3, acceleration=0.4)
#: The deviation of a body that is on its path [m, m, rad].
ON_PATH: Pose2D = (0.0, 0.0, 0.0)
#: Maximum slope of a smooth step, relative to a linear one.
_SMOOTH_STEP_SLOPE = 1.5


class Trajectory:
    """The motion of the body through `poses` (k, 3): x, y [m], unwrapped heading [rad]. carrier_poses: of the
    carriers' bases in the body's frame. Raises InvalidPlan."""

    def __init__(self, poses: ArrayLike, carrier_poses: Sequence[Pose2D] = (), limits: Limits = CARRY_LIMITS) -> None:
        path = [(x, y, heading) for x, y, heading in np.asarray(poses, dtype=float).reshape(-1, 3).tolist()]
        reach = max((math.hypot(x, y) for x, y, _ in carrier_poses), default=0.0)
        rows, now = [], 0.0
        for here, there in pairwise(path):
            span, ramp = _times(here, there, reach, limits)
            if span > 0.0:
                rows.append((now, *here, ramp))
                now += span
        rows.append((now, *(path[-1] if path else ()), 0.0))
        self._set(rows)

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[float]]) -> Trajectory:
        """The inverse of `to_rows`. Raises InvalidPlan."""
        trajectory = cls.__new__(cls)
        trajectory._set(rows)
        return trajectory

    def to_rows(self) -> list[Row]:
        """A row for each pose: time of the stop there [s], x, y [m], heading [rad], and duration of the acceleration
        that follows [s]."""
        return list(self._rows)

    def _set(self, rows: Sequence[Sequence[float]]) -> None:
        checked = [tuple(map(float, row)) for row in rows]
        most = 2000  # poses of a carry, in each plan
        if not 1 <= len(checked) <= most:
            raise InvalidPlan("trajectory", f"{len(checked)} poses; must be 1 to {most}")
        for i, row in enumerate(checked):
            if len(row) != 5 or not all(map(math.isfinite, row)):
                raise InvalidPlan(f"trajectory[{i}]", f"{row} is not a row of 5 finite numbers")
        for i, (row, after) in enumerate(pairwise(checked)):
            span = after[0] - row[0]
            if not (row[0] >= 0.0 and span > 0.0 and 0.0 < row[4] <= span / 2 * (1 + 1e-9)):
                raise InvalidPlan(f"trajectory[{i}]", f"{row} can't be followed by {after}")
        self._rows: list[Row] = checked
        self._begins = [row[0] for row in checked]

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return self._begins[-1]

    @property
    def start(self) -> Pose2D:
        return self._rows[0][1:4]  # type: ignore[return-value]

    @property
    def goal(self) -> Pose2D:
        return self._rows[-1][1:4]  # type: ignore[return-value]

    def at(self, t: float) -> tuple[Pose2D, Pose2D]:
        """Pose2D of the body at `t` [s], and its velocity in the building's frame [m/s, m/s, rad/s]."""
        i = bisect_right(self._begins, t) - 1
        if i < 0 or i == len(self._rows) - 1:
            return (self.start if i < 0 else self.goal), (0.0, 0.0, 0.0)
        begins, ax, ay, ah, ramp = self._rows[i]
        ends, bx, by, bh, _ = self._rows[i + 1]
        done, rate = _progress(t - begins, ends - begins, ramp)
        dx, dy, dh = bx - ax, by - ay, bh - ah
        return (ax + done * dx, ay + done * dy, ah + done * dh), (rate * dx, rate * dy, rate * dh)

    def carrier(self, t: float, place: Pose2D, off: Pose2D = ON_PATH) -> tuple[Pose2D, Pose2D]:
        """The same for a carrier's base at `place` in the body's frame. off: deviation of the body from its path."""
        (x, y, heading), (vx, vy, turn) = self.at(t)
        x, y, heading = x + off[0], y + off[1], heading + off[2]
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, left = cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]
        return (x + ahead, y + left, heading + place[2]), (vx - turn * left, vy + turn * ahead, turn)


def _times(here: Pose2D, there: Pose2D, reach: float, limits: Limits) -> tuple[float, float]:
    """Duration of a segment, and of its acceleration phase [s]. reach: distance of the farthest carrier from the body's
    origin [m]."""
    speed, turn_speed, acceleration, _ = limits
    turn = abs(there[2] - here[2])
    length = math.hypot(there[0] - here[0], there[1] - here[1]) + turn * reach  # upper bound for every carrier
    negligible = 1e-9  # m, rad
    if max(length, turn) < negligible:
        return 0.0, 0.0
    # Rates in segments per second. Half of the acceleration is left for the centripetal part of a turning carrier.
    rates = [math.inf]
    if length > negligible:
        rates.append(speed / length)
    if turn > negligible:
        rates.append(turn_speed / turn)
        if reach > 0.0:
            rates.append(math.sqrt(acceleration / 2 / (turn * turn * reach)))
    rate = min(rates)
    if length > negligible:
        along = acceleration - turn * turn * reach * rate * rate
        rate = min(rate, math.sqrt(along / length / _SMOOTH_STEP_SLOPE))
        ramp = _SMOOTH_STEP_SLOPE * rate * length / along
    else:  # a turn on the spot without carriers
        rate = min(rate, math.sqrt(acceleration / turn / _SMOOTH_STEP_SLOPE))
        ramp = _SMOOTH_STEP_SLOPE * rate * turn / acceleration
    return 1.0 / rate + ramp, ramp


def _progress(passed: float, span: float, ramp: float) -> tuple[float, float]:
    """Share of a segment that is done, and its rate [1/s]."""
    rate = 1.0 / (span - ramp)
    if passed < ramp:
        done, speed = _smooth_start(passed / ramp)
        return done * ramp * rate, speed * rate
    if passed > span - ramp:
        left, speed = _smooth_start((span - passed) / ramp)
        return 1.0 - left * ramp * rate, speed * rate
    return (passed - ramp / 2) * rate, rate


def _smooth_start(share: float) -> tuple[float, float]:
    """Distance and speed of a smooth step of the speed from 0 to 1, both as shares."""
    share = min(1.0, max(0.0, share))
    return share**3 - share**4 / 2, share * share * (3.0 - 2.0 * share)
