"""The virtual controller of a robot's joints, which follow their commands within the robot's limits.

It replaces the servos of an actual robot."""

from __future__ import annotations

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats


class VirtualController:
    """joints (n,): initial angles [rad]. Limits (n,): lower, upper [rad], speed [rad/s], acceleration [rad/s^2]."""

    def __init__(self, joints: Floats, lower: Floats, upper: Floats, speed: Floats, acceleration: Floats) -> None:
        self.joints, self.velocities = joints.copy(), np.zeros(len(joints))
        self._lower, self._upper, self._speed, self._acceleration = lower, upper, speed, acceleration
        self._target, self._target_velocities = joints.copy(), np.zeros(len(joints))
        self._until = np.inf

    def command(self, joints: Floats, velocities: Floats, until: float) -> None:
        """Set targets (n,) [rad] that advance at `velocities` (n,) [rad/s] until a time [s]; then the joints stop."""
        self._target, self._target_velocities = np.clip(joints, self._lower, self._upper), velocities.copy()
        self._until = until

    def stop(self) -> None:
        """Stop immediately, and hold the present angles."""
        self.velocities[:] = 0.0
        self.command(self.joints, self.velocities, np.inf)

    def advance(self, now: float, seconds: float) -> None:
        """Simulate `seconds` of time, which end at `now` [s]."""
        if seconds <= 0.0:
            return
        if now > self._until:
            self._target, self._until = self.joints.copy(), np.inf
            self._target_velocities = np.zeros(len(self.joints))
        self._target = np.clip(self._target + self._target_velocities * seconds, self._lower, self._upper)
        # A joint must be able to brake before its target.
        error = self._target - self.joints
        wanted = self._target_velocities + np.clip(20.0 * error, -self._speed, self._speed)  # a gain of 20 1/s
        braking = np.sqrt(2.0 * self._acceleration * np.abs(error)) + np.abs(self._target_velocities)
        limit = np.minimum(braking, self._speed)
        wanted = np.clip(wanted, -limit, limit)
        change = np.clip(wanted - self.velocities, -self._acceleration * seconds, self._acceleration * seconds)
        self.velocities += change
        joints = self.joints + self.velocities * seconds
        self.joints = np.clip(joints, self._lower, self._upper)
        self.velocities[joints != self.joints] = 0.0
