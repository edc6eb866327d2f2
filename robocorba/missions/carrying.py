"""The motion of a robot that carries something with others: where the leader's rhythm says that it shall be, now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from robocorba.errors.robots import MotionFailed
from robocorba.missions.clock import LeaderClock
from robocorba.missions.rhythm import Rhythm
from robocorba.missions.trajectory import Trajectory
from robocorba.motion.motion import Wish
from robocorba.motion.robot_state import RobotState
from robocorba.spatial.frames import turned

#: How much of what is missing is made up for in a second, 1/s.
GAIN = 4.0
#: How near is there at the end, m and rad; and how far from its place a carrier gives up, m.
THERE_M, THERE_RAD, LOST_M = 0.01, math.radians(1.0), 0.25
#: Ticks that are kept.
MOST_TICKS = 20_000


class CarryMotion:
    """place: of the base in the frame of the body. slipped_m: how far the grip is from the hand, now; it raises
    MotionFailed where nothing is held any more.

    What it measures may be read by any thread."""

    def __init__(
        self,
        trajectory: Trajectory,
        place: tuple[float, float, float],
        rhythm: Rhythm,
        clock: LeaderClock,
        slipped_m: Callable[[], float],
    ) -> None:
        self._trajectory, self._place, self._rhythm, self._clock = trajectory, place, rhythm, clock
        self._slipped_m = slipped_m
        self.error_m = 0.0
        self.farthest_m = 0.0
        #: Leader's time, and seconds along the trajectory, of each tick.
        self.ticks: deque[tuple[float, float]] = deque(maxlen=MOST_TICKS)

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        now = self._clock.now()
        along_s, rate = self._rhythm.along_s(now)
        self.ticks.append((now, along_s))
        (x, y, heading), (vx, vy, turn) = self._trajectory.carrier(along_s, self._place)
        dx, dy = x - state.x, y - state.y
        beside = math.remainder(heading - state.heading, math.tau)
        self.error_m = math.hypot(dx, dy)
        self.farthest_m = max(self.farthest_m, self._slipped_m())
        if along_s >= self._trajectory.duration and self.error_m <= THERE_M and abs(beside) <= THERE_RAD:
            return None
        if self.error_m > LOST_M:
            raise MotionFailed(f"{self.error_m:.2f} m away from its place beside what it carries")
        vx, vy = vx * rate + GAIN * dx, vy * rate + GAIN * dy
        return Wish((*turned(vx, vy, -state.heading), turn * rate + GAIN * beside))
