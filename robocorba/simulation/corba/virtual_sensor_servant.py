"""Servants of virtual sensors: in a sensor server, and in the simulation server for each robot's session."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import nullcontext
from typing import Any, NoReturn, Protocol

import omniORB
from omniORB import CORBA

from robocorba.orb.call_limit import CallLimit
from robocorba.orb.exceptions import translating
from robocorba.orb.server_release import ServerServant
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.sensing.fan import LASER, PROXIMITY
from robocorba.simulation.sensing.reports import Reports
from robocorba.simulation.sensing.scan import ScanSpec
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor
from robocorba.stubs import RoboCorba__POA

#: Number of rays beyond which a call is large: a million take 0.1 s, for which the scans of robots would wait.
LARGE = 20_000


class RobotSensors(Protocol):
    """The sensors of single robots in a sensor server."""

    def for_robot(self, name: str) -> Any:
        """Reference of a robot's sensor, activated if necessary."""

    def prepare(self, floors: Collection[str]) -> None:
        """Call this before scans on floors."""

    def dismiss(self, name: str) -> None:
        """Deactivate a robot's sensor."""


class VirtualSensorServant(ServerServant, RoboCorba__POA.VirtualSensor):
    """RoboCorba::VirtualSensor of a sensor server, or of one robot if `robot` names it. large: limit of the calls with
    more than LARGE rays."""

    def __init__(
        self,
        sensor: VirtualSensor,
        reports: Reports,
        robot_sensors: RobotSensors,
        large: CallLimit,
        robot: str | None = None,
    ) -> None:
        self._sensor, self._reports, self._robot_sensors, self._robot = sensor, reports, robot_sensors, robot
        self._large = large

    @translating
    def scan(self, robot: Any, where: Any, wanted: Any) -> Any:
        spec = scans.spec_of(wanted)
        pose_rows, mount = scans.pose_rows_of([robot]), scans.mount_of(where)
        self._robot_sensors.prepare([robot.floor])
        result = self._sensor.scan(robot.floor, pose_rows, mount, spec, self._robot)
        self._reports.record_scan(self._robot, sessions.pose_of(robot), mount, spec, result)
        return scans.scan(result, spec)

    @translating
    def scanMany(self, robots: list[Any], where: Any, wanted: Any) -> list[Any]:
        with self._large.place() if len(robots) * wanted.rays > LARGE else nullcontext():
            return self._scan_many(robots, where, wanted)

    def _scan_many(self, robots: list[Any], where: Any, wanted: Any) -> list[Any]:
        spec, mount, floors = scans.spec_of(wanted), scans.mount_of(where), [robot.floor for robot in robots]
        self._robot_sensors.prepare(floors)
        results = self._sensor.scan_many(floors, scans.pose_rows_of(robots), mount, spec, self._robot)
        for robot, result in zip(robots, results, strict=True):
            self._reports.record_scan(self._robot, sessions.pose_of(robot), mount, spec, result)
        return [scans.scan(result, spec) for result in results]

    def laser(self) -> Any:
        return scans.spec(ScanSpec(LASER))

    @translating
    def proximity(self, radius: float) -> Any:
        return scans.spec(ScanSpec(PROXIMITY, radius))

    def _get_load(self) -> Any:
        return sessions.load(self._reports.load)

    # The sensor of a robot, which has it from its session, gives no right to those of others.

    def forRobot(self, name: str) -> Any:
        self._refuse_others(name)
        if not 0 < len(name) <= 60:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        return self._robot_sensors.for_robot(name)

    def dismiss(self, name: str) -> None:
        self._refuse_others(name)
        self._robot_sensors.dismiss(name)

    def _refuse_others(self, name: str) -> None:
        if self._robot is not None and name not in ("", self._robot):
            raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)


class RobotSensorServant(RoboCorba__POA.VirtualSensor):
    """RoboCorba::VirtualSensor that forwards its callers to a robot's assigned sensor server.

    find: returns the sensor's reference there; waits while there is none."""

    def __init__(self, find: Callable[[], Any]) -> None:
        self._find = find

    def _forward(self, *arguments: Any) -> NoReturn:
        raise omniORB.LOCATION_FORWARD(self._find())

    scan = scanMany = laser = proximity = _get_load = _get_release = forRobot = dismiss = _forward
