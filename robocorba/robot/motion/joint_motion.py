"""Motions of the joints: synchronously and smoothly from posture to posture, within the joints' limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.motion.motion import MotionCommand
from robocorba.robot.motion.robot_state import RobotState

#: Force of a finger for each radian between its target and its position [N/rad]; our assumption.
FINGER_N_PER_RAD = 100.0
#: Time for joints that lag behind the trajectory [s]; after it, the tolerance of the last posture is three times as
#: wide.
SETTLE_S = 3.0


class JointMotion:
    """Moves joints along waypoints (k, n) [rad], of which the first is the joints' present target.

    names, speed (n,) [rad/s] and acceleration (n,) [rad/s^2]: of the joints. seconds: least duration. watched: joints
    that must reach the last waypoint, by default all; gripping fingers need not."""

    def __init__(
        self,
        waypoints: Floats,
        names: Sequence[str],
        speed: Floats,
        acceleration: Floats,
        seconds: float = 0.0,
        watched: Sequence[int] | None = None,
    ) -> None:
        self._waypoints, self._names = np.atleast_2d(waypoints), names
        self._watched = list(range(len(names))) if watched is None else list(watched)
        steps = len(self._waypoints) - 1
        slopes = np.abs(np.diff(self._waypoints, axis=0)) * steps
        steepest = slopes.max(axis=0) if steps else np.zeros(len(names))
        # The maxima of the first and second derivative of the quintic polynomial of `_at` in 1 s are 1.875 and
        # 10/sqrt(3). A motion uses 0.45 of the speed limits, 40 deg/s, from which arms stop within 0.1 s, and 0.7 of
        # the acceleration limits; the rest compensates for lag.
        self.seconds = max(
            seconds,
            float((1.875 * steepest / (0.45 * speed)).max()),
            float(np.sqrt(10.0 / math.sqrt(3.0) * steepest / (0.7 * acceleration)).max()),
        )

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        if elapsed_s >= self.seconds:
            missing = np.abs(state.joints - self._waypoints[-1])[self._watched]
            # By 0.1 degrees a joint moves a hand 0.7 m away by 1.2 mm.
            if not len(missing) or missing.max() <= math.radians(0.1):
                return None
            if elapsed_s > self.seconds + SETTLE_S:
                if missing.max() <= math.radians(0.3):
                    return None
                worst = self._watched[int(missing.argmax())]
                raise MotionFailed(f"{self._names[worst]} is {math.degrees(missing.max()):.1f} deg from its target")
            return MotionCommand(joints=self._waypoints[-1], joint_velocities=np.zeros(len(self._names)))
        joints, velocities = self._at(elapsed_s)
        return MotionCommand(joints=joints, joint_velocities=velocities)

    def _at(self, elapsed_s: float) -> tuple[Floats, Floats]:
        """Joint angles and velocities on a quintic polynomial, which is at rest at both ends."""
        t = elapsed_s / self.seconds
        share = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
        rate = 30.0 * t * t * (1.0 - t) ** 2 / self.seconds
        steps = len(self._waypoints) - 1
        step = min(int(share * steps), steps - 1)
        slope = (self._waypoints[step + 1] - self._waypoints[step]) * steps
        return self._waypoints[step] + slope * (share - step / steps), slope * rate


class GripMotion(JointMotion):
    """Moves fingers, joints of these numbers, to their targets. With `force_n` [N] they stop at the first object and
    press on it with this force."""

    def __init__(
        self,
        waypoints: Floats,
        names: Sequence[str],
        speed: Floats,
        acceleration: Floats,
        fingers: Sequence[int],
        force_n: float | None = None,
    ) -> None:
        watched = () if force_n is not None else fingers
        super().__init__(waypoints, names, speed, acceleration, watched=watched)
        self._fingers, self._force_n = list(fingers), force_n
        self._contact_joints: Floats | None = None
        self._contact_at = self._stationary_since = 0.0

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        if self._contact_joints is not None:
            hold = MotionCommand(joints=self._contact_joints, joint_velocities=np.zeros(len(self._contact_joints)))
            return hold if elapsed_s < self._contact_at + 0.1 else None  # it presses for this time [s]
        command = super().command(state, elapsed_s)
        if command is None or command.joints is None or self._force_n is None:
            return command
        lead = self._force_n / FINGER_N_PER_RAD
        joints, measured = command.joints.copy(), state.joints[self._fingers]
        lag = np.abs(joints[self._fingers] - measured).max()
        joints[self._fingers] = np.clip(joints[self._fingers], measured - lead, measured + lead)
        # Fingers slower than 0.05 rad/s for 0.15 s touch an object; earlier, one may only not have started yet.
        if lag < lead or np.abs(state.joint_velocities[self._fingers]).max() >= 0.05:
            self._stationary_since = elapsed_s
        elif elapsed_s - self._stationary_since >= 0.15:
            self._contact_joints, self._contact_at = joints, elapsed_s
        return command._replace(joints=joints)
