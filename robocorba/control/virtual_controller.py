"""The virtual controller of a robot's joints: they follow what they are told as fast as the joints of the robot can.

It takes the place of the servos of an actual robot; nothing of it knows how the commands came about."""

from __future__ import annotations

import numpy as np

from robocorba.spatial.grids import Floats

#: How stiffly a joint is led to where it shall be, 1/s.
GAIN = 20.0


class VirtualController:
    """joints (n,): where they begin, rad. lower, upper, speed, acceleration (n,): their limits, rad, rad/s, rad/s^2."""

    def __init__(self, joints: Floats, lower: Floats, upper: Floats, speed: Floats, acceleration: Floats) -> None:
        self.joints, self.velocities = joints.copy(), np.zeros(len(joints))
        self._lower, self._upper, self._speed, self._acceleration = lower, upper, speed, acceleration
        self._target, self._target_velocities = joints.copy(), np.zeros(len(joints))
        self._until = np.inf

    def command(self, joints: Floats, velocities: Floats, until: float) -> None:
        """Be there now, and move on at these velocities until a time; after that, stand."""
        self._target, self._target_velocities = np.clip(joints, self._lower, self._upper), velocities.copy()
        self._until = until

    def stop(self) -> None:
        """Stand at once: servos hold what they have."""
        self.velocities[:] = 0.0
        self.command(self.joints, self.velocities, np.inf)

    def advance(self, now: float, seconds: float) -> None:
        """Let time pass until `now`."""
        if seconds <= 0.0:
            return
        if now > self._until:
            self._target, self._until = self.joints.copy(), np.inf
            self._target_velocities = np.zeros(len(self.joints))
        self._target = np.clip(self._target + self._target_velocities * seconds, self._lower, self._upper)
        # No faster than what it can still brake from before it is there.
        missing = self._target - self.joints
        wanted = self._target_velocities + np.clip(GAIN * missing, -self._speed, self._speed)
        most = np.sqrt(2.0 * self._acceleration * np.abs(missing)) + np.abs(self._target_velocities)
        wanted = np.clip(wanted, -np.minimum(most, self._speed), np.minimum(most, self._speed))
        change = np.clip(wanted - self.velocities, -self._acceleration * seconds, self._acceleration * seconds)
        self.velocities += change
        joints = self.joints + self.velocities * seconds
        self.joints = np.clip(joints, self._lower, self._upper)
        self.velocities[joints != self.joints] = 0.0
