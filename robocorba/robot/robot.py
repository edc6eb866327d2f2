"""A SmartPal, virtual or actual: one method for each movement that icons consist of.

Each method returns when the movement is done. It raises MotionFailed if the robot did not reach its target, RobotLost
and IllegalOrder if it can't move, and the error with which its `execution` is interrupted."""

from __future__ import annotations

from robocorba.robot.arms import ArmMovements
from robocorba.robot.base import BaseMovements
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.execution_control import CHECK_INTERVAL_S
from robocorba.robot.high_controller import HighController
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.programs.base_checks import Planner
from robocorba.robot.sensors import Sensors
from robocorba.robot.session import BuildingSession


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
