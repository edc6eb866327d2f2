"""An arm unit: jogs, and a queue of joint motions and line motions."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, ARM_JOINTS, Side
from robocorba.robot.smartpal_stand_in.arm_kinematics import ArmKinematics
from robocorba.robot.smartpal_stand_in.axes import AxesUnit
from robocorba.robot.smartpal_stand_in.codes import ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import Dynamics
from robocorba.robot.smartpal_stand_in.setpoint import Setpoint

#: Length of the motion queue. Assumed.
MAX_MOTIONS = 32
#: Maximum speed along lines [mm/s, degrees/s]. Assumed.
MAX_LINE_MM_S, MAX_LINE_DEG_S = 700.0, 90.0
#: Tolerance at limits, because clients may send a rounded limit [degrees].
_TOLERANCE_DEG = 1e-6


class UnitMotion:
    """A queued motion: joint positions to pass in turn, and how fast. points (n, 7): at least two, at equal fractions
    of the motion [rad]. rate, acceleration: of the fraction completed [1/s, 1/s^2]."""

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


class Arm(AxesUnit):
    """Millimetres and degrees. Positions are px, py, pz, rx, ry, rz, in the hand's own frame if `in_tool`."""

    def __init__(self, side: Side, dynamics: Dynamics) -> None:
        super().__init__("MnpL" if side is Side.LEFT else "MnpR", dynamics, ARM[side])
        self.kinematics = ArmKinematics(side)
        self._motions: deque[UnitMotion] = deque()
        self._jog: Floats | None = None
        self._line_jog: tuple[bool, Floats, float] | None = None
        #: Joint speeds of a jog along a line [rad/s], and when new ones are due.
        self._line_jog_speeds: list[float] = []
        self._jog_until = self._line_jog_due = 0.0
        #: Times from standstill to maximum speed, at power-up: of joints; of lines, translation and rotation. Assumed.
        self.joint_acceleration_ms = 1000
        self.line_acceleration_ms = (1000, 1000)

    # ---- state ----

    @property
    def is_jogging(self) -> bool:
        return self._jog is not None or self._line_jog is not None

    @property
    def is_moving(self) -> bool:
        return super().is_moving or bool(self._motions) or self.is_jogging

    @property
    def motion_rate(self) -> int:
        """Progress of the current motion [percent]."""
        with self._lock:
            return round(100 * self._motions[0].fraction) if self._motions else 100

    def control_point(self, joints: Sequence[float]) -> list[float]:
        """px, py, pz, rx, ry, rz and the redundancy for joints (7,) in degrees."""
        angles = np.radians(joints)
        pose = self.kinematics.pose(angles)
        rotations = (*pose[3:], self.kinematics.redundancy(angles))
        return [*(1000.0 * metres for metres in pose[:3]), *map(math.degrees, rotations)]

    # ---- settings ----

    def set_joint_acceleration(self, time_ms: int) -> ReturnCode:
        if (answer := _check_acceleration(time_ms, 500)) is ReturnCode.OK:
            self.joint_acceleration_ms = time_ms
        return answer

    def set_line_acceleration(self, translation_ms: int, rotation_ms: int) -> ReturnCode:
        for time_ms in (translation_ms, rotation_ms):
            if (answer := _check_acceleration(time_ms, 250)) is not ReturnCode.OK:
                return answer
        self.line_acceleration_ms = (translation_ms, rotation_ms)
        return ReturnCode.OK

    def set_control_point_offset(self, offset: Sequence[float]) -> ReturnCode:
        """Set the offset of the control point from its pose at power-up; WRONG_STATE while the arm moves."""
        if not _are_finite(offset) or max(map(abs, offset[:3])) > 1000.0:
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            if self.is_moving:
                return ReturnCode.WRONG_STATE
            pose = _pose(offset)
            self.kinematics.offset, self.kinematics.offset_turn = pose.position, pose.rotation
            return ReturnCode.OK

    # ---- jogs ----

    def jog_joints(self, speeds: Sequence[float]) -> ReturnCode:
        if len(speeds) != ARM_JOINTS or not _are_finite(speeds):
            return ReturnCode.OUT_OF_RANGE
        wanted = np.radians(speeds)
        if np.any(np.abs(wanted) > self.max_speed * (1 + _TOLERANCE_DEG)):
            return ReturnCode.TOO_FAST
        with self._lock:
            if (answer := self._may_jog()) is ReturnCode.OK:
                self._jog, self._line_jog, self._is_idle = wanted, None, False
            return answer

    def jog_line(self, in_tool: bool, speeds: Sequence[float], redundancy_speed: float) -> ReturnCode:
        """Move the control point along and about the axes of its own frame or the arm's [mm/s, degrees/s]."""
        if not _are_finite([*speeds, redundancy_speed]):
            return ReturnCode.OUT_OF_RANGE
        linear, angular = np.array(speeds[:3]), np.array(speeds[3:])
        turning = max(float(np.linalg.norm(angular)), abs(redundancy_speed))
        if np.linalg.norm(linear) > MAX_LINE_MM_S + _TOLERANCE_DEG or turning > MAX_LINE_DEG_S + _TOLERANCE_DEG:
            return ReturnCode.TOO_FAST
        with self._lock:
            if (answer := self._may_jog()) is ReturnCode.OK:
                velocity = np.concatenate((linear / 1000.0, np.radians(angular)))
                self._jog, self._line_jog = None, (in_tool, velocity, math.radians(redundancy_speed))
                self._line_jog_due = 0.0
                self._is_idle = False
            return answer

    def _may_jog(self) -> ReturnCode:
        answer = self.may_move()
        if answer is ReturnCode.OK and self._motions:
            return ReturnCode.WRONG_STATE
        if answer is ReturnCode.OK:
            self._jog_until = self._latest.time + self._jog_timeout_ms / 1000.0
        return answer

    # ---- motions ----

    def move_joints(self, positions: Sequence[float], speed: float, is_relative: bool = False) -> ReturnCode:
        if len(positions) != ARM_JOINTS or not _are_finite([*positions, speed]) or speed <= 0.0:
            return ReturnCode.OUT_OF_RANGE
        if math.radians(speed) > self.max_speed.min() * (1 + _TOLERANCE_DEG):
            return ReturnCode.TOO_FAST
        with self._lock:
            if (answer := self._may_queue()) is not ReturnCode.OK:
                return answer
            start = self._end
            end = np.radians(positions) + (start if is_relative else 0.0)
            tolerance = math.radians(_TOLERANCE_DEG)
            if np.any(end < self.lower - tolerance) or np.any(end > self.upper + tolerance):
                return ReturnCode.OUT_OF_RANGE
            acceleration = float(self.max_speed.min()) / (self.joint_acceleration_ms / 1000.0)
            self._motions.append(_joint_motion(start, end, math.radians(speed), acceleration))
            self._is_idle = False
            return ReturnCode.OK

    def move_line(
        self,
        in_tool: bool,
        position: Sequence[float],
        redundancy: float,
        speed: tuple[float, float],
        is_relative: bool = False,
    ) -> ReturnCode:
        """Move straight, turning evenly, at `speed` [mm/s, degrees/s]. SPEED_WARNING where a joint limits the speed."""
        if not _are_finite([*position, redundancy, *speed]) or min(speed) <= 0.0:
            return ReturnCode.OUT_OF_RANGE
        if speed[0] > MAX_LINE_MM_S + _TOLERANCE_DEG or speed[1] > MAX_LINE_DEG_S + _TOLERANCE_DEG:
            return ReturnCode.TOO_FAST
        with self._lock:
            if (answer := self._may_queue()) is not ReturnCode.OK:
                return answer
            start = self._end
        # The line is solved without the lock, because it takes long and the arm moves meanwhile.
        first, first_redundancy = self.kinematics.pose(start), self.kinematics.redundancy(start)
        last = _target(first, _pose(position), in_tool, is_relative)
        last_redundancy = math.radians(redundancy) + (first_redundancy if in_tool or is_relative else 0.0)
        try:
            points, length_m, turn = self._line(start, first, last, last_redundancy)
        except Unreachable:
            return ReturnCode.OUT_OF_RANGE
        with self._lock:
            if (answer := self._may_queue()) is not ReturnCode.OK:
                return answer
            if self._end is not start and not np.array_equal(self._end, start):
                return ReturnCode.WRONG_STATE  # another client queued a motion meanwhile
            rate = _rate_limit(speed[0] / 1000.0, length_m, math.radians(speed[1]), turn)
            linear_m_s2 = MAX_LINE_MM_S / self.line_acceleration_ms[0]
            angular_rad_s2 = math.radians(MAX_LINE_DEG_S) * 1000.0 / self.line_acceleration_ms[1]
            acceleration = _rate_limit(linear_m_s2, length_m, angular_rad_s2, turn)
            max_rate = _max_line_rate(points, self.max_speed)
            self._motions.append(UnitMotion(points, min(rate, max_rate), acceleration))
            self._is_idle = False
            return ReturnCode.OK if rate <= max_rate else ReturnCode.SPEED_WARNING

    def _line(self, start: Floats, first: HandPose, last: HandPose, redundancy: float) -> tuple[Floats, float, float]:
        """Joints (n, 7) along a line, its length [m], and the larger rotation of hand and elbow [rad].

        Points are 5 mm and a degree apart, of very long lines more: there are at most 1000. Raises Unreachable."""
        first_redundancy = self.kinematics.redundancy(start)
        length_m, hand_turn = first.distance(last)
        elbow_turn = math.remainder(redundancy - first_redundancy, math.tau)
        turn = max(hand_turn, abs(elbow_turn))
        parts = min(1000, 1 + math.ceil(max(length_m / 0.005, turn / math.radians(1))))
        points = [start]
        for part in range(1, parts + 1):
            fraction = part / parts
            pose = _interpolated(first, last, fraction)
            joints = self.kinematics.joints_at(pose, first_redundancy + fraction * elbow_turn, points[-1])
            if np.abs(joints - points[-1]).max() > 0.2:  # the arm would leave the line between the points
                raise Unreachable(self.name, "a joint would have to jump to follow the line")
            points.append(joints)
        return np.array(points), length_m, turn

    @property
    def _end(self) -> Floats:
        """Joints (7,) at the end of the queue [rad]."""
        return self._motions[-1].end if self._motions else np.array([axis.position for axis in self._axes])

    def _may_queue(self) -> ReturnCode:
        answer = self.may_move()
        if answer is ReturnCode.OK and (self.is_jogging or (super().is_moving and not self._motions)):
            return ReturnCode.WRONG_STATE
        return ReturnCode.QUEUE_FULL if answer is ReturnCode.OK and len(self._motions) >= MAX_MOTIONS else answer

    # ---- in the dynamics thread ----

    def _move(self) -> None:
        if self.is_jogging and self._latest.time > self._jog_until:
            self._jog = self._line_jog = None
        acceleration = self.max_speed * (1000.0 / self.joint_acceleration_ms)
        if self._motions:
            positions, speeds = self._motions[0].step(self._is_paused)
            for axis, position, speed in zip(self._axes, positions.tolist(), speeds.tolist(), strict=True):
                axis.position, axis.speed = position, speed
            if self._motions[0].is_done:
                self._motions.popleft()
        elif self._jog is not None:
            self._step_axes(self._jog.tolist(), acceleration.tolist())
            if not self._jog.any() and not super().is_moving:
                self._jog = None
        elif self._line_jog is not None:
            if self._latest.time >= self._line_jog_due:
                self._line_jog_speeds = self._line_speeds(*self._line_jog).tolist()
                self._line_jog_due = self._latest.time + 0.01
            self._step_axes(self._line_jog_speeds, self.max_acceleration.tolist())
        else:
            self._brake_axes()

    def _line_speeds(self, in_tool: bool, velocity: Floats, redundancy_speed: float) -> Floats:
        """Joint speeds (7,) [rad/s]. The tightest limit slows all joints down in proportion, so that the line stays
        straight."""
        joints = np.array([axis.position for axis in self._axes])
        if in_tool:
            rotation = self.kinematics.pose(joints).rotation
            velocity = np.concatenate((rotation @ velocity[:3], rotation @ velocity[3:]))
        speeds = self.kinematics.joint_speeds(joints, velocity, redundancy_speed)
        room = np.where(speeds > 0.0, self.upper - joints, joints - self.lower)
        allowed = np.minimum(self.max_speed, np.sqrt(2.0 * self.max_acceleration * np.maximum(room, 0.0)))
        return np.asarray(speeds * min(1.0, float((allowed / np.maximum(np.abs(speeds), 1e-9)).min())))

    def _brake(self) -> None:
        super()._brake()
        self._motions.clear()
        self._jog = self._line_jog = None


def _check_acceleration(time_ms: int, min_ms: int) -> ReturnCode:
    if time_ms > 10_000:
        return ReturnCode.OUT_OF_RANGE
    return ReturnCode.OK if time_ms >= min_ms else ReturnCode.TOO_MUCH_ACCELERATION


def _are_finite(values: Sequence[float]) -> bool:
    return all(map(math.isfinite, values))


def _pose(position: Sequence[float]) -> HandPose:
    x, y, z = (millimetres / 1000.0 for millimetres in position[:3])
    roll, pitch, yaw = map(math.radians, position[3:])
    return HandPose(x, y, z, roll, pitch, yaw)


def _target(first: HandPose, position: HandPose, in_tool: bool, is_relative: bool) -> HandPose:
    """The pose of a target position in the arm's frame. In the hand's frame a position is always relative."""
    if in_tool:
        return HandPose.of(first.position + first.rotation @ position.position, first.rotation @ position.rotation)
    if is_relative:
        return HandPose.of(first.position + position.position, position.rotation @ first.rotation)
    return position


def _interpolated(first: HandPose, last: HandPose, fraction: float) -> HandPose:
    """On the line between two poses, turned about one axis."""
    rotation_vector = Rotation.from_matrix(first.rotation.T @ last.rotation).as_rotvec()
    rotation = first.rotation @ Rotation.from_rotvec(fraction * rotation_vector).as_matrix()
    return HandPose.of(first.position + fraction * (last.position - first.position), rotation)


def _rate_limit(linear: float, length_m: float, angular: float, turn: float) -> float:
    """Speeds (or accelerations) along a line as a rate of the fraction completed: the slower of the two."""
    return min(linear / max(length_m, 1e-9), angular / max(turn, 1e-9))


def _joint_motion(start: Floats, end: Floats, speed: float, acceleration: float) -> UnitMotion:
    """All joints begin and end together; the one that moves farthest has `speed` [rad/s]."""
    farthest = max(float(np.abs(end - start).max()), 1e-9)
    return UnitMotion(np.vstack([start, end]), speed / farthest, acceleration / farthest)


def _max_line_rate(points: Floats, max_joint_speed: Floats) -> float:
    """The highest rate [1/s] at which no joint exceeds its `max_joint_speed` (7,) [rad/s]."""
    steepest = np.abs(np.diff(points, axis=0)).max(axis=0) * (len(points) - 1)
    return float((max_joint_speed / np.maximum(steepest, 1e-9)).min())
