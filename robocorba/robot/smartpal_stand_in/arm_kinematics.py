"""Forward, inverse and differential kinematics of an arm's control point in the arm's own frame.

The frame ORIGINAL has its origin in the shoulder; the lumbar is taken as upright. The redundancy of the seven joints
is the angle by which the elbow is turned outwards about the line from shoulder to wrist. It is zero with the elbow
below that line where the arm reaches forward, and behind it where the arm hangs."""

from __future__ import annotations

import math
import threading

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.chain import chains, locate
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.model import SHOULDER_M
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, ARM_JOINTS, JOINTS, LUMBAR, Side

#: Number of the first rows of joint axes in a kinematic chain: the lumbar's, before the arm's.
_LUMBAR_JOINTS = LUMBAR.stop - LUMBAR.start
#: Direction of an elbow with redundancy 0. The redundancy is undefined for an arm that reaches along this line.
_DOWN_BACK = np.array([-1.0, 0.0, -1.0]) / math.sqrt(2)


class ArmKinematics:
    """The arm of one side; `joints` are (7,) [rad]. Any thread may use it."""

    def __init__(self, side: Side) -> None:
        self._side, self._hand = side, tuple(Side).index(side)
        self._inverse, self._chains = InverseKinematics(), chains()
        self._outwards = 1.0 if side is Side.LEFT else -1.0
        self._shoulder = np.array([SHOULDER_M[0], self._outwards * SHOULDER_M[1], SHOULDER_M[2]])
        self._lock = threading.Lock()
        #: Offset of the control point from its pose at power-up, in the hand's frame.
        self.offset, self.offset_turn = np.zeros(3), np.eye(3)

    def pose(self, joints: Floats) -> HandPose:
        """The control point's pose in the frame ORIGINAL."""
        position, rotation, _ = self._locate(joints)
        return HandPose.of(position + rotation @ self.offset - self._shoulder, rotation @ self.offset_turn)

    def redundancy(self, joints: Floats) -> float:
        """The redundancy [rad]; positive outwards."""
        return self._redundancy(self._locate(joints)[2])

    def joints_at(self, pose: HandPose, redundancy: float, seed: Floats) -> Floats:
        """Joints near `seed` with the control point at `pose` and this redundancy. Raises Unreachable."""
        rotation = pose.rotation @ self.offset_turn.T
        target = HandPose.of(pose.position + self._shoulder - rotation @ self.offset, rotation)
        joints = self._solve(target, seed)
        for _ in range(25):
            error = math.remainder(redundancy - self.redundancy(joints), math.tau)
            if abs(error) < 1e-4:
                return joints
            turn, gain = self._null_motion(joints)
            joints = self._solve(target, joints + turn * max(-0.2, min(0.2, error / gain)))
        raise Unreachable(self._side.value, f"no posture there has a redundancy of {math.degrees(redundancy):.1f} deg")

    def joint_speeds(self, joints: Floats, velocity: Floats, redundancy_speed: float) -> Floats:
        """Joint speeds (7,) [rad/s] for a velocity (6,) of the control point in ORIGINAL [m/s, rad/s] and a speed of
        the redundancy [rad/s]. Damped least squares (Nakamura and Hanafusa 1986) with a constant damping of 0.02,
        assumed, which limits joint speeds near singular postures."""
        jacobian = self._jacobian(joints)
        speeds = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 0.02**2 * np.eye(6), velocity)
        if redundancy_speed:
            turn, gain = self._null_motion(joints)
            speeds = speeds + turn * redundancy_speed / gain
        return np.asarray(speeds)

    # ---- one arm among the joints of the robot ----

    def _all_joints(self, joints: Floats) -> Floats:
        all_joints = np.zeros(len(JOINTS))
        all_joints[ARM[self._side]] = joints
        return all_joints

    def _locate(self, joints: Floats) -> tuple[Floats, Floats, Floats]:
        lines = np.zeros((_LUMBAR_JOINTS + ARM_JOINTS, 6))
        position, rotation = locate(self._chains, self._hand, self._all_joints(joints), lines)
        return position, rotation, lines

    def _solve(self, target: HandPose, seed: Floats) -> Floats:
        with self._lock:
            solved = self._inverse.solve(
                {self._side: target}, self._all_joints(seed), avoid_collisions=False, allow_restarts=False
            )
        return solved[ARM[self._side]]

    def _jacobian(self, joints: Floats) -> Floats:
        """The Jacobian (6, 7) of the control point."""
        position, rotation, lines = self._locate(joints)
        axes, points = lines[_LUMBAR_JOINTS:, :3], lines[_LUMBAR_JOINTS:, 3:]
        return np.vstack([np.cross(axes, position + rotation @ self.offset - points).T, axes.T])

    def _null_motion(self, joints: Floats) -> tuple[Floats, float]:
        """A unit motion of the joints (7,) that turns only the elbow, and the redundancy's derivative along it."""
        turn = np.linalg.svd(self._jacobian(joints))[2][-1]
        step = 1e-5
        change = self.redundancy(joints + step * turn) - self.redundancy(joints)
        gain = math.remainder(change, math.tau) / step
        return turn, math.copysign(max(abs(gain), 0.1), gain)

    def _redundancy(self, lines: Floats) -> float:
        shoulder, elbow, wrist = lines[_LUMBAR_JOINTS + np.array([0, 3, 5]), 3:]
        along = wrist - shoulder
        along = along / np.linalg.norm(along)
        inwards = _DOWN_BACK - (_DOWN_BACK @ along) * along
        inwards = inwards / max(float(np.linalg.norm(inwards)), 1e-9)
        outwards = self._outwards * np.cross(along, inwards)
        out = elbow - shoulder
        return math.atan2(float(out @ outwards), float(out @ inwards))
