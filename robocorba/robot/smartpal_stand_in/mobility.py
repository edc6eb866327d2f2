"""The mobility unit: an omnidirectional base with jogs, motions along segments, and odometry."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from robocorba.map_editor.spatial.frames import Frame, into, out_of, turned
from robocorba.robot.kinematics.smartpal import BASE_LIMITS
from robocorba.robot.smartpal_stand_in.codes import AxesState, MobilityState, ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import STEP_S, Dynamics
from robocorba.robot.smartpal_stand_in.segment import Segment, arc, from_frame, line, to_frame
from robocorba.robot.smartpal_stand_in.setpoint import Setpoint
from robocorba.robot.smartpal_stand_in.unit import Unit

#: Maximum speed [mm/s, degrees/s] and, with the same values, acceleration [mm/s^2, degrees/s^2].
MAX_MM_S, MAX_DEG_S = 1000.0 * BASE_LIMITS.speed, math.degrees(BASE_LIMITS.turn_speed)
#: Deceleration that the wheels hold [m/s^2, rad/s^2]: half of gravity, wheels about 0.25 m from the centre. Assumed.
BRAKE_M_S2, TURN_BRAKE_RAD_S2 = 4.9, 20.0
#: Tolerance within which the end of a segment is reached [m].
_TOLERANCE_M = 0.001
#: Number of wheels.
WHEELS = 4


class Mobility(Unit):
    """Millimetres and degrees. start: the pose that its odometry reports at power-up [m, rad]."""

    _waits_for_unlock = True

    def __init__(self, dynamics: Dynamics, start: Frame = (0.0, 0.0, 0.0)) -> None:
        super().__init__("Mobility", dynamics)
        #: Pose of the dynamics' start frame in the frame of the odometry.
        self._frame = start
        #: Velocity setpoint in the start frame [m/s, rad/s].
        self._velocity = [0.0, 0.0, 0.0]
        self._segments: deque[Segment] = deque()
        self._progress = Setpoint()
        self._arrived_at: float | None = None
        self._jog: tuple[float, float, float] | None = None
        self._jog_until = 0.0
        #: Limits of speed and acceleration at power-up [m/s, rad/s], [m/s^2, rad/s^2].
        self._speed, self._turn = 0.1, math.radians(10.0)
        self._acceleration, self._turn_acceleration = 0.1, math.radians(10.0)
        self._slipping_from: float | None = None

    # ---- state ----

    @property
    def is_jogging(self) -> bool:
        return self._jog is not None

    @property
    def is_moving(self) -> bool:
        return bool(self._segments) or self.is_jogging or any(self._velocity)

    @property
    def mobility_state(self) -> MobilityState:
        state = self.state
        return MobilityState.BUSY if state is AxesState.JOG_BUSY else MobilityState[state.name]

    @property
    def position(self) -> Frame:
        """x, y [mm], theta [degrees, -180 to 180] from the odometry."""
        with self._lock:
            x, y, heading = from_frame(self._frame, self._pose)
        return 1000.0 * x, 1000.0 * y, math.degrees(math.remainder(heading, math.tau))

    @property
    def battery_v(self) -> int:
        """A full battery has 50 V, and loses 1 V per hour. Assumed."""
        return max(0, round(50.0 - self._latest.time / 3600.0))

    # ---- settings ----

    def set_position(self, x: float, y: float, theta: float) -> ReturnCode:
        """Set the odometry to this pose; WRONG_STATE while the base moves."""
        if not _is_valid(x, y, theta):
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            if self.is_moving:
                return ReturnCode.WRONG_STATE
            origin = to_frame(self._pose, (0.0, 0.0, 0.0))
            self._frame = from_frame((x / 1000.0, y / 1000.0, math.radians(theta)), origin)
            return ReturnCode.OK

    def set_velocity(self, translation: float, rotation: float) -> ReturnCode:
        limits = self._within_limits(translation, rotation)
        if limits is None:
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            self._speed, self._turn = limits
            return ReturnCode.OK

    def set_acceleration(self, translation: float, rotation: float) -> ReturnCode:
        limits = self._within_limits(translation, rotation)
        if limits is None:
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            self._acceleration, self._turn_acceleration = limits
            return ReturnCode.OK

    def _within_limits(self, translation: float, rotation: float) -> tuple[float, float] | None:
        """A speed or acceleration [mm, degrees] in m and rad; None if it exceeds the limits by more than the slack."""
        tolerance = 1.0 + self.policy.limit_slack
        if not (0.0 < translation <= MAX_MM_S * tolerance and 0.0 < rotation <= MAX_DEG_S * tolerance):
            return None
        return min(translation, MAX_MM_S) / 1000.0, math.radians(min(rotation, MAX_DEG_S))

    def unlock(self) -> ReturnCode:
        """Unlock the base after the emergency switch was released."""
        with self._lock:
            if not self._is_locked or self._is_switch_pressed:
                return ReturnCode.WRONG_STATE
            self._is_locked = False
            return ReturnCode.OK

    # ---- orders ----

    def jog(self, ahead: float, left: float, turn: float) -> ReturnCode:
        """Drive at a velocity in the robot's frame [mm/s, degrees/s] until the jog timeout."""
        if not all(map(math.isfinite, (ahead, left, turn))):
            return ReturnCode.OUT_OF_RANGE
        tolerance = 1.0 + self.policy.limit_slack
        if math.hypot(ahead, left) > MAX_MM_S * tolerance or abs(turn) > MAX_DEG_S * tolerance:
            return ReturnCode.TOO_FAST
        with self._lock:
            if (answer := self.may_move()) is not ReturnCode.OK:
                return answer
            if self._segments:
                return ReturnCode.WRONG_STATE
            self._jog = ahead / 1000.0, left / 1000.0, math.radians(turn)
            self._jog_until = self._latest.time + self._jog_timeout_ms / 1000.0
            self._is_idle = False
            return ReturnCode.OK

    def move_by(self, x: float, y: float, theta: float, is_continuous: bool = False) -> ReturnCode:
        """Move to a pose in the robot's current frame."""

        def segments(here: Frame) -> list[Segment]:
            return [line(here, out_of(x / 1000.0, y / 1000.0, here), math.radians(theta))]

        return self._move(_is_valid(x, y, theta), segments, is_continuous)

    def move_to(self, x: float, y: float, theta: float) -> ReturnCode:
        """Move to a pose in the odometry's frame, turning in the shorter direction."""

        def segments(here: Frame) -> list[Segment]:
            to = to_frame(self._frame, (x / 1000.0, y / 1000.0, math.radians(theta)))
            return [line(here, to[:2], math.remainder(to[2] - here[2], math.tau))]

        return self._move(_is_valid(x, y, theta), segments)

    def move_around(self, x: float, y: float, angle: float) -> ReturnCode:
        """Move by `angle` around a centre in the robot's current frame."""

        def segments(here: Frame) -> list[Segment]:
            return [arc(here, out_of(x / 1000.0, y / 1000.0, here), math.radians(angle))]

        return self._move(_is_valid(x, y, angle), segments)

    def move_wagon(self, x: float, y: float, is_absolute: bool = False) -> ReturnCode:
        """Turn towards a point, then drive straight."""

        def segments(here: Frame) -> list[Segment]:
            point = x / 1000.0, y / 1000.0
            to = into(*point, self._frame) if is_absolute else out_of(*point, here)
            if math.dist(here[:2], to) < _TOLERANCE_M:
                return []
            bearing = math.atan2(to[1] - here[1], to[0] - here[0])
            turn = math.remainder(bearing - here[2], math.tau)
            return [line(here, here[:2], turn), line((*here[:2], here[2] + turn), to, 0.0)]

        return self._move(_is_valid(x, y, 0.0), segments)

    def _move(
        self, is_valid: bool, segments: Callable[[Frame], Iterable[Segment]], is_continuous: bool = False
    ) -> ReturnCode:
        if not is_valid:
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            if (answer := self.may_move()) is not ReturnCode.OK:
                return answer
            if self.is_moving and not is_continuous:
                return ReturnCode.WRONG_STATE
            self._jog = None
            self._segments = deque(each for each in segments(self._pose) if each.length_m + abs(each.turn) > 1e-9)
            self._begin_segment()
            self._is_idle = False
            return ReturnCode.OK

    # ---- in the dynamics thread ----

    @property
    def _pose(self) -> Frame:
        """The measured pose in the start frame."""
        x, y, heading = self._latest.base.tolist()
        return x, y, heading

    def _begin_segment(self) -> None:
        """Begin the next segment at the speed that the base has along it."""
        self._progress, self._arrived_at = Setpoint(), None
        if self._segments:
            derivative = self._segments[0].derivative(0.0)
            squared_norm = sum(part * part for part in derivative)
            along = sum(part * speed for part, speed in zip(derivative, self._velocity, strict=True))
            self._progress.speed = max(0.0, along / squared_norm)

    def _drive(self) -> None:
        if self._is_idle:
            return
        if self._jog and self._latest.time > self._jog_until:
            self._jog = None
        if self._segments:
            self._follow_segment()
        elif self._jog:
            self._follow_jog(self._jog)
        else:
            self._ramp_velocity(0.0, 0.0, 0.0, BRAKE_M_S2, TURN_BRAKE_RAD_S2)
        self._dynamics.base_velocity[:] = self._velocity
        self._is_idle = not self.is_moving

    def _follow_segment(self) -> None:
        segment, length_m, turn = self._segments[0], self._segments[0].length_m, abs(self._segments[0].turn)
        speed = min(self._speed / max(length_m, 1e-9), self._turn / max(turn, 1e-9))
        acceleration = min(self._acceleration / max(length_m, 1e-9), self._turn_acceleration / max(turn, 1e-9))
        if self._is_paused:
            self._progress.step_at_velocity(0.0, acceleration)
        else:
            self._progress.step_towards(1.0, speed, acceleration)
        fraction = min(self._progress.position, 1.0)
        errors = [wanted - actual for wanted, actual in zip(segment.at(fraction), self._pose, strict=True)]
        derivative = zip(segment.derivative(fraction), errors, strict=True)
        gain = 5.0  # of the pose correction [1/s]
        x, y, heading = (part * self._progress.speed + gain * error for part, error in derivative)
        # At the wheels' limits, so that velocity left over from an earlier motion fades fastest.
        self._ramp_velocity(x, y, heading, BRAKE_M_S2, TURN_BRAKE_RAD_S2)
        if self._progress.position >= 1.0:
            now = self._latest.time
            self._arrived_at = now if self._arrived_at is None else self._arrived_at
            is_reached = math.hypot(*errors[:2]) < _TOLERANCE_M and abs(errors[2]) < math.radians(0.05)
            if is_reached or now > self._arrived_at + 1.0:  # it ends then even outside the tolerance
                self._segments.popleft()
                self._begin_segment()

    def _follow_jog(self, jog: tuple[float, float, float]) -> None:
        ahead, left, turn = jog
        scale = min(1.0, self._speed / max(math.hypot(ahead, left), 1e-9), self._turn / max(abs(turn), 1e-9))
        x, y = turned(scale * ahead, scale * left, self._pose[2])
        self._ramp_velocity(x, y, scale * turn, self._acceleration, self._turn_acceleration)
        if not any(jog) and not any(self._velocity):
            self._jog = None

    def _ramp_velocity(self, x: float, y: float, turn: float, acceleration: float, turn_acceleration: float) -> None:
        """One step of the velocity setpoint towards a velocity, within these accelerations."""
        change_x, change_y = x - self._velocity[0], y - self._velocity[1]
        scale = min(1.0, acceleration * STEP_S / max(math.hypot(change_x, change_y), 1e-12))
        max_change = turn_acceleration * STEP_S
        change = min(max(turn - self._velocity[2], -max_change), max_change)
        self._velocity = [
            self._velocity[0] + scale * change_x,
            self._velocity[1] + scale * change_y,
            self._velocity[2] + change,
        ]
        if scale == 1.0 and x == y == 0.0:
            self._velocity[:2] = 0.0, 0.0

    def _brake(self) -> None:
        self._is_idle = False
        self._segments.clear()
        self._jog = None
        if self._slipping_from is not None:  # restart from rest, or the base would jump when released
            self._velocity, self._slipping_from = [0.0, 0.0, 0.0], None

    def _is_stuck(self) -> bool:
        """Whether an axis had a speed error of 0.05 m/s or 0.2 rad/s for 0.05 s. Assumed: wheels that brake as hard as
        they can lag by up to 0.02 m/s and 0.09 rad/s."""
        if (np.abs(np.array(self._velocity) - self._latest.base_velocity) < (0.05, 0.05, 0.2)).all():
            self._slipping_from = None
            return False
        if self._slipping_from is None:
            self._slipping_from = self._latest.time
        return self._latest.time > self._slipping_from + 0.05

    def _jam(self, on: bool) -> None:
        self._dynamics.jam(slice(0, 3), on)


def _is_valid(x: float, y: float, theta: float) -> bool:
    if not all(map(math.isfinite, (x, y, theta))):
        return False
    return max(abs(x), abs(y)) <= 1e6 and abs(theta) <= 36_000.0  # [mm, degrees]
