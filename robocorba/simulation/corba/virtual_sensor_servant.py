"""Servants of virtual sensors: in a sensor server, and in the simulation server for each robot's session."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, NoReturn

import omniORB
from omniORB import CORBA

from robocorba.orb.call_limit import CallLimit
from robocorba.orb.exceptions import translating
from robocorba.orb.server_release import ServerServant
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.sensing.floor_follower import FloorFollower
from robocorba.simulation.sensing.reports import Reports
from robocorba.simulation.sensing.scan import RAY_SENSORS
from robocorba.stubs import RoboCorba__POA


class VirtualSensorServant(ServerServant, RoboCorba__POA.VirtualSensor):
    """RoboCorba::VirtualSensor of a sensor server, or of one robot if `robot` names it.

    for_robot: returns the reference of a robot's sensor, activated if necessary. dismiss: deactivates a robot's sensor.
    large: limit of the calls with so many rays that the scans of robots would wait."""

    def __init__(
        self,
        follower: FloorFollower,
        reports: Reports,
        for_robot: Callable[[str], Any],
        dismiss: Callable[[str], None],
        large: CallLimit,
        robot: str | None = None,
    ) -> None:
        self._follower, self._reports, self._robot = follower, reports, robot
        self._for_robot, self._dismiss, self._large = for_robot, dismiss, large

    @translating
    def scan(self, robot: Any, where: Any, wanted: Any) -> Any:
        spec = scans.spec_of(wanted)
        pose_rows, mount = scans.pose_rows_of([robot]), scans.mount_of(where)
        self._follower.prepare([robot.floor])
        result = self._follower.sensor.scan(robot.floor, pose_rows, mount, spec, self._robot)
        self._reports.record_scan(self._robot, sessions.pose_of(robot), mount, spec, result)
        return scans.scan(result, spec)

    @translating
    def scanMany(self, robots: list[Any], where: Any, wanted: Any) -> list[Any]:
        # A million rays take 0.1 s.
        with self._large.place() if len(robots) * wanted.rays > 20_000 else nullcontext():
            spec, mount, floors = scans.spec_of(wanted), scans.mount_of(where), [robot.floor for robot in robots]
            self._follower.prepare(floors)
            pose_rows = scans.pose_rows_of(robots)
            results = self._follower.sensor.scan_many(floors, pose_rows, mount, spec, self._robot)
            for robot, result in zip(robots, results, strict=True):
                self._reports.record_scan(self._robot, sessions.pose_of(robot), mount, spec, result)
            return [scans.scan(result, spec) for result in results]

    def laser(self) -> Any:
        return scans.spec(RAY_SENSORS["laser"].spec(0.0))

    @translating
    def proximity(self, radius: float) -> Any:
        return scans.spec(RAY_SENSORS["proximity"].spec(radius))

    def _get_load(self) -> Any:
        return sessions.load(self._reports.load)

    # The sensor of a robot, which has it from its session, gives no right to those of others.

    def forRobot(self, name: str) -> Any:
        self._refuse_others(name)
        if not 0 < len(name) <= 60:
            raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
        return self._for_robot(name)

    def dismiss(self, name: str) -> None:
        self._refuse_others(name)
        self._dismiss(name)

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
