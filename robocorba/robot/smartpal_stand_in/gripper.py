"""A gripper unit: one axis; negative angles open it. Its arm supplies its power."""

from __future__ import annotations

from robocorba.robot.kinematics.smartpal import GRIP, Side
from robocorba.robot.smartpal_stand_in.axes import PositionUnit
from robocorba.robot.smartpal_stand_in.codes import ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import Dynamics
from robocorba.robot.smartpal_stand_in.unit import Unit


class StandInGripper(PositionUnit):
    """arm: supplies its power."""

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
