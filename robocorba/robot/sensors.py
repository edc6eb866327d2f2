"""A robot's virtual sensors: the laser, and the ring of proximity sensors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.session import BuildingSession
from robocorba.simulation.registry import Pose
from robocorba.simulation.sensing.scan import RAY_SENSORS, Mount, ray_sensor

#: Scans are measured from the centre of the robot.
CENTRE = Mount()


class Sensors:
    """Sensors of a robot of `radius_m` at the position of `state`, on the floor of its session."""

    def __init__(self, session: BuildingSession, state: Callable[[], RobotState], radius_m: float) -> None:
        self._session, self._state = session, state
        self._specs = {name: sensor.spec(radius_m) for name, sensor in RAY_SENSORS.items()}

    def nearest_m(self, sensor: str) -> float:
        """The least distance that a sensor measures [m]; its range if it sees nothing. sensor: its name in programs.
        Raises InvalidScan, SensorBehind, RobotLost."""
        about = ray_sensor(sensor)
        distances = self._session.scan(self._at(), CENTRE, self._specs[about.name])
        return float(distances[about.rays.index(sensor)] if sensor in about.rays else np.min(distances))

    def _at(self) -> Pose:
        state = self._state()
        return Pose(self._session.latest.at.floor, state.x, state.y, state.heading)
