"""A robot's virtual sensors: the laser, and the ring of proximity sensors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs.icons import PROXIMITY_SENSORS
from robocorba.robot.session import BuildingSession
from robocorba.simulation.registry import Pose
from robocorba.simulation.sensing.fan import LASER, PROXIMITY
from robocorba.simulation.sensing.scan import Mount, ScanSpec

#: Scans are measured from the centre of the robot.
CENTRE = Mount()


class Sensors:
    """Sensors of a robot of `radius_m` at the position of `state`, on the floor of its session."""

    def __init__(self, session: BuildingSession, state: Callable[[], RobotState], radius_m: float) -> None:
        self._session, self._state = session, state
        self._laser, self._ring = ScanSpec(LASER), ScanSpec(PROXIMITY, radius_m)

    def laser(self) -> Floats:
        """Distances (181,) from the centre [m], from right to left. Raises InvalidScan, SensorBehind, RobotLost."""
        return self._session.scan(self._at(), CENTRE, self._laser)

    def proximity(self) -> Floats:
        """Distances (8,) from the rim [m], counter-clockwise from ahead. Raises InvalidScan, SensorBehind,
        RobotLost."""
        return self._session.scan(self._at(), CENTRE, self._ring)

    def nearest_m(self, sensor: str) -> float:
        """The least distance that a sensor measures [m]; its range if it sees nothing. sensor: its name in programs.
        Raises InvalidScan, SensorBehind, RobotLost."""
        if sensor == "laser":
            return float(np.min(self.laser()))
        ring = self.proximity()
        return float(np.min(ring) if sensor == "proximity" else ring[PROXIMITY_SENSORS.index(sensor)])

    def _at(self) -> Pose:
        state = self._state()
        return Pose(self._session.latest.at.floor, state.x, state.y, state.heading)
