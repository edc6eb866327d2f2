"""Client of the virtual sensor servers for programs without a robot of their own: laser scans from places of robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robocorba.errors.sensing import SensorBehind
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.simulation.corba import scans
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.fan import LASER
from robocorba.simulation.sensing.scan import Mount, ScanSpec
from robocorba.stubs import RoboCorba
from robocorba.system.names import SENSORS

#: Timeout of a call, and to find a server [s].
CALL_TIMEOUT_S, RESOLVE_TIMEOUT_S = 1.0, 0.5
#: The laser range finder of robots' programs, at the centre of the robot.
_SPEC, _MOUNT = ScanSpec(LASER), Mount()


class RemoteLasers:
    """Asks one server as long as it answers, then the next one. Not thread-safe."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._name = ""
        self._sensor: RemoteObject | None = None

    def scans(self, robots: Sequence[tuple[str, Pose]], time_s: float) -> list[RobotScan]:
        """A scan for each robot from its pose at a simulated time [s]; it does not see itself.

        Raises NotReachable, SensorBehind, UnknownFloor."""
        spec, mount = scans.spec(_SPEC), RoboCorba.Mount(*_MOUNT)
        places = [at for _, at in robots]
        try:
            found = self._find().call(lambda sensor: sensor.scanMany(places, mount, spec))
        except (NotReachable, SensorBehind):
            self._sensor = None
            raise
        return [_scan(name, at, time_s, data.distances) for (name, at), data in zip(robots, found, strict=True)]

    def _find(self) -> RemoteObject:
        """The server that answered last, else the next one. Raises NotReachable."""
        if self._sensor is None:
            names = sorted(self._orb.names(SENSORS))
            if not names:
                raise NotReachable("no virtual sensor server is bound")
            self._name = next((name for name in names if name > self._name), names[0])
            self._sensor = RemoteObject(
                self._orb,
                f"{SENSORS}/{self._name}",
                RoboCorba.VirtualSensor,
                f"virtual sensor server {self._name}",
                RESOLVE_TIMEOUT_S,
                CALL_TIMEOUT_S,
            )
        return self._sensor


def _scan(robot: str, at: Pose, time_s: float, lengths: Sequence[float]) -> RobotScan:
    fan, noise, distances = _SPEC.fan, _SPEC.noise, np.array(lengths)
    return RobotScan(
        *(robot, time_s, at, (_MOUNT[0], _MOUNT[1], _MOUNT[2])),
        *(fan.first_rad, fan.step_rad, fan.range_m, _SPEC.rim_m),
        (noise.sigma_m, noise.relative, noise.lost, _SPEC.seed),
        distances,
        distances < fan.range_m,
    )
