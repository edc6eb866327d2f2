"""The motion of a robot that carries an object with others: it follows the trajectory at the leader's progress."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from robocorba.errors.robots import MotionFailed
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.trajectory import Trajectory
from robocorba.motion.motion import MotionCommand
from robocorba.motion.robot_state import RobotState
from robocorba.spatial.frames import turned

#: Proportional gain of the position controller [1/s].
POSITION_GAIN = 4.0
#: Tolerance at the goal [m, rad].
GOAL_M, GOAL_RAD = 0.01, math.radians(1.0)
#: The carry fails if the position error exceeds this [m].
MAX_ERROR_M = 0.25
#: Control cycles recorded.
MAX_TICKS = 20_000


class CarryMotion:
    """Keeps the base at `place`, its pose in the frame of the carried body. slipped_m: current distance of the grip
    point from the hand; it raises MotionFailed if the hold is lost.

    Its measurements may be read by any thread."""

    def __init__(
        self,
        trajectory: Trajectory,
        place: tuple[float, float, float],
        progress: CarryProgress,
        clock: LeaderClock,
        slipped_m: Callable[[], float],
    ) -> None:
        self._trajectory, self._place, self._progress, self._clock = trajectory, place, progress, clock
        self._slipped_m = slipped_m
        self.error_m = 0.0
        self.farthest_m = 0.0
        #: Leader's time and trajectory time [s] of each control cycle.
        self.ticks: deque[tuple[float, float]] = deque(maxlen=MAX_TICKS)

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        now = self._clock.now()
        along_s, rate = self._progress.along_s(now)
        self.ticks.append((now, along_s))
        (x, y, heading), (vx, vy, turn) = self._trajectory.carrier(along_s, self._place)
        dx, dy = x - state.x, y - state.y
        heading_error = math.remainder(heading - state.heading, math.tau)
        self.error_m = math.hypot(dx, dy)
        self.farthest_m = max(self.farthest_m, self._slipped_m())
        if along_s >= self._trajectory.duration and self.error_m <= GOAL_M and abs(heading_error) <= GOAL_RAD:
            return None
        if self.error_m > MAX_ERROR_M:
            raise MotionFailed(f"{self.error_m:.2f} m off its place beside the object; the limit is {MAX_ERROR_M} m")
        vx, vy = vx * rate + POSITION_GAIN * dx, vy * rate + POSITION_GAIN * dy
        return MotionCommand((*turned(vx, vy, -state.heading), turn * rate + POSITION_GAIN * heading_error))
