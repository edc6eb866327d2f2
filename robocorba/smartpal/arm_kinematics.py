"""Where an arm's control point is, in the arm's own frame; which joints bring it along a line, and how fast.

The frame ORIGINAL has its origin in the shoulder; the lumbar does not count. The redundancy of seven joints is how far
the elbow is turned out, about the line from shoulder to wrist: from below the line where the arm reaches ahead, from
behind it where it hangs."""

from __future__ import annotations

import math
import threading

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.kinematics.body import Body
from robocorba.kinematics.chain import chains_of, locate
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.kinematics.model import SHOULDER_M
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, ARM_JOINTS, JOINTS, LUMBAR, Side
from robocorba.spatial.grids import Floats

#: Rows of the lines of an arm's joints, behind those of the lumbar.
_LUMBAR_JOINTS = LUMBAR.stop - LUMBAR.start
_SHOULDER, _ELBOW, _WRIST = _LUMBAR_JOINTS, _LUMBAR_JOINTS + 3, _LUMBAR_JOINTS + 5
_MOST_TURNS, _NEAR_RAD, _NUDGE = 25, 1e-4, 1e-5
#: Near a singular posture joints move no faster than this damping lets them.
_DAMPING = 0.02
#: Where an elbow that is not turned out points to. Nothing else defines it where an arm reaches along this line.
_DOWN_BACK = np.array([-1.0, 0.0, -1.0]) / math.sqrt(2)


class ArmKinematics:
    """Of the arm of one side; joints are (7,), rad. Any thread may use it."""

    def __init__(self, side: Side) -> None:
        self._side, self._hand = side, tuple(Side).index(side)
        body = Body()
        self._inverse, self._chains = InverseKinematics(body), chains_of(body.model)
        self._outwards = 1.0 if side is Side.LEFT else -1.0
        self._shoulder = np.array([SHOULDER_M[0], self._outwards * SHOULDER_M[1], SHOULDER_M[2]])
        self._lock = threading.Lock()
        #: The control point from where it is at power-up, in the hand's frame.
        self.offset, self.offset_turn = np.zeros(3), np.eye(3)

    def place(self, joints: Floats) -> HandPose:
        """Of the control point, in the frame ORIGINAL."""
        position, rotation, _ = self._locate(joints)
        return HandPose.of(position + rotation @ self.offset - self._shoulder, rotation @ self.offset_turn)

    def redundancy(self, joints: Floats) -> float:
        """Rad; plus outwards."""
        return self._redundancy(self._locate(joints)[2])

    def joints_at(self, place: HandPose, redundancy: float, seed: Floats) -> Floats:
        """Joints near `seed` with the control point at a place and the elbow turned. Raises Unreachable."""
        rotation = place.rotation @ self.offset_turn.T
        target = HandPose.of(place.position + self._shoulder - rotation @ self.offset, rotation)
        joints = self._solve(target, seed)
        for _ in range(_MOST_TURNS):
            wrong = math.remainder(redundancy - self.redundancy(joints), math.tau)
            if abs(wrong) < _NEAR_RAD:
                return joints
            turn, gain = self._elbow_turn(joints)
            joints = self._solve(target, joints + turn * max(-0.2, min(0.2, wrong / gain)))
        raise Unreachable(self._side.value, f"the elbow can't be turned by {math.degrees(redundancy):.1f} deg there")

    def joint_speeds(self, joints: Floats, velocity: Floats, redundancy_speed: float) -> Floats:
        """So that the control point moves (6,) m/s, rad/s along and about the axes of ORIGINAL, and the elbow turns."""
        jacobian = self._jacobian(joints)
        speeds = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _DAMPING**2 * np.eye(6), velocity)
        if redundancy_speed:
            turn, gain = self._elbow_turn(joints)
            speeds = speeds + turn * redundancy_speed / gain
        return np.asarray(speeds)

    # ---- one arm among the joints of the robot ----

    def _whole(self, joints: Floats) -> Floats:
        whole = np.zeros(len(JOINTS))
        whole[ARM[self._side]] = joints
        return whole

    def _locate(self, joints: Floats) -> tuple[Floats, Floats, Floats]:
        lines = np.zeros((_LUMBAR_JOINTS + ARM_JOINTS, 6))
        position, rotation = locate(self._chains, self._hand, self._whole(joints), lines)
        return position, rotation, lines

    def _solve(self, target: HandPose, seed: Floats) -> Floats:
        with self._lock:
            solved = self._inverse.solve(self._side, target, self._whole(seed), keeps_clear=False, leaps=False)
        return solved[ARM[self._side]]

    def _jacobian(self, joints: Floats) -> Floats:
        """(6, 7)."""
        position, rotation, lines = self._locate(joints)
        axes, points = lines[_LUMBAR_JOINTS:, :3], lines[_LUMBAR_JOINTS:, 3:]
        return np.vstack([np.cross(axes, position + rotation @ self.offset - points).T, axes.T])

    def _elbow_turn(self, joints: Floats) -> tuple[Floats, float]:
        """What the joints do when only the elbow turns (7,), and by how much it then does."""
        turn = np.linalg.svd(self._jacobian(joints))[2][-1]
        change = self.redundancy(joints + _NUDGE * turn) - self.redundancy(joints)
        gain = math.remainder(change, math.tau) / _NUDGE
        return turn, math.copysign(max(abs(gain), 0.1), gain)

    def _redundancy(self, lines: Floats) -> float:
        shoulder, elbow, wrist = (lines[row, 3:] for row in (_SHOULDER, _ELBOW, _WRIST))
        along = wrist - shoulder
        along = along / np.linalg.norm(along)
        inwards = _DOWN_BACK - (_DOWN_BACK @ along) * along
        inwards = inwards / max(float(np.linalg.norm(inwards)), 1e-9)
        outwards = self._outwards * np.cross(along, inwards)
        out = elbow - shoulder
        return math.atan2(float(out @ outwards), float(out @ inwards))
