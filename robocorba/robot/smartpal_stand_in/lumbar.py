"""The lumbar unit: two axes that lean the trunk forward."""

from __future__ import annotations

from robocorba.robot.kinematics.smartpal import LUMBAR
from robocorba.robot.smartpal_stand_in.axes import PositionUnit
from robocorba.robot.smartpal_stand_in.codes import ReturnCode
from robocorba.robot.smartpal_stand_in.dynamics import Dynamics


class StandInLumbar(PositionUnit):
    """Angles in degrees, lower axis first."""

    def __init__(self, dynamics: Dynamics) -> None:
        super().__init__("Lumbar", dynamics, LUMBAR)

    def move_cooperative(self, lean: float, speed: float, acceleration: float) -> ReturnCode:
        """Lean the trunk by `lean` in total; the lower axis takes as much of it as its limits allow."""
        upper, lower = self.soft_limits[0]
        first = min(max(lean, lower), upper)
        return self.move((first, lean - first), speed, acceleration)
