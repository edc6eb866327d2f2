"""The simulation server: communication management agent, Omni database and 2D simulator of one building."""

from __future__ import annotations

import contextlib
import functools
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownRobot
from robocorba.map_editor.corba.remote_map import RemoteMap
from robocorba.missions.corba.mission_control_servant import MissionControlServant
from robocorba.missions.corba.remote_leaders import RemoteLeaders
from robocorba.missions.mission_control import LeaderWatch, MissionControl
from robocorba.orb.call_limit import CallLimit
from robocorba.orb.orb import Orb
from robocorba.orb.reference_file import key_in_file, write_reference
from robocorba.orb.workarounds import operations_of
from robocorba.robot.corba.stop_target import stop_at
from robocorba.simulation import omni_database, physics
from robocorba.simulation.corba.announcer import Announcer
from robocorba.simulation.corba.omni_database_servant import OmniDatabaseServant
from robocorba.simulation.corba.registered_sensors import RegisteredSensors
from robocorba.simulation.corba.remote_sensors import RemoteSensors
from robocorba.simulation.corba.simulation_server_servant import (
    RobotSessionServant,
    SensorRegistrationServant,
    SimulationAdministratorServant,
    SimulationServerServant,
)
from robocorba.simulation.corba.virtual_sensor_servant import RobotSensorServant
from robocorba.simulation.emergency_stops import EmergencyStops
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.monitor import Monitor
from robocorba.simulation.registry import RobotClient, digest_of
from robocorba.simulation.sensor_admission import SensorAdmission, system_token
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.store import SimulationStore
from robocorba.system import cores, logs
from robocorba.system.names import ADMINISTRATOR, PORTS, SENSOR_TOKEN, STOPS
from robocorba.system.private_files import claim_state
from robocorba.system.repeating import Repeating
from robocorba.system.settings import SimulationSettings

#: Interval between requests for map edits [s].
MAP_CHECK_INTERVAL_S = 0.25
#: Interval between checks whether layers of pictures are unused [s].
LAYER_CHECK_INTERVAL_S = 15.0
#: Interval between checks whether running missions have their leaders [s].
LEADER_CHECK_INTERVAL_S = 3.0
#: What the keys of sessions and that of the administrator begin with; a secret follows.
_SESSION, _ADMINISTRATOR = "sessions/", "administrator/"
#: Calls without a session that run at the same time, by what they do; further ones wait, so that sessions and the
#: simulation get the interpreter within milliseconds. Logging on and writing wait for the disk, missions for leaders:
#: they don't delay reading, nor do robots, all of which follow the changes of floors. Drawing takes up to a second of
#: processor time.
READING, FOLLOWING, LOGGING_ON, WRITING, MISSIONS, DRAWING = 4, 4, 4, 4, 8, 1
#: Waiting pictures. Few, because a picture is drawn even if its caller has given up.
MAX_WAITING_PICTURES = 8
#: Operations of the Omni database that write, and those that robots call many times a second. It reads in all others.
MISSION_WRITES, FLOOR_CHANGES = ("putMission", "removeMission"), ("floorChanges", "typedFloorChanges")

#: For hundreds of connections. By default the ORB looks every 50 ms for connections that get another call while one is
#: executed, and gives them to other threads: with 300 robots calls came late by tens of milliseconds. Now calls that a
#: client sends at the same time on one connection are executed one after the other.
MANY_CONNECTIONS = {"maxServerThreadPerConnection": "1"}


def limit_calls(server: SimulationServerServant, database: OmniDatabaseServant, control: MissionControlServant) -> None:
    """Let calls of these three servants wait for their own kind only."""
    reading = CallLimit(READING)
    reading.apply(server, "_get_state", "clients", "sensors")
    reading.apply(database, *set(operations_of(database)).difference(MISSION_WRITES, FLOOR_CHANGES))
    CallLimit(FOLLOWING).apply(database, *FLOOR_CHANGES)
    CallLimit(WRITING).apply(database, *MISSION_WRITES)
    CallLimit(LOGGING_ON).apply(server, "registerRobot")
    CallLimit(DRAWING, MAX_WAITING_PICTURES).apply(server, "renderFloor")
    CallLimit(MISSIONS).apply(control)


class SimulationServer:
    """A simulation and its CORBA objects.

    The reference of a session authorizes its holder to act as the robot: its key is secret, and survives restarts. Only
    its digest is stored: after a restart, the first call to a session finds it."""

    def __init__(self, orb: Orb, store: SimulationStore, remote_map: RemoteMap, settings: SimulationSettings) -> None:
        self._orb, self._store, self._map = orb, store, remote_map
        self._state, host, channel = settings.server.state, settings.server.endpoint.host, settings.channel
        self.agent = ManagementAgent(
            remote_map.building,
            remote_map.version,
            store,
            publish=self._publish,
            session_began=self._session_began,
            session_ended=self._session_ended,
            lineage_since=remote_map.lineage,
        )
        self._announcer = Announcer(orb, channel, self.agent.database) if channel else None
        self._stops = EmergencyStops(
            self._state / STOPS,
            lambda: list(self.agent.sessions.values()),
            lambda: self.agent.loop.is_paused,
            lambda target, reason, number: stop_at(orb, target, reason, number),
            self._announcer.announce_stop if self._announcer else lambda robots, reason: None,
        )
        self._sensors = RemoteSensors(self.agent.load_balance)
        admission = SensorAdmission(system_token(self._state / SENSOR_TOKEN), self._state / PORTS, host)
        self._registered_sensors = RegisteredSensors(
            orb,
            admission,
            lambda name, reference: SensorRegistrationServant(self.agent, name, reference, self._sensors.dismiss),
        )
        self._monitor = Monitor(self.agent, remote_map.building)
        self._layer_check = Repeating("layers", lambda: self._monitor.forget_unused(), LAYER_CHECK_INTERVAL_S)
        self._map_check = Repeating("map", self._follow_map, MAP_CHECK_INTERVAL_S)
        self._missions, leaders = MissionDirectory(store), RemoteLeaders(orb)
        nearest = self.agent.robots_near
        self._mission_control = MissionControl(self._missions, leaders, nearest)
        self._leader_watch = LeaderWatch(self._missions, leaders, self._is_logged_on, nearest=nearest)
        self._leader_check = Repeating("leaders", self._leader_watch.check, LEADER_CHECK_INTERVAL_S)

    def start(self) -> None:
        """Start the simulation, accept calls, and write the administrator's reference to its file."""
        self._orb.serve_secrets(self._find)
        self._stops.start()
        for session in self.agent.sessions.values():
            self._sensor_object(session)
        file = self._state / ADMINISTRATOR
        key = _ADMINISTRATOR + self._administrator_secret(file)
        administrator = self._orb.activate_secret(SimulationAdministratorServant(self.agent, self._stops), key)
        write_reference(self._orb, administrator, file)
        self.agent.start()
        self._map_check.start()
        self._layer_check.start()
        if self._announcer:
            self._announcer.start()
        servant = SimulationServerServant(
            self.agent,
            self._reference_of,
            lambda floor, width: self._monitor.png(floor, width),
            self._stops,
            self._registered_sensors,
        )
        database = OmniDatabaseServant(self.agent.database, self._missions, self._publish_typed)
        control = MissionControlServant(self._mission_control)
        limit_calls(servant, database, control)
        self._orb.serve({"SimulationServer": servant, "OmniDatabase": database, "MissionControl": control})
        self.agent.begin_leases()
        self._leader_check.start()

    def close(self) -> None:
        self._leader_watch.close()
        self._map_check.close()
        self._layer_check.close()
        self._leader_check.close()
        if self._announcer:
            self._announcer.close()
        self._sensors.close()
        self._stops.close()
        self.agent.close()

    def _administrator_secret(self, file: Path) -> str:
        """The secret in the file, if it is the stored one, else a new one: without the file, nobody knows it."""
        secret = key_in_file(file, _ADMINISTRATOR)
        if not secret or digest_of(secret) != self._store.administrator():
            secret = secrets.token_urlsafe(24)
            self._store.save_administrator(digest_of(secret))
        return secret

    def _reference_of(self, session: Session) -> Any:
        return self._orb.activate_secret(self._servant_of(session), _SESSION + session.client.secret)

    def _find(self, key: str) -> Any:
        """The servant of a restored session when it is called."""
        secret = key.removeprefix(_SESSION)
        session = self.agent.sessions.get(digest_of(secret))
        if session is None or secret == key:
            return None
        session.client.secret = secret
        return self._servant_of(session)

    def _servant_of(self, session: Session) -> RobotSessionServant:
        lease_s, sensor = self.agent.registry.lease_s, self._sensor_object(session)
        return RobotSessionServant(session, lease_s, sensor, self._stops, self._orb.uri)

    def _sensor_object(self, session: Session) -> Any:
        sensor = RobotSensorServant(functools.partial(self._sensor_of, session.client))
        return self._orb.activate(sensor, _sensor_key(session))

    def _sensor_of(self, client: RobotClient) -> Any:
        """Wait for a sensor server if there is none; the robot keeps its lease meanwhile. Raises CORBA.TRANSIENT."""
        client.begin_call()
        try:
            return self._sensors.find(client.name)
        finally:
            client.end_call()

    def _session_began(self, session: Session) -> None:
        self._stops.admit(session)

    def _session_ended(self, session: Session) -> None:
        if session.client.secret:
            self._orb.deactivate_secret(_SESSION + session.client.secret)
        self._orb.deactivate_key(_sensor_key(session))
        self._stops.forget(session)

    def _publish(self, event: SimulationEvent) -> None:
        if self._announcer:
            self._announcer.announce(event)

    def _publish_typed(self, floor: str) -> float:
        return self._announcer.publish_typed(floor) if self._announcer else 0.0

    def _is_logged_on(self, robot: str) -> bool:
        try:
            self.agent.registry.find(robot)
        except UnknownRobot:
            return False
        return True

    def _follow_map(self) -> None:
        with contextlib.suppress(NotReachable):
            self._map.follow()
            present = self.agent.state.map_version
            if self._map.version != present:  # also after a failed attempt
                self.agent.follow_map(self._map.building, self._map.version, self._map.lineage(present))
                self._monitor = Monitor(self.agent, self._map.building)


def _sensor_key(session: Session) -> str:
    """Derived from the session's secret without revealing it: a robot may share its sensor."""
    return f"sensors/{digest_of(session.client.key)}"


def preload() -> None:
    """Compile or load the kernels."""
    physics.warm_up()
    omni_database.warm_up()


def main(arguments: Sequence[str] | None = None) -> None:
    settings = SimulationSettings.read(arguments, __doc__ or "")
    state = settings.server.state
    claim_state(state)
    logs.setup("simulation", state / "logs")
    cores.share_one()  # with the threads of all robots' connections
    with (
        SimulationStore(state / "simulation.sqlite") as store,
        Orb(settings.server.naming, settings.server.endpoint, options=MANY_CONNECTIONS) as orb,
        contextlib.closing(SimulationServer(orb, store, RemoteMap(orb), settings)) as server,
    ):
        server.start()
        orb.run()


if __name__ == "__main__":
    main()
