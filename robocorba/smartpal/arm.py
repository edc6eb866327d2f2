"""An arm unit: jogs, and a queue of motions from joint to joint or along lines."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, ARM_JOINTS, Side
from robocorba.smartpal.arm_kinematics import ArmKinematics
from robocorba.smartpal.axes import AxesUnit
from robocorba.smartpal.codes import Answer
from robocorba.smartpal.dynamics import Dynamics
from robocorba.smartpal.motion import Motion, joint_motion, most_line_speed
from robocorba.smartpal.unit import JOG_TIMEOUT_MS, LEAST_JOG_TIMEOUT_MS, MOST_JOG_TIMEOUT_MS
from robocorba.spatial.grids import Floats

#: Motions that wait for their turn; ours.
MOST_MOTIONS = 32
#: Of lines, mm/s and degrees/s; ours.
MOST_LINE_MM_S, MOST_LINE_DEG_S = 700.0, 90.0
#: From standstill to the fastest at power-up, ms; ours.
ACCELERATION_MS = 1000
LEAST_JOINT_MS, LEAST_LINE_MS, MOST_MS = 500, 250, 10_000
#: A line is solved at points so near to each other, m and rad, at most so many.
_POINT_M, _POINT_RAD, _MOST_POINTS = 0.005, math.radians(1), 1000
#: A jog along a line is led so often, s.
LEAD_S = 0.01
#: Joints that go further from point to point leave the line.
_MOST_LEAP_RAD = 0.2
_SLACK_DEG = 1e-6


class Arm(AxesUnit):
    """Millimetres and degrees. Places are px, py, pz, rx, ry, rz; `in_tool` says whether in the hand's own frame."""

    def __init__(self, side: Side, dynamics: Dynamics) -> None:
        super().__init__("MnpL" if side is Side.LEFT else "MnpR", dynamics, ARM[side])
        self.kinematics = ArmKinematics(side)
        self._motions: deque[Motion] = deque()
        self._jog: Floats | None = None
        self._line_jog: tuple[bool, Floats, float] | None = None
        #: What a jog along a line told the joints last, and how long that holds.
        self._led: list[float] = []
        self._jog_until = self._led_until = 0.0
        self._jog_timeout_ms = JOG_TIMEOUT_MS
        self.joint_acceleration_ms = ACCELERATION_MS
        self.line_acceleration_ms = (ACCELERATION_MS, ACCELERATION_MS)

    # ---- what it is asked ----

    @property
    def is_jogging(self) -> bool:
        return self._jog is not None or self._line_jog is not None

    @property
    def is_moving(self) -> bool:
        return super().is_moving or bool(self._motions) or self.is_jogging

    @property
    def motion_rate(self) -> int:
        """How far the motion under way has come, percent."""
        with self._lock:
            return round(100 * self._motions[0].rate) if self._motions else 100

    def place(self, joints: Sequence[float]) -> list[float]:
        """px, py, pz, rx, ry, rz, and the redundancy, of joints (7,) in degrees."""
        angles = np.radians(joints)
        at = self.kinematics.place(angles)
        turns = (*at[3:], self.kinematics.redundancy(angles))
        return [*(1000.0 * way for way in at[:3]), *map(math.degrees, turns)]

    # ---- settings ----

    def set_jog_timeout(self, timeout_ms: int) -> Answer:
        if not LEAST_JOG_TIMEOUT_MS <= timeout_ms <= MOST_JOG_TIMEOUT_MS:
            return Answer.OUT_OF_RANGE
        self._jog_timeout_ms = timeout_ms
        return Answer.OK

    def set_joint_acceleration(self, time_ms: int) -> Answer:
        if (wrong := _check_acceleration(time_ms, LEAST_JOINT_MS)) is Answer.OK:
            self.joint_acceleration_ms = time_ms
        return wrong

    def set_line_acceleration(self, translation_ms: int, rotation_ms: int) -> Answer:
        for time_ms in (translation_ms, rotation_ms):
            if (wrong := _check_acceleration(time_ms, LEAST_LINE_MS)) is not Answer.OK:
                return wrong
        self.line_acceleration_ms = (translation_ms, rotation_ms)
        return Answer.OK

    def set_control_point_offset(self, offset: Sequence[float]) -> Answer:
        """Of the control point from where it is at power-up; not while the arm moves."""
        if not _are_finite(offset) or max(map(abs, offset[:3])) > 1000.0:
            return Answer.OUT_OF_RANGE
        with self._lock:
            if self.is_moving:
                return Answer.WRONG_STATE
            pose = _pose(offset)
            self.kinematics.offset, self.kinematics.offset_turn = pose.position, pose.rotation
            return Answer.OK

    # ---- jogs ----

    def jog_joints(self, speeds: Sequence[float]) -> Answer:
        if len(speeds) != ARM_JOINTS or not _are_finite(speeds):
            return Answer.OUT_OF_RANGE
        wanted = np.radians(speeds)
        if np.any(np.abs(wanted) > self.most_speed * (1 + _SLACK_DEG)):
            return Answer.TOO_FAST
        with self._lock:
            if (wrong := self._may_jog()) is Answer.OK:
                self._jog, self._line_jog, self._is_told = wanted, None, False
            return wrong

    def jog_line(self, in_tool: bool, speeds: Sequence[float], redundancy_speed: float) -> Answer:
        """The control point moves and turns along the axes of its own frame or that of the arm."""
        if not _are_finite([*speeds, redundancy_speed]):
            return Answer.OUT_OF_RANGE
        ways, turns = np.array(speeds[:3]), np.array(speeds[3:])
        turning = max(float(np.linalg.norm(turns)), abs(redundancy_speed))
        if np.linalg.norm(ways) > MOST_LINE_MM_S + _SLACK_DEG or turning > MOST_LINE_DEG_S + _SLACK_DEG:
            return Answer.TOO_FAST
        with self._lock:
            if (wrong := self._may_jog()) is Answer.OK:
                velocity = np.concatenate((ways / 1000.0, np.radians(turns)))
                self._jog, self._line_jog = None, (in_tool, velocity, math.radians(redundancy_speed))
                self._led_until = 0.0
                self._is_told = False
            return wrong

    def _may_jog(self) -> Answer:
        wrong = self.may_move()
        if wrong is Answer.OK and self._motions:
            return Answer.WRONG_STATE
        if wrong is Answer.OK:
            self._jog_until = self._seen.time + self._jog_timeout_ms / 1000.0
        return wrong

    # ---- motions ----

    def move_joints(self, positions: Sequence[float], speed: float, is_relative: bool = False) -> Answer:
        if len(positions) != ARM_JOINTS or not _are_finite([*positions, speed]) or speed <= 0.0:
            return Answer.OUT_OF_RANGE
        if math.radians(speed) > self.most_speed.min() * (1 + _SLACK_DEG):
            return Answer.TOO_FAST
        with self._lock:
            if (wrong := self._may_queue()) is not Answer.OK:
                return wrong
            start = self._end
            end = np.radians(positions) + (start if is_relative else 0.0)
            slack = math.radians(_SLACK_DEG)
            if np.any(end < self.lower - slack) or np.any(end > self.upper + slack):
                return Answer.OUT_OF_RANGE
            most = float(self.most_speed.min()) / (self.joint_acceleration_ms / 1000.0)
            self._motions.append(joint_motion(start, end, math.radians(speed), most))
            self._is_told = False
            return Answer.OK

    def move_line(
        self,
        in_tool: bool,
        position: Sequence[float],
        redundancy: float,
        speed: tuple[float, float],
        is_relative: bool = False,
    ) -> Answer:
        """Straight, turning evenly; `speed`: mm/s, degrees/s. SPEED_WARNING where a joint has to slow it down."""
        if not _are_finite([*position, redundancy, *speed]) or min(speed) <= 0.0:
            return Answer.OUT_OF_RANGE
        if speed[0] > MOST_LINE_MM_S + _SLACK_DEG or speed[1] > MOST_LINE_DEG_S + _SLACK_DEG:
            return Answer.TOO_FAST
        with self._lock:
            if (wrong := self._may_queue()) is not Answer.OK:
                return wrong
            start = self._end
        # Without the lock, as it takes a while; the arm goes on meanwhile.
        first, elbow = self.kinematics.place(start), self.kinematics.redundancy(start)
        last = _target(first, _pose(position), in_tool, is_relative)
        turned = math.radians(redundancy) + (elbow if in_tool or is_relative else 0.0)
        try:
            points, way_m, turn = self._line(start, first, last, turned)
        except Unreachable:
            return Answer.OUT_OF_RANGE
        with self._lock:
            if (wrong := self._may_queue()) is not Answer.OK:
                return wrong
            if self._end is not start and not np.array_equal(self._end, start):
                return Answer.WRONG_STATE  # somebody else was faster
            wanted = _per_way(speed[0] / 1000.0, way_m, math.radians(speed[1]), turn)
            most_m_s2 = MOST_LINE_MM_S / self.line_acceleration_ms[0]
            most_rad_s2 = math.radians(MOST_LINE_DEG_S) * 1000.0 / self.line_acceleration_ms[1]
            most = most_line_speed(points, self.most_speed)
            self._motions.append(Motion(points, min(wanted, most), _per_way(most_m_s2, way_m, most_rad_s2, turn)))
            self._is_told = False
            return Answer.OK if wanted <= most else Answer.SPEED_WARNING

    def _line(self, start: Floats, first: HandPose, last: HandPose, redundancy: float) -> tuple[Floats, float, float]:
        """Joints (n, 7) along a line, its length in m, and by how much it turns, the elbow included, in rad."""
        elbow = self.kinematics.redundancy(start)
        way_m, hand_turn = first.distance(last)
        elbow_turn = math.remainder(redundancy - elbow, math.tau)
        turn = max(hand_turn, abs(elbow_turn))
        parts = min(_MOST_POINTS, 1 + math.ceil(max(way_m / _POINT_M, turn / _POINT_RAD)))
        points = [start]
        for part in range(1, parts + 1):
            share = part / parts
            at = _between(first, last, share)
            joints = self.kinematics.joints_at(at, elbow + share * elbow_turn, points[-1])
            if np.abs(joints - points[-1]).max() > _MOST_LEAP_RAD:
                raise Unreachable(self.name, "the line can't be followed without a leap of a joint")
            points.append(joints)
        return np.array(points), way_m, turn

    @property
    def _end(self) -> Floats:
        """Where the last motion of the queue will end."""
        return self._motions[-1].end if self._motions else np.array([axis.at for axis in self._axes])

    def _may_queue(self) -> Answer:
        wrong = self.may_move()
        if wrong is Answer.OK and (self.is_jogging or (super().is_moving and not self._motions)):
            return Answer.WRONG_STATE
        return Answer.QUEUE_FULL if wrong is Answer.OK and len(self._motions) >= MOST_MOTIONS else wrong

    # ---- in the thread of the dynamics ----

    def _move(self) -> None:
        if self.is_jogging and self._seen.time > self._jog_until:
            self._jog = self._line_jog = None
        most = self.most_speed * (1000.0 / self.joint_acceleration_ms)
        if self._motions:
            places, speeds = self._motions[0].step(self._is_paused)
            for axis, place, speed in zip(self._axes, places.tolist(), speeds.tolist(), strict=True):
                axis.at, axis.speed = place, speed
            if self._motions[0].is_done:
                self._motions.popleft()
        elif self._jog is not None:
            self._run_axes(self._jog.tolist(), most.tolist())
            if not self._jog.any() and not super().is_moving:
                self._jog = None
        elif self._line_jog is not None:
            if self._seen.time >= self._led_until:
                self._led = self._line_speeds(*self._line_jog).tolist()
                self._led_until = self._seen.time + LEAD_S
            self._run_axes(self._led, self.most_acceleration.tolist())
        else:
            self._halt_axes()

    def _line_speeds(self, in_tool: bool, velocity: Floats, redundancy_speed: float) -> Floats:
        """Of the joints; all slow down as the one that can least, so that the line stays straight."""
        joints = np.array([axis.at for axis in self._axes])
        if in_tool:
            turn = self.kinematics.place(joints).rotation
            velocity = np.concatenate((turn @ velocity[:3], turn @ velocity[3:]))
        speeds = self.kinematics.joint_speeds(joints, velocity, redundancy_speed)
        room = np.where(speeds > 0.0, self.upper - joints, joints - self.lower)
        allowed = np.minimum(self.most_speed, np.sqrt(2.0 * self.most_acceleration * np.maximum(room, 0.0)))
        return np.asarray(speeds * min(1.0, float((allowed / np.maximum(np.abs(speeds), 1e-9)).min())))

    def _brake(self) -> None:
        super()._brake()
        self._motions.clear()
        self._jog = self._line_jog = None


def _check_acceleration(time_ms: int, least_ms: int) -> Answer:
    if time_ms > MOST_MS:
        return Answer.OUT_OF_RANGE
    return Answer.OK if time_ms >= least_ms else Answer.TOO_MUCH_ACCELERATION


def _are_finite(values: Sequence[float]) -> bool:
    return all(map(math.isfinite, values))


def _pose(position: Sequence[float]) -> HandPose:
    x, y, z = (way / 1000.0 for way in position[:3])
    roll, pitch, yaw = map(math.radians, position[3:])
    return HandPose(x, y, z, roll, pitch, yaw)


def _target(first: HandPose, position: HandPose, in_tool: bool, is_relative: bool) -> HandPose:
    """What a position says, in the frame of the arm. In the hand's own frame everything is relative to it."""
    if in_tool:
        return HandPose.of(first.position + first.rotation @ position.position, first.rotation @ position.rotation)
    if is_relative:
        return HandPose.of(first.position + position.position, position.rotation @ first.rotation)
    return position


def _between(first: HandPose, last: HandPose, share: float) -> HandPose:
    """On the line from one to the other, turned about one axis."""
    turn = first.rotation.T @ last.rotation
    angle = first.distance(last)[1]
    axis = _axis(turn, angle)
    position = first.position + share * (last.position - first.position)
    return HandPose.of(position, first.rotation @ _turn_about(axis, share * angle))


def _axis(turn: Floats, angle: float) -> Floats:
    if angle < 1e-9:
        return np.array([1.0, 0.0, 0.0])
    if angle > math.pi - 1e-6:  # half a turn: the axis is what the turn keeps
        values, vectors = np.linalg.eigh((turn + turn.T) / 2)
        return np.asarray(vectors[:, int(np.argmax(values))])
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.asarray(skew / np.linalg.norm(skew))


def _turn_about(axis: Floats, angle: float) -> Floats:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def _per_way(linear: float, way_m: float, angular: float, turn: float) -> float:
    """In whole ways a second: the slower of the two."""
    return min(linear / max(way_m, 1e-9), angular / max(turn, 1e-9))
