"""When a body that is carried is where: its way with times, the same for every robot to the last bit.

The way is straight from pose to pose, turning evenly; the body rests at each of them for a moment. In between the speed
grows and falls as a smooth step, so that velocity and acceleration are continuous.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from robocorba.errors.robots import InvalidPlan
from robocorba.missions.formation import Pose

#: Of the carriers at most: m/s, rad/s and m/s².
SPEED_M_S, TURN_SPEED_RAD_S, ACCELERATION_M_S2 = 0.25, 0.3, 0.4
#: Poses of a way at most.
MOST_POSES = 2000
#: Shorter ways, m, and turns, rad, are none.
LEAST = 1e-9
#: A smooth step is this much steeper in its middle than a straight one.
_STEEPEST = 1.5
Row = tuple[float, ...]


class Trajectory:
    """poses (k, 3) of the body: x and y in m, heading in rad, unwrapped; places: of the carriers' bases in its frame.

    No carrier, and not the body's origin, goes faster than `speed` m/s, turns faster than `turn_speed` rad/s, or
    accelerates by more than `acceleration` m/s². Raises InvalidPlan."""

    def __init__(
        self,
        poses: ArrayLike,
        places: Sequence[Pose] = (),
        speed: float = SPEED_M_S,
        turn_speed: float = TURN_SPEED_RAD_S,
        acceleration: float = ACCELERATION_M_S2,
    ) -> None:
        for field, value in (("speed", speed), ("turn speed", turn_speed), ("acceleration", acceleration)):
            if not 0.0 < value < math.inf:
                raise InvalidPlan(field, f"{value!r} is not greater than 0")
        way = [(x, y, heading) for x, y, heading in np.asarray(poses, dtype=float).reshape(-1, 3).tolist()]
        reach = max((math.hypot(place[0], place[1]) for place in places), default=0.0)
        limits = (speed, turn_speed, acceleration)
        rows, now = [], 0.0
        for here, there in pairwise(way):
            span, ramp = _times(here, there, reach, limits)
            if span > 0.0:
                rows.append((now, *here, ramp))
                now += span
        rows.append((now, *(way[-1] if way else ()), 0.0))
        self._set(rows)

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[float]]) -> Trajectory:
        """What `to_rows` gave. Raises InvalidPlan."""
        trajectory = cls.__new__(cls)
        trajectory._set(rows)
        return trajectory

    def to_rows(self) -> list[Row]:
        """A row a pose: when the body rests there in s, x and y in m, heading in rad, and for how long it gathers
        speed after it, s."""
        return list(self._rows)

    def _set(self, rows: Sequence[Sequence[float]]) -> None:
        checked = [tuple(map(float, row)) for row in rows]
        if not 1 <= len(checked) <= MOST_POSES:
            raise InvalidPlan("trajectory", f"{len(checked)} poses are not between 1 and {MOST_POSES}")
        for i, row in enumerate(checked):
            if len(row) != 5 or not all(map(math.isfinite, row)):
                raise InvalidPlan(f"trajectory[{i}]", f"{row} is not a row of 5 numbers")
        for i, (row, after) in enumerate(pairwise(checked)):
            span = after[0] - row[0]
            if not (row[0] >= 0.0 and span > 0.0 and 0.0 < row[4] <= span / 2 * (1 + 1e-9)):
                raise InvalidPlan(f"trajectory[{i}]", f"{row} can't be followed by {after}")
        self._rows: list[Row] = checked
        self._begins = [row[0] for row in checked]

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self._begins[-1]

    @property
    def start(self) -> Pose:
        return self._rows[0][1:4]  # type: ignore[return-value]

    @property
    def goal(self) -> Pose:
        return self._rows[-1][1:4]  # type: ignore[return-value]

    def at(self, t: float) -> tuple[Pose, Pose]:
        """Pose of the body at `t` s, and its velocity: m/s along the building's x and y, rad/s."""
        i = bisect_right(self._begins, t) - 1
        if i < 0 or i == len(self._rows) - 1:
            return (self.start if i < 0 else self.goal), (0.0, 0.0, 0.0)
        begins, ax, ay, ah, ramp = self._rows[i]
        ends, bx, by, bh, _ = self._rows[i + 1]
        done, rate = _progress(t - begins, ends - begins, ramp)
        dx, dy, dh = bx - ax, by - ay, bh - ah
        return (ax + done * dx, ay + done * dy, ah + done * dh), (rate * dx, rate * dy, rate * dh)

    def carrier(self, t: float, place: Pose) -> tuple[Pose, Pose]:
        """The same for a carrier's base whose place in the body's frame is this."""
        (x, y, heading), (vx, vy, turn) = self.at(t)
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, left = cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]
        return (x + ahead, y + left, heading + place[2]), (vx - turn * left, vy + turn * ahead, turn)


def _times(here: Pose, there: Pose, reach: float, limits: tuple[float, float, float]) -> tuple[float, float]:
    """Seconds from rest to rest, and those of them in which the speed grows. reach: of the farthest carrier, m."""
    speed, turn_speed, acceleration = limits
    turn = abs(there[2] - here[2])
    way = math.hypot(there[0] - here[0], there[1] - here[1]) + turn * reach  # of the fastest carrier, or more
    if max(way, turn) < LEAST:
        return 0.0, 0.0
    # In ways a second. A carrier that swings round is drawn inwards besides: that gets half of the acceleration.
    most = [math.inf]
    if way > LEAST:
        most.append(speed / way)
    if turn > LEAST:
        most.append(turn_speed / turn)
        if reach > 0.0:
            most.append(math.sqrt(acceleration / 2 / (turn * turn * reach)))
    rate = min(most)
    if way > LEAST:
        along = acceleration - turn * turn * reach * rate * rate
        rate = min(rate, math.sqrt(along / way / _STEEPEST))
        ramp = _STEEPEST * rate * way / along
    else:  # nothing but a turn on the spot, with no carriers
        rate = min(rate, math.sqrt(acceleration / turn / _STEEPEST))
        ramp = _STEEPEST * rate * turn / acceleration
    return 1.0 / rate + ramp, ramp


def _progress(passed: float, span: float, ramp: float) -> tuple[float, float]:
    """Share of a segment that is done, and how fast it grows, 1/s."""
    rate = 1.0 / (span - ramp)
    if passed < ramp:
        done, speed = _smooth_start(passed / ramp)
        return done * ramp * rate, speed * rate
    if passed > span - ramp:
        left, speed = _smooth_start((span - passed) / ramp)
        return 1.0 - left * ramp * rate, speed * rate
    return (passed - ramp / 2) * rate, rate


def _smooth_start(share: float) -> tuple[float, float]:
    """Way and speed of a smooth step from 0 to 1, both as shares."""
    share = min(1.0, max(0.0, share))
    return share**3 - share**4 / 2, share * share * (3.0 - 2.0 * share)
