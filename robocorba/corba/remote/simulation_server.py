"""Client of the simulation server and its Omni database, for virtual sensor servers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from omniORB import CORBA

from robocorba.corba.conversion import scans, simulation
from robocorba.corba.orb import Orb
from robocorba.corba.remote.omni_database import changes
from robocorba.corba.remote.remote_object import translated
from robocorba.simulation.load_balance import Load
from robocorba.simulation.omni_database import LastScan
from robocorba.simulation.robot_scans import IDLE_INTERVAL_S, RobotScan
from robocorba.spatial.floor_update import FloorUpdate
from robocorba.stubs import RoboCorba

#: Timeouts to resolve the servers at start, and of calls [s].
START_TIMEOUT_S, CALL_TIMEOUT_S = 300.0, 1.0


class RemoteSimulation:
    """Raises NotReachable if the servers are not found within `timeout_s`, and in calls while they do not answer."""

    def __init__(self, orb: Orb, timeout_s: float = START_TIMEOUT_S) -> None:
        self._server = orb.resolve("SimulationServer", RoboCorba.SimulationServer, timeout_s, CALL_TIMEOUT_S)
        self._database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, timeout_s, CALL_TIMEOUT_S)

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """Changes of a floor since a version. Raises UnknownFloor, NotReachable."""
        return changes(self._database, floor, since)

    def report_sensor(self, name: str, reference: Any, load: Load, latest: Sequence[LastScan]) -> None:
        """Report a virtual sensor server: renew its lease, load and last scans. Raises NotReachable."""
        last_scans = [scans.last_scan(scan) for scan in latest]
        with translated("the simulation server"):
            self._server.reportSensor(name, reference, simulation.load(load), last_scans)

    def report_scans(self, name: str, latest: Sequence[RobotScan]) -> float:
        """Report complete scans; returns the seconds until the next report is wanted. Raises NotReachable."""
        robot_scans = [scans.robot_scan(scan) for scan in latest]
        with translated("the simulation server"):
            try:
                return float(self._server.reportScans(name, robot_scans))
            except CORBA.BAD_OPERATION:  # a server of an earlier version
                return IDLE_INTERVAL_S
