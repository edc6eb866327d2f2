"""The control of a carry: each carrier follows the trajectory of the carried body at the leader's progress."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.frames import into, out_of, turned
from robocorba.map_editor.spatial.pose import XY, Pose2D
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.trajectory import ON_PATH, Trajectory
from robocorba.robot.motion.motion import MotionCommand
from robocorba.robot.motion.robot_state import RobotState

#: Tolerance at the goal, of a carrier as of the object [m, rad].
GOAL_M, GOAL_RAD = 0.01, math.radians(1.0)
#: The carry fails if the position error exceeds this [m].
MAX_ERROR_M = 0.25
#: A body that was moved off its path, since a carrier was lost, returns at this speed of its carriers [m/s]; the carry
#: fails if it is farther off [m].
RETURN_SPEED_M_S, MAX_MOVED_M = 0.1, 0.8
#: A carrier whose state has been unknown for this time counts as standing where it was [s].
UNKNOWN_AFTER_S = 0.2


class CarryMotion:
    """Keeps the base at `place`, its pose in the frame of the carried body. slip_m: returns the present distance of the
    grip point from the hand; raises MotionFailed if the hold is lost.

    Any thread may replace `place`: then the body is brought back to its path from where the base holds it. Any thread
    may read the measurements."""

    def __init__(
        self,
        trajectory: Trajectory,
        place: Pose2D,
        progress: CarryProgress,
        clock: LeaderClock,
        slip_m: Callable[[], float],
    ) -> None:
        self._trajectory, self.place, self._progress, self._clock = trajectory, place, progress, clock
        self._slip_m = slip_m
        #: The place at which the body's deviation was measured last; that deviation [m, m, rad]; and when the body
        #: begins to return [s since the start of the motion, without pauses], and for how long [s].
        self._measured_at, self._deviation = place, ON_PATH
        self._returns_from, self._returns_for_s = 0.0, 0.0
        #: Position [m] in the last control cycle, its time by the leader's clock [s], infinite without one and at the
        #: end, and the position error then [m].
        self._last = ((0.0, 0.0), math.inf, 0.0)
        self.max_slip_m = 0.0
        #: Leader's time and trajectory time [s] of the latest control cycles, for the report.
        self.ticks: deque[tuple[float, float]] = deque(maxlen=2000)

    @property
    def error_m(self) -> float:
        """Distance of the base from its place beside a body on its path, where the leader wants it [m]. While no state
        or no order arrives the base stands and the body moves on, until the leader has seen it."""
        at, then, error_m = self._last
        now = self._clock.now()
        if now - then <= UNKNOWN_AFTER_S:
            return error_m
        return self._off_order_m(at, now)

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        now = self._clock.now()
        trajectory_s, rate = self._progress.at(now)
        self.ticks.append((now, trajectory_s))
        place = self.place
        (x, y, heading), _ = self._trajectory.carrier(trajectory_s, place)
        error_m = math.dist((x, y), (state.x, state.y))
        self._last = ((state.x, state.y), now, self._off_order_m((state.x, state.y), now))
        self.max_slip_m = max(self.max_slip_m, self._slip_m())
        is_turned = abs(math.remainder(heading - state.heading, math.tau)) > GOAL_RAD
        if trajectory_s >= self._trajectory.duration and error_m <= GOAL_M and not is_turned:
            self._last = ((state.x, state.y), math.inf, error_m)
            return None
        if place is not self._measured_at:
            self._measure(place, state, trajectory_s, elapsed_s)
        (x, y, heading), (vx, vy, turn) = self._trajectory.carrier(trajectory_s, place, self._off_path(elapsed_s))
        dx, dy = x - state.x, y - state.y
        off_m = math.hypot(dx, dy)
        if off_m > MAX_ERROR_M:
            raise MotionFailed(f"{off_m:.2f} m off its place beside the object; the limit is {MAX_ERROR_M} m")
        gain = 4.0  # of the position controller [1/s]
        vx, vy = vx * rate + gain * dx, vy * rate + gain * dy
        turn = turn * rate + gain * math.remainder(heading - state.heading, math.tau)
        return MotionCommand((*turned(vx, vy, -state.heading), turn))

    def _off_order_m(self, at: XY, now: float) -> float:
        """Distance of a base at `at` from its place by the latest order [m]."""
        (x, y, _), _ = self._trajectory.carrier(self._progress.ordered_s(now), self.place)
        return math.dist(at, (x, y))

    def _measure(self, place: Pose2D, base: RobotState, trajectory_s: float, elapsed_s: float) -> None:
        """Find how far the body that is held at `place` is off its path. Raises MotionFailed."""
        facing = base.heading - place[2]
        x, y = out_of(*into(0.0, 0.0, place), (base.x, base.y, base.heading))
        (at_x, at_y, heading), _ = self._trajectory.at(trajectory_s)
        moved_m, turned_rad = math.dist((x, y), (at_x, at_y)), math.remainder(facing - heading, math.tau)
        if moved_m > MAX_MOVED_M:
            raise MotionFailed(f"the object is {moved_m:.2f} m off its path; the limit is {MAX_MOVED_M} m")
        self._measured_at, self._deviation = place, (x - at_x, y - at_y, turned_rad)
        self._returns_from = elapsed_s
        self._returns_for_s = (moved_m + abs(turned_rad) * math.hypot(*place[:2])) / RETURN_SPEED_M_S

    def _off_path(self, elapsed_s: float) -> Pose2D:
        """The deviation of the body from its path that is wanted at `elapsed_s` after the start of the motion."""
        if elapsed_s >= self._returns_from + self._returns_for_s:
            return ON_PATH
        left = 1.0 - max(0.0, elapsed_s - self._returns_from) / self._returns_for_s
        x, y, turned_rad = self._deviation
        return left * x, left * y, left * turned_rad
