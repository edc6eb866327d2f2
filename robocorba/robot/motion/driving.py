"""Motions of the base: along straight lines from point to point, slower at corners, precisely to the last point."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.frames import out_of, turned
from robocorba.map_editor.spatial.pose import Limits
from robocorba.robot.motion.motion import MotionCommand
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, RobotState, Velocity

#: Tolerances of the goal: position [m] and heading [rad].
ARRIVED_M, ARRIVED_RAD = 0.002, math.radians(0.05)
#: Share of the acceleration limits that is planned for braking; the rest compensates for delays.
BRAKING_SHARE = 0.6
#: Gain of the approach to the goal, for position and heading [1/s].
GAIN = 3.0
#: Distance of the point on the line that the base steers for [m].
LOOKAHEAD_M = 0.25
#: Distance at which a corner counts as passed, and greatest deviation from the path there [m].
CORNER_TOLERANCE_M = 0.04
#: Remaining distance from which the robot turns to its final heading [m].
FINAL_TURN_M = 0.6
#: Time without progress, of 10 mm or 0.01 rad towards the goal, after which a motion fails [s].
STUCK_S = 6.0


class Drive:
    """Drives an omnidirectional base through `points` (x, y) [m].

    heading: at the end [rad]; None keeps the direction of travel. speed: limit [m/s] in addition to `limits`. speeds:
    limits on the segment before each point."""

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
        #: Start of the present segment.
        self._segment_start: tuple[float, float] | None = None
        #: Minimum remaining distance [m] and heading error [rad] so far, and when one of them last fell [s].
        self._nearest = self._least_error_rad = math.inf
        self._progress_at = 0.0

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        here = state.x, state.y
        if self._segment_start is None:
            self._segment_start = here
        self._pass_corners(here)
        missing = math.dist(here, self._points[self._next])
        remaining = missing + sum(map(math.dist, self._points[self._next :], self._points[self._next + 1 :]))
        vx, vy = self._velocity(here, missing, state)
        wanted = self._wanted_heading(state, remaining, vx, vy)
        error_rad = math.remainder(wanted - state.heading, math.tau)
        is_at_goal = self._next == len(self._points) - 1 and missing <= ARRIVED_M and abs(error_rad) <= ARRIVED_RAD
        if is_at_goal and is_stationary(state):
            return None
        self._check_progress(state, remaining, abs(error_rad), elapsed_s)
        return MotionCommand((*turned(vx, vy, -state.heading), self._turn(error_rad)))

    def _pass_corners(self, here: tuple[float, float]) -> None:
        """Select the segment to follow: the next one once the base has reached a corner."""
        assert self._segment_start is not None
        while self._next < len(self._points) - 1:
            corner = self._points[self._next]
            segment = _minus(corner, self._segment_start)
            is_beyond = _dot(_minus(here, corner), segment) > 0.0 and math.dist(here, corner) < LOOKAHEAD_M
            if math.dist(here, corner) > CORNER_TOLERANCE_M and not is_beyond:
                return
            self._segment_start = corner
            self._next += 1

    def _velocity(self, here: tuple[float, float], missing: float, state: RobotState) -> tuple[float, float]:
        """Velocity in the building's frame [m/s], towards the point LOOKAHEAD_M ahead on the segment."""
        assert self._segment_start is not None
        goal, is_last = self._points[self._next], self._next == len(self._points) - 1
        segment = _minus(goal, self._segment_start)
        length = math.hypot(*segment)
        target = goal
        if length > 0.0 and missing > LOOKAHEAD_M:
            along = _dot(_minus(here, self._segment_start), segment) / length
            share = min(1.0, max(0.0, along + LOOKAHEAD_M) / length)
            target = (self._segment_start[0] + share * segment[0], self._segment_start[1] + share * segment[1])
        offset = _minus(target, here)
        distance = math.hypot(*offset)
        if distance == 0.0:
            return 0.0, 0.0
        end_speed = 0.0 if is_last else self._corner_speed(segment)
        braking = BRAKING_SHARE * self._limits.acceleration
        speed = min(self._speeds[self._next], math.sqrt(end_speed * end_speed + 2.0 * braking * missing))
        if is_last:
            speed = min(speed, GAIN * missing)
        # The wheels' acceleration serves the new direction first, then the speed: 0.1 m/s above the present one.
        ahead, left, _ = state.velocity
        along = _dot(turned(ahead, left, state.heading), offset) / distance
        speed = min(speed, max(0.0, along) + 0.1)
        return offset[0] / distance * speed, offset[1] / distance * speed

    def _corner_speed(self, segment: tuple[float, float]) -> float:
        """Maximum speed at the next corner at which the base deviates from the path by at most CORNER_TOLERANCE_M.

        An acceleration a turns a velocity v by the corner's angle c along a parabola, v^2 sin^2(c/2) / (2a) off the
        corner; this speed leaves half of the tolerance."""
        limit = self._speeds[self._next + 1]
        after = _minus(self._points[self._next + 1], self._points[self._next])
        lengths = math.hypot(*segment) * math.hypot(*after)
        if lengths == 0.0:
            return limit
        corner_rad = math.acos(max(-1.0, min(1.0, _dot(segment, after) / lengths)))
        if corner_rad < 1e-3:
            return limit
        return min(limit, math.sqrt(self._limits.acceleration * CORNER_TOLERANCE_M) / math.sin(corner_rad / 2.0))

    def _wanted_heading(self, state: RobotState, remaining: float, vx: float, vy: float) -> float:
        """The direction of travel; near the goal the final heading [rad]."""
        if remaining > FINAL_TURN_M and math.hypot(vx, vy) > 0.0:
            return math.atan2(vy, vx)
        if self._heading is None:
            self._heading = state.heading
        return self._heading

    def _turn(self, error_rad: float) -> float:
        """Turning velocity [rad/s]."""
        braking = BRAKING_SHARE * self._limits.turn_acceleration
        limit = min(self._limits.turn_speed, math.sqrt(2.0 * braking * abs(error_rad)))
        return math.copysign(min(limit, GAIN * abs(error_rad)), error_rad)

    def _check_progress(self, state: RobotState, remaining: float, error_rad: float, elapsed_s: float) -> None:
        is_turning = remaining < FINAL_TURN_M and error_rad < self._least_error_rad - 0.01
        if remaining < self._nearest - 0.01 or is_turning:
            self._nearest, self._least_error_rad = min(remaining, self._nearest), error_rad
            self._progress_at = elapsed_s
        x, y = self._points[-1]
        if remaining < 10 * ARRIVED_M and error_rad < 10 * ARRIVED_RAD:
            return  # the slow final approach
        if elapsed_s - self._progress_at > STUCK_S:
            raise MotionFailed(
                f"stuck at ({state.x:.2f}, {state.y:.2f}), {remaining:.2f} m before ({x:.2f}, {y:.2f}): "
                f"no progress for {STUCK_S:g} s"
            )


class DriveBy(Drive):
    """Drives by an offset from the pose at its start: ahead and to the left [m], turn [rad], from the start."""

    def __init__(self, ahead: float, left: float, turn: float, speed: float, limits: Limits) -> None:
        super().__init__([(ahead, left)], turn, speed, limits)
        self._is_relative = True

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        if self._is_relative:
            self._is_relative = False
            self._points = [out_of(*self._points[0], (state.x, state.y, state.heading))]
            self._heading = state.heading + (self._heading or 0.0)
        return super().command(state, elapsed_s)

    def _wanted_heading(self, state: RobotState, remaining: float, vx: float, vy: float) -> float:
        assert self._heading is not None
        return self._heading


class DriveAt:
    """Drives at a constant velocity for some seconds, then stops."""

    def __init__(self, velocity: Velocity, seconds: float) -> None:
        self._velocity, self._seconds = velocity, seconds

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        if elapsed_s < self._seconds:
            return MotionCommand(self._velocity)
        return None if is_stationary(state) else MotionCommand(ZERO_VELOCITY)


def is_stationary(state: RobotState) -> bool:
    """Whether the base is stationary: below 5 mm/s and 0.5 degrees/s, which is above the noise of encoders."""
    ahead, left, turn = state.velocity
    return math.hypot(ahead, left) <= 0.005 and abs(turn) <= math.radians(0.5)


def _minus(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] - b[0], a[1] - b[1]


def _dot(a: tuple[float, float], b: tuple[float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1]
