"""Servants of the communication management agent: the server, robots' sessions, and the administrator's interface."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.errors.simulation import SensorRefused
from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.corba.registered_sensors import RegisteredSensors
from robocorba.simulation.emergency_stops import EmergencyStops
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.session import Session
from robocorba.stubs import RoboCorba__POA


class SimulationServerServant(ServerServant, RoboCorba__POA.SimulationServer):
    """RoboCorba::SimulationServer.

    reference_of: activates a session's servant. render: renders a floor as PNG. sensors: admits sensor servers."""

    def __init__(
        self,
        agent: ManagementAgent,
        reference_of: Callable[[Session], Any],
        render: Callable[[str, int], bytes],
        stops: EmergencyStops,
        sensors: RegisteredSensors,
    ) -> None:
        self._agent, self._reference_of, self._render = agent, reference_of, render
        self._stops, self._sensors = stops, sensors

    @translating
    def registerRobot(self, about: Any) -> Any:
        return self._reference_of(self._agent.register(sessions.description_of(about)))

    def _get_state(self) -> Any:
        return sessions.server_state(self._agent.state)

    def clients(self) -> list[Any]:
        name_for = self._agent.load_balance.name_for
        return [
            sessions.client_state(
                session.client, session.robot.state().pose, session.client.silent_s, name_for(session.name)
            )
            for session in list(self._agent.sessions.values())
        ]

    def sensors(self) -> list[Any]:
        return [sessions.sensor_state(sensor) for sensor in self._agent.load_balance.servers]

    @translating
    def renderFloor(self, floor: str, width: int) -> bytes:
        return self._render(floor, width)

    def reportSensor(self, name: str, reference: Any, load: Any, latest: list[Any]) -> None:
        self._earlier_version(name).report(load, latest)

    def reportScans(self, name: str, latest: list[Any]) -> float:
        return self._earlier_version(name).reportScans(latest)

    registerSensor = forwarded("_sensors", RegisteredSensors.register)

    def stopRobots(self, robots: list[str], reason: str) -> list[Any]:
        return [sessions.stop_state(state) for state in self._stops.stop(robots, reason)]

    def stopStates(self, robots: list[str]) -> list[Any]:
        return [sessions.stop_state(state) for state in self._stops.states(robots)]

    def _get_stopOfAll(self) -> Any:
        return sessions.stop_hold(self._stops.stop_of_all)

    def endStopOfAll(self, last: int) -> Any:
        return sessions.stop_hold(self._stops.end_stop_of_all(last))

    def bound_to(self, robot: str) -> dict[str, Callable[..., Any]]:
        """What a robot with a file of its own calls instead: it logs on as itself only."""

        def register_robot(about: Any) -> Any:
            if about.name != robot:
                raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO)
            return self.registerRobot(about)

        return {"registerRobot": register_robot}

    def _earlier_version(self, name: str) -> Any:
        try:
            return self._sensors.earlier_version(name)
        except SensorRefused:
            raise CORBA.NO_PERMISSION(0, CORBA.COMPLETED_NO) from None


class SensorRegistrationServant(RoboCorba__POA.SensorRegistration):
    """RoboCorba::SensorRegistration of the server `name` at `reference`. dismiss: dismisses a robot at the sensor
    server of the given reference; must not block."""

    def __init__(self, agent: ManagementAgent, name: str, reference: Any, dismiss: Callable[[Any, str], None]) -> None:
        self._agent, self._name, self._reference, self._dismiss = agent, name, reference, dismiss

    def report(self, load: Any, latest: list[Any]) -> None:
        self._agent.record_scans(scans.last_scan_of(struct) for struct in latest)
        for robot, previous in self._agent.load_balance.report(self._name, self._reference, sessions.load_of(load)):
            self._dismiss(previous, robot)

    def reportScans(self, latest: list[Any]) -> float:
        return self._agent.record_robot_scans([scans.robot_scan_of(struct) for struct in latest])


def _measured(method: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a method of a session: translate errors, record its latency, and keep the lease while it runs."""
    translated = translating(method)

    @functools.wraps(method)
    def call(self: RobotSessionServant, *arguments: Any) -> Any:
        began, client = time.perf_counter(), self.session.client
        client.begin_call()
        try:
            return translated(self, *arguments)
        finally:
            client.end_call()
            client.latency_s += 0.05 * (time.perf_counter() - began - client.latency_s)

    return call


def _forwarded(method: Callable[..., Any]) -> Callable[..., Any]:
    """An operation that a method of the session does."""
    return _measured(lambda self, *arguments: method(self.session, *arguments))


class RobotSessionServant(RoboCorba__POA.RobotSession):
    """RoboCorba::RobotSession. sensor: reference of the robot's virtual sensor. uri: of a reference."""

    def __init__(
        self, session: Session, lease_s: float, sensor: Any, stops: EmergencyStops, uri: Callable[[Any], str]
    ) -> None:
        self.session, self._lease_s, self._sensor, self._stops, self._uri = session, lease_s, sensor, stops, uri

    brake = _forwarded(Session.brake)
    reportPosture = _forwarded(Session.report_posture)
    heartbeat = _forwarded(Session.heartbeat)
    release = _forwarded(Session.release)
    callElevator = _forwarded(Session.call_elevator)
    callElevatorTogether = _forwarded(Session.call_elevator)
    callElevatorFor = _forwarded(Session.call_elevator)
    longestElevatorWait = _forwarded(Session.longest_elevator_wait_s)
    giveUpElevator = _forwarded(Session.cancel_elevator)
    takeOverAreas = _forwarded(Session.take_over_areas)
    releaseAreas = _forwarded(Session.release_areas)
    deregister = _forwarded(Session.deregister)

    @_measured
    def _get_name(self) -> str:
        self.session.heartbeat()
        return self.session.name

    @_measured
    def _get_lease(self) -> float:
        self.session.heartbeat()
        return self._lease_s

    @_measured
    def command(self, wanted: Any, valid_for: float) -> None:
        self.session.command(wanted.ahead, wanted.left, wanted.turn, valid_for)

    @_measured
    def state(self) -> Any:
        session = self.session
        robot = session.robot
        return sessions.robot_state(session.state(), robot.holding, session.ride, robot.collisions, robot.touched)

    @_measured
    def _get_sensor(self) -> Any:
        self.session.heartbeat()
        return self._sensor

    @_measured
    def grip(self, what: str, place: Any) -> None:
        self.session.grip(what, (place.x, place.y))

    @_measured
    def reserveAreas(self, areas: list[Any], limit: float) -> None:
        self.session.reserve(sessions.areas_of(areas), limit)

    @_measured
    def reserveOneOf(self, alternatives: list[Any], limit: float) -> int:
        return self.session.reserve_one_of(sessions.alternatives_of(alternatives), limit)

    @_measured
    def exchangeAreas(self, areas: list[Any], least: float) -> bool:
        return self.session.exchange_areas(sessions.areas_of(areas), least)

    @_measured
    def reservation(self) -> Any:
        return sessions.reservation(self.session.reservation())

    @_measured
    def keepAreas(self, areas: list[Any]) -> None:
        self.session.keep_areas(sessions.areas_of(areas))

    @_measured
    def reportStopTarget(self, target: Any, standsWithBody: bool) -> None:
        self.session.heartbeat()
        self._stops.report_target(self.session, self._uri(target) if target is not None else "", standsWithBody)

    @_measured
    def resetStop(self) -> None:
        self.session.heartbeat()
        self._stops.reset(self.session)

    @_measured
    def _get_hold(self) -> Any:
        self.session.heartbeat()
        return sessions.stop_hold(self._stops.hold(self.session))

    @_measured
    def reportStop(self, reason: str) -> tuple[bool, Any]:
        self.session.heartbeat()
        is_new, hold = self._stops.report_stop(self.session, reason)
        return is_new, sessions.stop_hold(hold)

    @_measured
    def endStops(self, last: int) -> Any:
        self.session.heartbeat()
        return sessions.stop_hold(self._stops.end(self.session, last))


class SimulationAdministratorServant(RoboCorba__POA.SimulationAdministrator):
    """RoboCorba::SimulationAdministrator."""

    def __init__(self, agent: ManagementAgent, stops: EmergencyStops) -> None:
        self._agent, self._stops = agent, stops

    @translating
    def setLimit(self, robots: int) -> None:
        self._agent.configure(limit=robots)

    evict = forwarded("_agent", ManagementAgent.evict)
    resetStop = forwarded("_stops", EmergencyStops.reset_robot)

    @translating
    def setPace(self, pace: float) -> None:
        self._agent.configure(pace=pace)

    @translating
    def pause(self) -> None:
        self._agent.configure(is_paused=True)

    @translating
    def resume(self) -> None:
        self._agent.configure(is_paused=False)

    @translating
    def place(self, body: str, at: Any) -> None:
        self._agent.place(body, sessions.pose_of(at))

    @translating
    def step(self, steps: int) -> None:
        self._agent.loop.step(steps)

    keepOut = forwarded("_agent", ManagementAgent.keep_out)
    admit = forwarded("_agent", ManagementAgent.admit)

    @translating
    def keptOut(self) -> list[str]:
        return self._agent.kept_out
