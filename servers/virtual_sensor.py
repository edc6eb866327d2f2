"""A virtual sensor server: it follows the Omni database and the map, and scans for its assigned robots."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import SensorRefused
from robocorba.map_editor.corba.remote_map import RemoteMap
from robocorba.orb.call_limit import CallLimit
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_simulation import RemoteSimulation
from robocorba.simulation.corba.virtual_sensor_servant import VirtualSensorServant
from robocorba.simulation.sensing import virtual_sensor
from robocorba.simulation.sensing.floor_follower import FloorFollower
from robocorba.simulation.sensing.reports import Reports
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation.sensor_admission import read_token
from robocorba.system import logs
from robocorba.system.names import SENSOR_TOKEN, SENSORS
from robocorba.system.private_files import claim_state
from robocorba.system.repeating import Repeating
from robocorba.system.settings import SensorSettings

#: Maximum number of calls for more rays than a robot needs that are executed at the same time.
LARGE_SCANS = 1
#: Interval between updates of the floors on which robots scan [s].
FOLLOW_INTERVAL_S = 0.03
#: Interval between requests for map edits [s].
MAP_CHECK_INTERVAL_S = 0.25
#: Interval between reports to the simulation server [s].
REPORT_INTERVAL_S = 0.5
#: Interval between reports of complete scans while they are wanted, and bounds of what the server may want [s].
SCANS_INTERVAL_S, MIN_SCANS_S, MAX_SCANS_S = 0.05, 0.02, 5.0
#: Maximum number of robots with a sensor of their own; beyond that the oldest sensors are deactivated.
MAX_ROBOTS = 10_000

_log = logging.getLogger(__name__)


class VirtualSensorServer:
    """A virtual sensor for all robots, and a CORBA object for each robot that is assigned to this server.

    token: file with the system's token for sensor servers."""

    def __init__(self, orb: Orb, name: str, token: Path) -> None:
        self._orb, self._name, self._path, self._token = orb, name, f"{SENSORS}/{name}", token
        self._is_refused = False
        self._map, self._simulation = RemoteMap(orb), RemoteSimulation(orb)
        self._sensor = VirtualSensor()
        self._sensor.set_map(self._map.building)
        self._sensor.warm_up()
        self._reports = Reports(self._sensor)
        self._lock, self._large = threading.Lock(), CallLimit(LARGE_SCANS)
        self._follower = FloorFollower(self._sensor, self._simulation.changes)
        self._assigned: dict[str, tuple[str, Any]] = {}
        self._number = 0
        self._last_robots: set[str] = set()
        #: Time of the next report of complete scans on the monotonic clock [s].
        self._scans_at = 0.0
        self._tasks = [
            Repeating("follow", self._follow, FOLLOW_INTERVAL_S),
            Repeating("map", self._follow_map, MAP_CHECK_INTERVAL_S),
            Repeating("report", self._report, REPORT_INTERVAL_S),
            Repeating("scans", self._report_scans, SCANS_INTERVAL_S),
        ]

    def start(self) -> None:
        """Start the updates, and accept calls."""
        servant = self._servant_of(None)
        self._reference = self._orb.activate(servant, self._path)
        for task in self._tasks:
            task.start()
        self._orb.serve({self._path: servant})

    def close(self) -> None:
        for task in self._tasks:
            task.close()

    # ---- activator of the servants ----

    def for_robot(self, name: str) -> Any:
        """Reference of a robot's sensor, activated if necessary."""
        with self._lock:
            if name not in self._assigned:
                self._number += 1  # keys are unique: a deactivated object may still serve a call
                key = f"{self._path}/robots/{name}/{self._number}"
                self._assigned[name] = key, self._orb.activate(self._servant_of(name), key)
            for oldest in list(self._assigned)[: len(self._assigned) - MAX_ROBOTS]:
                self._deactivate(oldest)
            self._reports.robots = len(self._assigned)
            return self._assigned[name][1]

    def _servant_of(self, robot: str | None) -> VirtualSensorServant:
        return VirtualSensorServant(self._follower, self._reports, self.for_robot, self.dismiss, self._large, robot)

    def dismiss(self, name: str) -> None:
        """Deactivate a robot's sensor."""
        with self._lock:
            self._deactivate(name)
            self._reports.robots = len(self._assigned)

    def _deactivate(self, name: str) -> None:
        if name in self._assigned:
            self._orb.deactivate_key(self._assigned.pop(name)[0])

    # ---- repeated tasks, each in a thread of its own ----

    def _follow(self) -> None:
        self._follower.follow()
        robots = self._sensor.robots
        for name in self._last_robots - robots:
            self.dismiss(name)
        self._last_robots = robots

    def _follow_map(self) -> None:
        with contextlib.suppress(NotReachable):
            if self._map.follow():
                self._follower.set_map(self._map.building)

    def _report(self) -> None:
        latest = self._reports.collect()
        with contextlib.suppress(NotReachable):
            was_registered = self._simulation.is_registered
            if not was_registered:
                self._register()
            try:
                self._simulation.report_sensor(self._reports.load, latest)
            except NotReachable:
                if not was_registered or self._simulation.is_registered:
                    raise
                self._register()  # the simulation server was restarted
                self._simulation.report_sensor(self._reports.load, latest)

    def _register(self) -> None:
        try:
            self._simulation.register_sensor(self._name, self._reference, read_token(self._token))
            self._is_refused = False
        except SensorRefused as error:
            if not self._is_refused:
                _log.error("%s (looked for in %s)", error, self._token)
            self._is_refused = True

    def _report_scans(self) -> None:
        if time.monotonic() < self._scans_at:
            return
        wanted_s = REPORT_INTERVAL_S
        with contextlib.suppress(NotReachable):
            wanted_s = self._simulation.report_scans(self._reports.collect_robot_scans())
        self._scans_at = time.monotonic() + min(max(wanted_s, MIN_SCANS_S), MAX_SCANS_S) - SCANS_INTERVAL_S / 2


def preload() -> None:
    """Compile or load the kernels."""
    virtual_sensor.warm_up()


def main(arguments: Sequence[str] | None = None) -> None:
    settings = SensorSettings.read(arguments, __doc__ or "")
    claim_state(settings.server.state)
    logs.setup(f"sensor_{settings.name}", settings.server.state / "logs")
    with (
        Orb(settings.server.naming, settings.server.endpoint) as orb,
        contextlib.closing(VirtualSensorServer(orb, settings.name, settings.server.state / SENSOR_TOKEN)) as server,
    ):
        server.start()
        orb.run()


if __name__ == "__main__":
    main()
