"""A SmartPal, virtual or actual: one method for each movement that icons consist of.

Each method returns when the movement is done. It raises MotionFailed if the robot did not reach its target, RobotLost
and IllegalOrder if it can't move, and the error with which its `execution` is interrupted."""

from __future__ import annotations

from robocorba.collision_avoidance.neighbours import Nearby
from robocorba.control.arms import ArmMovements
from robocorba.control.base import BaseMovements
from robocorba.control.execution_control import CHECK_INTERVAL_S
from robocorba.control.high_controller import HighController
from robocorba.control.sensors import Sensors
from robocorba.control.session import BuildingSession
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.programs.base_checks import Planner


class Robot(BaseMovements, ArmMovements):
    """nearby: other robots and obstacles; without it the robot does not give way. check_interval_s: see
    ExecutionControl."""

    def __init__(
        self,
        controller: HighController,
        session: BuildingSession,
        sensors: Sensors,
        kinematics: InverseKinematics,
        planner: Planner,
        nearby: Nearby | None = None,
        check_interval_s: float = CHECK_INTERVAL_S,
    ) -> None:
        super().__init__(controller, session, check_interval_s)
        self.sensors, self.kinematics = sensors, kinematics
        self._planner, self._nearby = planner, nearby
        self._held = {}
