"""How the base drives: along straight lines from point to point, slower at corners, exactly to the last point."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robocorba.errors.robots import MotionFailed
from robocorba.motion.motion import Wish
from robocorba.motion.robot_state import STANDING, RobotState, Velocity
from robocorba.spatial.frames import out_of, turned
from robocorba.spatial.pose import Limits

#: How near is there, m and rad; and how slow is standing, m/s and rad/s.
THERE_M, THERE_RAD = 0.002, math.radians(0.05)
STILL_M_S, STILL_RAD_S = 0.005, math.radians(0.5)
#: Of its limits a robot brakes with so much: what is left makes up for delays.
BRAKING = 0.6
#: Speed at the end, a second for each metre that is missing; likewise for turning.
GAIN = 3.0
#: A point is aimed at so far ahead on the line, m; a corner is passed as near as this.
AHEAD_M, PASS_M = 0.25, 0.04
#: No more than so much faster is asked for at a time, m/s.
MORE_M_S = 0.1
#: Nearer than this to the end, the robot takes its last heading, m.
TURN_AT_M = 0.6
#: It gets nowhere when it has come no nearer by so much for so long, m, rad and s.
PROGRESS_M, PROGRESS_RAD, STUCK_S = 0.01, 0.01, 6.0


class Drive:
    """Through `points` (x, y in m), and facing `heading` (rad) at the end, or where it went where that is None.

    speed: m/s at most, also within `limits`; speeds: on the way to each of the points, where these differ. An
    omni-directional base: it drives where it does not face."""

    def __init__(
        self,
        points: Sequence[tuple[float, float]],
        heading: float | None,
        speed: float,
        limits: Limits,
        speeds: Sequence[float] | None = None,
    ) -> None:
        self._points, self._heading = list(points), heading
        self._speeds = [min(speed, limits.speed, each) for each in speeds or [math.inf] * len(self._points)]
        self._limits = limits
        self._next = 0
        self._line_from: tuple[float, float] | None = None
        self._nearest = self._best_turn = math.inf
        self._nearest_at = 0.0

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        here = state.x, state.y
        if self._line_from is None:
            self._line_from = here
        self._pass_corners(here)
        missing = math.dist(here, self._points[self._next])
        remaining = missing + sum(map(math.dist, self._points[self._next :], self._points[self._next + 1 :]))
        vx, vy = self._velocity(here, missing, state)
        wanted = self._wanted_heading(state, remaining, vx, vy)
        beside = math.remainder(wanted - state.heading, math.tau)
        if self._next == len(self._points) - 1 and missing <= THERE_M and abs(beside) <= THERE_RAD and is_still(state):
            return None
        self._check_progress(state, remaining, abs(beside), elapsed_s)
        return Wish((*turned(vx, vy, -state.heading), self._turn(beside)))

    def _pass_corners(self, here: tuple[float, float]) -> None:
        assert self._line_from is not None
        while self._next < len(self._points) - 1:
            corner = self._points[self._next]
            line = _minus(corner, self._line_from)
            beyond = _dot(_minus(here, corner), line) > 0.0 and math.dist(here, corner) < AHEAD_M
            if math.dist(here, corner) > PASS_M and not beyond:
                return
            self._line_from = corner
            self._next += 1

    def _velocity(self, here: tuple[float, float], missing: float, state: RobotState) -> tuple[float, float]:
        """Along the line, and back to it."""
        assert self._line_from is not None
        goal, is_last = self._points[self._next], self._next == len(self._points) - 1
        line = _minus(goal, self._line_from)
        length = math.hypot(*line)
        aim = goal
        if length > 0.0 and missing > AHEAD_M:
            along = _dot(_minus(here, self._line_from), line) / length
            share = min(1.0, max(0.0, along + AHEAD_M) / length)
            aim = (self._line_from[0] + share * line[0], self._line_from[1] + share * line[1])
        way = _minus(aim, here)
        far = math.hypot(*way)
        if far == 0.0:
            return 0.0, 0.0
        slow = 0.0 if is_last else self._corner_speed(line)
        speed = min(
            self._speeds[self._next], math.sqrt(slow * slow + 2.0 * BRAKING * self._limits.acceleration * missing)
        )
        if is_last:
            speed = min(speed, GAIN * missing)
        # What the wheels can is for the new direction first, then for the speed.
        ahead, left, _ = state.velocity
        along = _dot(turned(ahead, left, state.heading), way) / far
        speed = min(speed, max(0.0, along) + MORE_M_S)
        return way[0] / far * speed, way[1] / far * speed

    def _corner_speed(self, line: tuple[float, float]) -> float:
        """As fast as a corner can be passed without leaving the way by more than PASS_M, and as may be after it."""
        most = self._speeds[self._next + 1]
        after = _minus(self._points[self._next + 1], self._points[self._next])
        lengths = math.hypot(*line) * math.hypot(*after)
        if lengths == 0.0:
            return most
        corner_rad = math.acos(max(-1.0, min(1.0, _dot(line, after) / lengths)))
        if corner_rad < 1e-3:
            return most
        return min(most, math.sqrt(self._limits.acceleration * PASS_M) / math.sin(corner_rad / 2.0))

    def _wanted_heading(self, state: RobotState, remaining: float, vx: float, vy: float) -> float:
        if remaining > TURN_AT_M and math.hypot(vx, vy) > 0.0:
            return math.atan2(vy, vx)
        if self._heading is None:
            self._heading = state.heading
        return self._heading

    def _turn(self, beside: float) -> float:
        most = min(self._limits.turn, math.sqrt(2.0 * BRAKING * self._limits.turn_acceleration * abs(beside)))
        return math.copysign(min(most, GAIN * abs(beside)), beside)

    def _check_progress(self, state: RobotState, remaining: float, beside: float, elapsed_s: float) -> None:
        if remaining < self._nearest - PROGRESS_M or (
            remaining < TURN_AT_M and beside < self._best_turn - PROGRESS_RAD
        ):
            self._nearest, self._best_turn = min(remaining, self._nearest), beside
            self._nearest_at = elapsed_s
        x, y = self._points[-1]
        if remaining < 10 * THERE_M and beside < 10 * THERE_RAD:
            return  # creeping in
        if elapsed_s - self._nearest_at > STUCK_S:
            raise MotionFailed(
                f"stuck at ({state.x:.2f}, {state.y:.2f}), {remaining:.2f} m before ({x:.2f}, {y:.2f}): "
                f"no nearer for {STUCK_S:g} s"
            )


class DriveBy:
    """So far ahead and to the left of where it is, m, turned by so much, rad."""

    def __init__(self, ahead: float, left: float, turn: float, speed: float, limits: Limits) -> None:
        self._by, self._speed, self._limits = (ahead, left, turn), speed, limits
        self._drive: Drive | None = None

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        if self._drive is None:
            ahead, left, turn = self._by
            goal = out_of(ahead, left, (state.x, state.y, state.heading))
            self._drive = _Straight(goal, state.heading + turn, self._speed, self._limits)
        return self._drive.wish(state, elapsed_s)


class _Straight(Drive):
    """To one point, turning to the last heading all the way."""

    def __init__(self, goal: tuple[float, float], heading: float, speed: float, limits: Limits) -> None:
        super().__init__([goal], heading, speed, limits)

    def _wanted_heading(self, state: RobotState, remaining: float, vx: float, vy: float) -> float:
        assert self._heading is not None
        return self._heading


class DriveAt:
    """At a velocity for so many seconds; then it stands."""

    def __init__(self, velocity: Velocity, seconds: float) -> None:
        self._velocity, self._seconds = velocity, seconds

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        if elapsed_s < self._seconds:
            return Wish(self._velocity)
        return None if is_still(state) else Wish(STANDING)


class Stand:
    """Until the base does not move any more."""

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        return None if is_still(state) else Wish(STANDING)


def is_still(state: RobotState) -> bool:
    """Whether the base stands."""
    ahead, left, turn = state.velocity
    return math.hypot(ahead, left) <= STILL_M_S and abs(turn) <= STILL_RAD_S


def _minus(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] - b[0], a[1] - b[1]


def _dot(a: tuple[float, float], b: tuple[float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1]
