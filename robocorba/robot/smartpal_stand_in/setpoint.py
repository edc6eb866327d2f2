"""Setpoints that servos follow, limited in speed and acceleration."""

from __future__ import annotations

import math

from robocorba.robot.smartpal_stand_in.dynamics import STEP_S


class Setpoint:
    """A `position` and its `speed`, in any unit and that unit per second."""

    def __init__(self, position: float = 0.0, speed: float = 0.0) -> None:
        self.position, self.speed = position, speed

    def step_towards(self, target: float, max_speed: float, acceleration: float) -> None:
        """One step towards `target`; it stops there."""
        distance = target - self.position
        change = acceleration * STEP_S
        if abs(distance) <= change * STEP_S and abs(self.speed) <= change:
            self.position, self.speed = target, 0.0
            return
        wanted = math.copysign(min(max_speed, braking_speed(abs(distance), acceleration)), distance)
        self.step_at_velocity(wanted, acceleration)

    def step_at_velocity(self, wanted_speed: float, acceleration: float) -> None:
        """One step; the speed approaches `wanted_speed` within `acceleration`."""
        change = acceleration * STEP_S
        self.speed += min(max(wanted_speed - self.speed, -change), change)
        self.position += self.speed * STEP_S


def braking_speed(distance: float, deceleration: float) -> float:
    """The highest speed from which steps with this deceleration stop within `distance`."""
    half = deceleration * STEP_S / 2
    return math.sqrt(half * half + 2 * deceleration * distance) - half
