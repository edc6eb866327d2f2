"""Units of servo axes: what all of them share, and those that move to a position, the lumbar and the grippers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.robot.kinematics.smartpal import GRIP, JOINT_ACCELERATION, JOINT_LOWER, JOINT_SPEED, JOINT_UPPER, Side
from robocorba.robot.smartpal_stand_in.codes import ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import BASE_AXES, Dynamics
from robocorba.robot.smartpal_stand_in.setpoint import Setpoint, braking_speed
from robocorba.robot.smartpal_stand_in.unit import Unit

#: Tolerance at limits, because clients may send a rounded limit [degrees].
_TOLERANCE_DEG = 1e-6


class AxesUnit(Unit):
    """The axes at `rows` of the joints (18,). Orders are in degrees, attributes in rad."""

    def __init__(self, name: str, dynamics: Dynamics, rows: slice) -> None:
        super().__init__(name, dynamics)
        self._rows = rows
        self.lower, self.upper = JOINT_LOWER[rows], JOINT_UPPER[rows]
        self.max_speed, self.max_acceleration = JOINT_SPEED[rows], JOINT_ACCELERATION[rows]
        self._axes = [Setpoint(position) for position in dynamics.joints[rows].tolist()]

    @property
    def feedback(self) -> list[float]:
        """Positions of the axes, as their encoders measure them [degrees]."""
        return list(np.degrees(self._latest.joints[self._rows]).tolist())

    @property
    def command(self) -> list[float]:
        """Setpoints of the axes [degrees]."""
        with self._lock:
            return [math.degrees(axis.position) for axis in self._axes]

    @property
    def soft_limits(self) -> list[tuple[float, float]]:
        """(upper, lower) of each axis [degrees]."""
        upper, lower = np.degrees(self.upper).tolist(), np.degrees(self.lower).tolist()
        return list(zip(upper, lower, strict=True))

    @property
    def max_speed_deg(self) -> list[float]:
        return list(np.degrees(self.max_speed).tolist())

    @property
    def max_acceleration_deg(self) -> list[float]:
        return list(np.degrees(self.max_acceleration).tolist())

    @property
    def is_moving(self) -> bool:
        return any(axis.speed != 0.0 for axis in self._axes)

    def _move(self) -> None:
        """Advance the setpoints by one step; without orders the axes brake."""
        raise NotImplementedError

    def _drive(self) -> None:
        if self._is_idle:
            return
        self._move()
        self._is_idle = not self.is_moving
        self._dynamics.joints[self._rows] = [axis.position for axis in self._axes]
        self._dynamics.joint_velocities[self._rows] = [axis.speed for axis in self._axes]

    def _brake_axes(self) -> None:
        """One step of braking as hard as the axes can: ten times their maximum acceleration. Assumed."""
        for axis, limit in zip(self._axes, self.max_acceleration.tolist(), strict=True):
            axis.step_at_velocity(0.0, 10.0 * limit)

    def _step_axes(self, speeds: Sequence[float], accelerations: Sequence[float]) -> None:
        """One step at these speeds [rad/s], as far as the position limits allow."""
        limits = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        for axis, speed, acceleration, (lower, upper) in zip(self._axes, speeds, accelerations, limits, strict=True):
            min_speed = -braking_speed(max(0.0, axis.position - lower), acceleration)
            max_speed = braking_speed(max(0.0, upper - axis.position), acceleration)
            axis.step_at_velocity(min(max(speed, min_speed), max_speed), acceleration)

    def _is_stuck(self) -> bool:
        """Whether an axis is more than 4 degrees from its setpoint. Assumed."""
        wanted = np.array([axis.position for axis in self._axes])
        return bool(np.abs(wanted - self._latest.joints[self._rows]).max() > math.radians(4))

    def _brake(self) -> None:
        self._is_idle = False
        if self._is_stuck():  # restart at the measured positions, or the axes would jump when released
            self._axes = [Setpoint(position) for position in self._latest.joints[self._rows].tolist()]

    def _jam(self, on: bool) -> None:
        first = len(BASE_AXES) + self._rows.start
        self._dynamics.jam(slice(first, first + 1), on)


class PositionUnit(AxesUnit):
    """Axes that each move to a target position: those of the lumbar, which leans the trunk forward, and of grippers."""

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

    def move(self, positions: Sequence[float | None], speed: float, acceleration: float) -> ReturnCode:
        """Move each axis to its position [degrees], at `speed` [degrees/s] and `acceleration` [degrees/s^2].

        None: the axis keeps its target."""
        limits = zip(positions, self.soft_limits, strict=True)
        targets = [(target, upper, lower) for target, (upper, lower) in limits if target is not None]
        max_speed, max_acceleration = math.degrees(self.max_speed[0]), math.degrees(self.max_acceleration[0])
        with self._lock:
            if (answer := self.may_move()) is not ReturnCode.OK:
                return answer
            if not all(lower - _TOLERANCE_DEG <= target <= upper + _TOLERANCE_DEG for target, upper, lower in targets):
                return ReturnCode.OUT_OF_RANGE
            if not 0.0 < speed <= max_speed + _TOLERANCE_DEG:
                return ReturnCode.TOO_FAST
            if not 0.0 < acceleration <= max_acceleration + _TOLERANCE_DEG:
                return ReturnCode.TOO_MUCH_ACCELERATION
            self._targets = [
                former if target is None else math.radians(target)
                for target, former in zip(positions, self._targets, strict=True)
            ]
            self._speed, self._acceleration = math.radians(speed), math.radians(acceleration)
            self._is_idle = False
            return ReturnCode.OK

    def move_cooperative(self, lean: float, speed: float, acceleration: float) -> ReturnCode:
        """Lean the lumbar by `lean` in total; the lower axis, its first, takes as much of it as its limits allow."""
        upper, lower = self.soft_limits[0]
        first = min(max(lean, lower), upper)
        return self.move((first, lean - first), speed, acceleration)

    def _move(self) -> None:
        if self._is_paused:
            for axis in self._axes:
                axis.step_at_velocity(0.0, self._acceleration)
        elif all(target is None for target in self._targets):
            self._brake_axes()
        else:
            for number, (axis, target) in enumerate(zip(self._axes, self._targets, strict=True)):
                if target is None:
                    continue
                axis.step_towards(target, self._speed, self._acceleration)
                if axis.position == target:
                    self._targets[number] = None

    def _brake(self) -> None:
        super()._brake()
        self._targets = [None] * len(self._axes)


class StandInGripper(PositionUnit):
    """One axis; negative angles open it. arm: supplies its power."""

    def __init__(self, side: Side, dynamics: Dynamics, arm: Unit) -> None:
        super().__init__("GripperL" if side is Side.LEFT else "GripperR", dynamics, slice(GRIP[side], GRIP[side] + 1))
        self._arm = arm

    @property
    def is_power_on(self) -> bool:
        return self._arm.is_power_on

    @property
    def is_servo_on(self) -> bool:
        return self.is_power_on and super().is_servo_on

    def _drive(self) -> None:
        if self._servo_ready_at is not None and not self.is_power_on:
            self.servo_off()
        super()._drive()

    def power_on(self) -> ReturnCode:
        return ReturnCode.FAILED

    def power_off(self) -> ReturnCode:
        return ReturnCode.FAILED
