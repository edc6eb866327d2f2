"""A number that goes where it shall within limits of speed and acceleration: what every servo is told to follow."""

from __future__ import annotations

import math

from robocorba.smartpal.dynamics import STEP_S


class Glide:
    """`at`, and the `speed` at which it changes; any unit."""

    def __init__(self, at: float = 0.0, speed: float = 0.0) -> None:
        self.at, self.speed = at, speed

    def go(self, target: float, most_speed: float, acceleration: float) -> None:
        """A step towards `target`, to stand there in the end."""
        rest = target - self.at
        change = acceleration * STEP_S
        if abs(rest) <= change * STEP_S and abs(self.speed) <= change:
            self.at, self.speed = target, 0.0
            return
        wanted = math.copysign(min(most_speed, landing_speed(abs(rest), acceleration)), rest)
        self.run(wanted, acceleration)

    def run(self, wanted_speed: float, acceleration: float) -> None:
        """A step at `wanted_speed`, as soon as it has it."""
        change = acceleration * STEP_S
        self.speed += min(max(wanted_speed - self.speed, -change), change)
        self.at += self.speed * STEP_S


def landing_speed(rest: float, acceleration: float) -> float:
    """At most so fast, so that steps with this deceleration end where `rest` is over."""
    half = acceleration * STEP_S / 2
    return math.sqrt(half * half + 2 * acceleration * rest) - half
