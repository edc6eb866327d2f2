"""The agent on an actual robot's own computer: it keeps map and programs, runs these without the servers, and reports
when somebody asks."""

from __future__ import annotations

import contextlib
import logging
import secrets
import threading
from collections.abc import Callable, Sequence
from typing import Any

from robocorba.clients.program_checker import Checker
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder, MissionFailed
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.map_editor import native
from robocorba.map_editor.corba.remote_map import RemoteMap
from robocorba.orb.orb import Orb
from robocorba.robot.agent import AgentCalls, ControlAgent
from robocorba.robot.agent_state import AgentState
from robocorba.robot.body_in_building import BodyInBuilding
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.corba.adaptor_servant import RobotSensorsServant
from robocorba.robot.corba.control_agent_servant import RobotAgentServant, StopTargetServant
from robocorba.robot.corba.data_pool_servant import DataPoolServant
from robocorba.robot.corba.remote_session import RemoteSession
from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.robot.corba.stop_listener import listen_for_stops
from robocorba.robot.data_pool.plans import Plans
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.postures import PoolPostures
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, MASS_KG, RADIUS_M
from robocorba.robot.local_map import LocalFloor, LocalMap, kept_map
from robocorba.robot.local_session import LocalSession, kept_pose
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs import program
from robocorba.robot.programs.icons import Icon, kind
from robocorba.robot.programs.local_checks import check_without_servers
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.runner import ReceivedEvent
from robocorba.robot.tick_file import TickFile
from robocorba.robot.uploads import CheckedPrograms, Uploads
from robocorba.simulation.registry import Description, Pose
from robocorba.system.names import ROBOT_AGENT, ROBOTS
from robocorba.system.printing import echo
from robocorba.system.record_file import RecordFile
from robocorba.system.repeating import Repeating
from robocorba.system.settings import InvalidSetting, RobotSettings

#: Identifies the file of an agent: "RoCr".
APPLICATION_ID = 0x526F4372
#: How long an agent waits for its first map, and a call of a server, which only background threads make [s].
FIRST_MAP_S, CALL_TIMEOUT_S = 300.0, 3.0

_log = logging.getLogger(__name__)


class ChannelOnly:
    """Events of the robot's channel, and no part in missions."""

    mission = ""

    def __init__(self, channel: RobotChannel) -> None:
        self._channel = channel

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[ReceivedEvent], None]) -> None:
        """Raises EventError, NotReachable."""
        self._channel.subscribe(
            patterns, lambda type, source, payload, origin: receive(ReceivedEvent(type, source, payload))
        )

    def publish(self, type: str, payload: Any) -> None:
        """Raises EventError, NotReachable."""
        self._channel.publish(type, payload, 5.0)

    def cooperate(self, icon: Icon, mission: str) -> None:
        """Raises MissionFailed."""
        raise MissionFailed(f"{kind(icon)} needs the building's servers, and this agent runs without them")

    def lead_mission(self, mission: str, program: Program, term: int = 0) -> None:
        """Raises IllegalOrder."""
        raise IllegalOrder("lead a mission", "is without the building's servers")

    def abort_mission(self, mission: str) -> None:
        """Raises UnknownMission."""
        raise UnknownMission(mission)


class MapCopy:
    """Keeps the map like the map editor's whenever that answers. Thread-safe."""

    def __init__(self, orb: Orb, place: LocalMap, remote: RemoteMap | None) -> None:
        self._orb, self._place, self._remote = orb, place, remote
        self._lock = threading.Lock()

    def follow(self) -> None:
        with self._lock, contextlib.suppress(NotReachable):
            self._remote = remote = self._remote or RemoteMap(self._orb, 1.0, with_topology=True)
            remote.follow()
            if (remote.building.name, remote.version) != (self._place.building.name, self._place.version):
                self._place.take(remote.building, remote.version)

    def identity(self) -> tuple[str, int]:
        """Name and version of the map, as new as possible."""
        self.follow()
        return self._place.building.name, self._place.version


def run_alone(settings: RobotSettings) -> None:
    """Serve until SIGTERM or SIGINT."""
    name, state = settings.name, settings.common.state
    wanted = program.load(settings.program) if settings.program else None
    with contextlib.ExitStack() as stack:
        records = stack.enter_context(RecordFile(state / f"agent-{name}.sqlite", APPLICATION_ID, 1))
        orb = stack.enter_context(Orb(settings.common.naming, settings.endpoint, call_timeout_s=CALL_TIMEOUT_S))
        last = kept_pose(records)
        place, copy = _maps(orb, records, last.floor if last else settings.floor)
        if last is None and settings.at is None:
            raise InvalidSetting("--at", "", "an agent that has not seen its robot yet needs the robot's pose")
        start = last or Pose(place.floor, *(settings.at or ()))
        if last and settings.at:
            _log.info("--at is for the first start only; the robot was at %.2f, %.2f on %s", last.x, last.y, last.floor)
        place.planner.warm_up()
        checker = Checker(place)

        def robot_state() -> RobotState:
            return agent.actor or RobotState(x=start.x, y=start.y, heading=start.heading)

        session = LocalSession(records, start, robot_state)
        uploads = Uploads(records)
        others = ChannelOnly(stack.enter_context(contextlib.closing(RobotChannel(orb, settings.channel or "", name))))
        floor = LocalFloor(place, name, robot_state)
        pool = DataPool(floor.changes, place.of, place.floor, name)
        nearby = Nearby(pool, name)
        ticks = TickFile(settings.tick_file) if settings.tick_file else None
        if ticks:
            stack.callback(ticks.close)

        def check_now(wanted: Program, state: AgentState) -> CheckReport:
            report = check_without_servers(wanted, place.floor, bool(settings.channel))
            if not report.is_valid:
                return report
            return checker(wanted, state, nearby.movable_objects(), senses=agent.senses)

        calls = AgentCalls(check_now, note=uploads.note)
        context = AdaptorContext(name, session, orb, last)
        agent = ControlAgent(context, place, others, nearby, ticks, calls, settings.protects)
        stack.callback(agent.close)
        agent.start(settings.adaptor, settings.adaptor_arguments)
        for title, task, every_s in (
            ("data pool", pool.follow, 0.033),
            ("data pool's map", pool.follow_map, 0.5),
            ("map", copy.follow, 2.0),
            ("pose", session.keep_pose, 0.5),
        ):
            stack.callback(Repeating(title, task, every_s).start().close)
        if wanted:
            agent.load(wanted)
            agent.run()
        elif uploads.program:
            try:
                agent.load(uploads.program)
            except RoboCorbaError as error:  # it may stand elsewhere now
                _log.warning("the program that was uploaded last is not loaded: %s", error)
        remote = RemoteSession(orb, Description(name, start, RADIUS_M, MASS_KG, BASE_LIMITS))
        body = BodyInBuilding(remote, agent)
        stack.callback(body.leave)
        stops = StopTargetServant(agent, body.stop)
        remote.stop_target = orb.activate(stops, f"stop/{secrets.token_urlsafe(24)}")
        programs = CheckedPrograms(agent, copy.identity, uploads)
        _serve(stack, orb, settings, agent, pool, others, programs, lambda: remote.is_logged_on)
        stack.callback(Repeating("body", body.follow, lambda: body.pause_s).start().close)
        echo("ready")
        orb.run()


def _maps(orb: Orb, records: RecordFile, floor: str) -> tuple[LocalMap, MapCopy]:
    """The map on this computer, and its copier. floor: empty for the first one."""
    kept, remote = kept_map(records), None
    if kept:
        building, version = native.loads(kept.text), kept.version
    else:
        remote = RemoteMap(orb, FIRST_MAP_S, with_topology=True)
        building, version = remote.building, remote.version
    place = LocalMap(records, building, version, floor or next(iter(building.floors), ""))
    if remote:
        place.take(building, version)
    return place, MapCopy(orb, place, remote)


def _serve(
    stack: contextlib.ExitStack,
    orb: Orb,
    settings: RobotSettings,
    agent: ControlAgent,
    pool: DataPool,
    others: ChannelOnly,
    programs: CheckedPrograms,
    owns_name: Callable[[], bool],
) -> None:
    name, channel = settings.name, settings.channel or ""
    path = f"{ROBOTS}/{name}"
    postures = PoolPostures(lambda floor, since: [], lambda: pool.floor)
    pool_reference = orb.activate(DataPoolServant(pool, Plans(), postures), f"{path}/pool")
    sensors = orb.activate(RobotSensorsServant(lambda: agent.senses), f"{path}/sensors")

    def servant() -> RobotAgentServant:
        return RobotAgentServant(agent, pool_reference, sensors, channel, others, programs)

    orb.activate_for_all(servant(), ROBOT_AGENT)
    orb.serve({path: servant()}, owns_name)
    if channel:
        stops = RobotChannel(orb, channel, name)
        stack.callback(stops.close)
        listen_for_stops(stops, name, agent.stop)
