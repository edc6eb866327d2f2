"""Client of the virtual sensor servers for programs without a robot of their own: scans from places of robots."""

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
from robocorba.simulation.sensing.scan import LASER, Mount, ScanResult, ScanSpec, robot_scan
from robocorba.stubs import RoboCorba
from robocorba.system.names import SENSORS


class RemoteLasers:
    """Asks one server as long as it answers, then the next one. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._name = ""
        self._sensor: RemoteObject | None = None

    def scans(
        self,
        robots: Sequence[tuple[str, Pose]],
        time_s: float,
        spec: ScanSpec = ScanSpec(LASER),  # noqa: B008
        mount: Mount = Mount(),  # noqa: B008
    ) -> list[RobotScan]:
        """A scan for each robot from its pose at a simulated time [s], by default by the laser range finder of robots'
        programs, at its centre; it does not see itself.

        Raises NotReachable, SensorBehind, UnknownFloor, InvalidScan."""
        places, wanted = [at for _, at in robots], (RoboCorba.Mount(*mount), scans.spec(spec))
        try:
            found = self._find().call(lambda sensor: sensor.scanMany(places, *wanted))
        except (NotReachable, SensorBehind):
            self._sensor = None
            raise
        return [
            robot_scan(name, at, mount, spec, ScanResult(time_s, np.array([at[1:]]), np.array([data.distances])))
            for (name, at), data in zip(robots, found, strict=True)
        ]

    def _find(self) -> RemoteObject:
        """The server that answered last, else the next one. Raises NotReachable."""
        found = self._sensor
        if found is None:
            names = sorted(self._orb.names(SENSORS))
            if not names:
                raise NotReachable("no virtual sensor server is bound")
            self._name = next((name for name in names if name > self._name), names[0])
            self._sensor = found = RemoteObject(
                self._orb,
                f"{SENSORS}/{self._name}",
                RoboCorba.VirtualSensor,
                f"virtual sensor server {self._name}",
                resolve_timeout_s=0.5,
                call_timeout_s=1.0,
            )
        return found
