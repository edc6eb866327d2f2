"""How joints move: all at once from one posture to another, smoothly, no faster than each of them can."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.errors.robots import MotionFailed
from robocorba.motion.motion import Wish
from robocorba.motion.robot_state import RobotState
from robocorba.spatial.grids import Floats

#: What a finger presses with for each rad that it is led beyond where it is, N; ours.
FINGER_N_PER_RAD = 100.0
#: How near is there, rad: by so much a joint moves a hand 0.7 m away by 1.2 mm. Joints have so long for the rest of
#: their way, s; after that this is near enough, rad.
THERE_RAD = math.radians(0.1)
SETTLE_S, NEAR_RAD = 3.0, math.radians(0.3)
#: A finger that moves slower for so long has met something, rad/s and s; then it presses on it for so long, s.
STILL_RAD_S, MET_S, HOLD_S = 0.05, 0.15, 0.1
#: Of joints' acceleration and speed a motion uses so much: what is left makes up for what lags, and arms that move no
#: faster than this, 40 deg/s, stand within 0.1 s of a stop.
STRENGTH, PACE = 0.7, 0.45
#: Greatest first and second derivative of the quintic that goes from 0 to 1 in 1 s.
_FASTEST, _STRONGEST = 1.875, 10.0 / math.sqrt(3.0)


class JointMotion:
    """waypoints (k, n): postures to go through, rad; the first one is where the joints are told to be now.

    names, speed (n,) and acceleration (n,): of the joints, rad/s and rad/s^2. seconds: how long it shall take; it
    takes longer where it must. watched: joints that have to get there; gripping fingers may not."""

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
        self.seconds = max(
            seconds,
            float((_FASTEST * steepest / (PACE * speed)).max()),
            float(np.sqrt(_STRONGEST * steepest / (STRENGTH * acceleration)).max()),
        )

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        if elapsed_s >= self.seconds:
            missing = np.abs(state.joints - self._waypoints[-1])[self._watched]
            if not len(missing) or missing.max() <= THERE_RAD:
                return None
            if elapsed_s > self.seconds + SETTLE_S:
                if missing.max() <= NEAR_RAD:
                    return None
                worst = self._watched[int(missing.argmax())]
                raise MotionFailed(
                    f"{self._names[worst]} is {math.degrees(missing.max()):.1f} deg from where it shall be"
                )
            return Wish(joints=self._waypoints[-1], joint_velocities=np.zeros(len(self._names)))
        return Wish(joints=self._at(elapsed_s)[0], joint_velocities=self._at(elapsed_s)[1])

    def _at(self, elapsed_s: float) -> tuple[Floats, Floats]:
        """Joints and their velocities."""
        t = elapsed_s / self.seconds
        share = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
        rate = 30.0 * t * t * (1.0 - t) ** 2 / self.seconds
        steps = len(self._waypoints) - 1
        step = min(int(share * steps), steps - 1)
        slope = (self._waypoints[step + 1] - self._waypoints[step]) * steps
        return self._waypoints[step] + slope * (share - step / steps), slope * rate


class GripMotion(JointMotion):
    """Fingers to where they shall be. With a force, N, they stop where they meet something and press on it so hard."""

    def __init__(
        self,
        joints: Floats,
        wanted: Floats,
        fingers: Sequence[int],
        names: Sequence[str],
        speed: Floats,
        acceleration: Floats,
        force_n: float | None = None,
    ) -> None:
        watched = () if force_n is not None else fingers
        super().__init__(np.array([joints, wanted]), names, speed, acceleration, 0.0, watched)
        self._fingers, self._force_n, self._names = list(fingers), force_n, names
        self._met: Floats | None = None
        self._met_at = self._still_since = 0.0

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        if self._met is not None:
            still = Wish(joints=self._met, joint_velocities=np.zeros(len(self._met)))
            return still if elapsed_s < self._met_at + HOLD_S else None
        wish = super().wish(state, elapsed_s)
        if wish is None or wish.joints is None or self._force_n is None:
            return wish
        lead = self._force_n / FINGER_N_PER_RAD
        joints, here = wish.joints.copy(), state.joints[self._fingers]
        lag = np.abs(joints[self._fingers] - here).max()
        joints[self._fingers] = np.clip(joints[self._fingers], here - lead, here + lead)
        if lag < lead or np.abs(state.joint_velocities[self._fingers]).max() >= STILL_RAD_S:
            self._still_since = elapsed_s
        elif elapsed_s - self._still_since >= MET_S:  # else a finger may just not have started yet
            self._met, self._met_at = joints, elapsed_s
        return wish._replace(joints=joints)
