"""Clients of the simulation server, one of them with its Omni database for virtual sensor servers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.orb.calls import set_call_timeout
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import Answer, RemoteObject, translated
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.corba.remote_database import changes
from robocorba.simulation.load_balance import Load
from robocorba.simulation.robot_scans import LastScan, RobotScan
from robocorba.simulation.sensor_admission import proof_of
from robocorba.stubs import RoboCorba

#: Timeout of calls [s].
CALL_TIMEOUT_S = 1.0


def simulation_server(orb: Orb, resolve_timeout_s: float, call_timeout_s: float) -> RemoteObject:
    """The RoboCorba::SimulationServer of a running system, resolved again after each failure."""
    timeouts = resolve_timeout_s, call_timeout_s
    return RemoteObject(orb, "SimulationServer", RoboCorba.SimulationServer, "the simulation server", *timeouts)


class RemoteSimulation:
    """Raises NotReachable if the servers are not found within 300 s, and in calls while they do not answer."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._server = orb.resolve("SimulationServer", RoboCorba.SimulationServer, 300.0, CALL_TIMEOUT_S)
        self._registration: Any = None
        self._database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, 300.0, CALL_TIMEOUT_S)

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """Changes of a floor since a version. Raises UnknownFloor, NotReachable."""
        return changes(self._database, floor, since)

    def register_sensor(self, name: str, reference: Any, token: str) -> None:
        """Register a virtual sensor server with the system's token, for the reports that follow. Raises SensorRefused,
        NotReachable."""
        proof = proof_of(token, name, self._orb.uri(reference))
        with translated("the simulation server"):
            registration = self._server.registerSensor(name, reference, proof)
            set_call_timeout(registration, CALL_TIMEOUT_S)
        self._registration = registration

    @property
    def is_registered(self) -> bool:
        """Whether a virtual sensor server was registered, and is still known to the server."""
        return self._registration is not None

    def report_sensor(self, load: Load, latest: Sequence[LastScan]) -> None:
        """Report the registered sensor server: renew its lease, load and last scans. Raises NotReachable."""
        last_scans = [scans.last_scan(scan) for scan in latest]
        self._report(lambda registration: registration.report(sessions.load(load), last_scans))

    def report_scans(self, latest: Sequence[RobotScan]) -> float:
        """Report complete scans; returns the seconds until the next report is wanted. Raises NotReachable."""
        robot_scans = [scans.robot_scan(scan) for scan in latest]
        return float(self._report(lambda registration: registration.reportScans(robot_scans)))

    def _report(self, report: Callable[[Any], Answer]) -> Answer:
        registration = self._registration
        if registration is None:
            raise NotReachable("the sensor server is not registered")
        with translated("the simulation server"):
            try:
                return report(registration)
            except (CORBA.OBJECT_NOT_EXIST, CORBA.NO_PERMISSION):  # it was restarted
                self._registration = None
                raise
