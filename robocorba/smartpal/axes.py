"""What arms, lumbar and grippers share: axes that servos hold, brakes, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.kinematics.smartpal import ACCELERATION, LOWER, SPEED, UPPER
from robocorba.smartpal.codes import Answer
from robocorba.smartpal.dynamics import BASE, Dynamics
from robocorba.smartpal.glide import Glide, landing_speed
from robocorba.smartpal.unit import Unit

#: Axes brake so much harder than they move; ours.
BRAKE = 10.0
#: An axis that is so far from where it shall be is stuck, rad; ours.
FOLLOWING_LIMIT_RAD = math.radians(4)
#: Who asks for a limit itself may have rounded it, degrees.
_SLACK_DEG = 1e-6


class AxesUnit(Unit):
    """Axes at `rows` of the joints (18,). Angles of orders are degrees."""

    def __init__(self, name: str, dynamics: Dynamics, rows: slice) -> None:
        super().__init__(name, dynamics)
        self._rows = rows
        self.lower, self.upper = LOWER[rows], UPPER[rows]
        self.most_speed, self.most_acceleration = SPEED[rows], ACCELERATION[rows]
        self._axes = [Glide(at) for at in dynamics.joints[rows].tolist()]

    @property
    def feedback(self) -> list[float]:
        """Where the axes are, degrees, as their encoders say."""
        return list(np.degrees(self._seen.joints[self._rows]).tolist())

    @property
    def command(self) -> list[float]:
        """Where they shall be now."""
        with self._lock:
            return [math.degrees(axis.at) for axis in self._axes]

    @property
    def soft_limits(self) -> list[tuple[float, float]]:
        """Upper and lower of each axis, degrees."""
        upper, lower = np.degrees(self.upper).tolist(), np.degrees(self.lower).tolist()
        return list(zip(upper, lower, strict=True))

    @property
    def most_speed_deg(self) -> list[float]:
        return list(np.degrees(self.most_speed).tolist())

    @property
    def most_acceleration_deg(self) -> list[float]:
        return list(np.degrees(self.most_acceleration).tolist())

    @property
    def is_moving(self) -> bool:
        return any(axis.speed != 0.0 for axis in self._axes)

    def _move(self) -> None:
        """The next step of the axes; they brake where nothing was ordered."""
        raise NotImplementedError

    def _drive(self) -> None:
        if self._is_told:
            return
        self._move()
        self._is_told = not self.is_moving
        self._dynamics.joints[self._rows] = [axis.at for axis in self._axes]
        self._dynamics.joint_velocities[self._rows] = [axis.speed for axis in self._axes]

    def _halt_axes(self) -> None:
        """A step as hard as they can."""
        for axis, most in zip(self._axes, self.most_acceleration.tolist(), strict=True):
            axis.run(0.0, BRAKE * most)

    def _run_axes(self, speeds: Sequence[float], accelerations: Sequence[float]) -> None:
        """A step at these speeds, rad/s, as far as limits allow."""
        limits = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        for axis, speed, acceleration, (lower, upper) in zip(self._axes, speeds, accelerations, limits, strict=True):
            least = -landing_speed(max(0.0, axis.at - lower), acceleration)
            most = landing_speed(max(0.0, upper - axis.at), acceleration)
            axis.run(min(max(speed, least), most), acceleration)

    def _is_stuck(self) -> bool:
        wanted = np.array([axis.at for axis in self._axes])
        return bool(np.abs(wanted - self._seen.joints[self._rows]).max() > FOLLOWING_LIMIT_RAD)

    def _brake(self) -> None:
        self._is_told = False
        if self._is_stuck():  # it must not leap when it is free again
            self._axes = [Glide(at) for at in self._seen.joints[self._rows].tolist()]

    def _jam(self, on: bool) -> None:
        first = len(BASE) + self._rows.start
        self._dynamics.jam(slice(first, first + 1), on)


class PositionUnit(AxesUnit):
    """Axes that each go to a target: the lumbar and the grippers."""

    def __init__(self, name: str, dynamics: Dynamics, rows: slice) -> None:
        super().__init__(name, dynamics, rows)
        self._targets: list[float | None] = [None] * len(self._axes)
        self._speed = self._acceleration = 0.0

    @property
    def is_moving(self) -> bool:
        return super().is_moving or any(target is not None for target in self._targets)

    @property
    def is_jogging(self) -> bool:
        return False

    def move(self, positions: Sequence[float | None], speed: float, acceleration: float) -> Answer:
        """Each axis to its position, degrees, None where it is to stay on its way; degrees/s, degrees/s^2."""
        limits = zip(positions, self.soft_limits, strict=True)
        wanted = [(at, upper, lower) for at, (upper, lower) in limits if at is not None]
        most_speed, most_acceleration = math.degrees(self.most_speed[0]), math.degrees(self.most_acceleration[0])
        with self._lock:
            if (wrong := self.may_move()) is not Answer.OK:
                return wrong
            if not all(lower - _SLACK_DEG <= at <= upper + _SLACK_DEG for at, upper, lower in wanted):
                return Answer.OUT_OF_RANGE
            if not 0.0 < speed <= most_speed + _SLACK_DEG:
                return Answer.TOO_FAST
            if not 0.0 < acceleration <= most_acceleration + _SLACK_DEG:
                return Answer.TOO_MUCH_ACCELERATION
            self._targets = [
                before if at is None else math.radians(at) for at, before in zip(positions, self._targets, strict=True)
            ]
            self._speed, self._acceleration = math.radians(speed), math.radians(acceleration)
            self._is_told = False
            return Answer.OK

    def _move(self) -> None:
        if self._is_paused:
            for axis in self._axes:
                axis.run(0.0, self._acceleration)
        elif all(target is None for target in self._targets):
            self._halt_axes()
        else:
            for number, (axis, target) in enumerate(zip(self._axes, self._targets, strict=True)):
                if target is None:
                    continue
                axis.go(target, self._speed, self._acceleration)
                if axis.at == target:
                    self._targets[number] = None

    def _brake(self) -> None:
        super()._brake()
        self._targets = [None] * len(self._axes)
