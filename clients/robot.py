"""A robot client: a data pool, and a control agent that runs programs on a virtual or an actual robot."""

from __future__ import annotations

import signal

if __name__ == "__main__":  # Ctrl-C while modules are loaded ends the process without a traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import contextlib
import logging
import math
import secrets
import sys
import time
from collections.abc import Callable, Iterable, Sequence

import msgspec
from omniORB import CORBA

from robocorba.clients.cooperation import Cooperation
from robocorba.clients.program_checker import Checker
from robocorba.clients.robot_alone import run_alone
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import PlaceTaken
from robocorba.map_editor.corba.remote_map import elements_of_floor, map_at_editor, path_node_positions
from robocorba.map_editor.geometry import subnet_at
from robocorba.map_editor.model import ElementKind
from robocorba.map_editor.spatial.pose import XY
from robocorba.missions import carry_planning
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.robot import sightings
from robocorba.robot.agent import AgentCalls, AgentState, ControlAgent
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY
from robocorba.robot.corba.adaptor_servant import RobotSensorsServant
from robocorba.robot.corba.control_agent_servant import RobotAgentServant, StopTargetServant
from robocorba.robot.corba.data_pool_servant import DataPoolServant
from robocorba.robot.corba.remote_data_pool import PoolFollower, floor_now
from robocorba.robot.corba.remote_session import RemoteSession
from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.robot.corba.stop_listener import listen_for_stops
from robocorba.robot.data_pool.plans import Plans
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.start_places import start_places
from robocorba.robot.display import Display
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, MASS_KG, RADIUS_M
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.perception import Perception
from robocorba.robot.posture_report import INTERVAL_S, REFRESH_S, PostureReport
from robocorba.robot.programs import program
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.realtime import raise_process_priority
from robocorba.robot.sightings import EXPIRY_S, SharedSightings, SightingReport, seen_obstacles
from robocorba.robot.tick_file import TickFile
from robocorba.robot.uploads import CheckedPrograms
from robocorba.simulation.registry import Description, Pose
from robocorba.system import logs
from robocorba.system.kernel_store import store
from robocorba.system.names import CHANNELS, MISSIONS, ROBOTS, SIGHTING_EVENT
from robocorba.system.printing import fail
from robocorba.system.private_files import claim_state
from robocorba.system.processes import RobotProgress
from robocorba.system.repeating import Repeating
from robocorba.system.settings import RobotSettings

#: Longest wait for the naming service before a robot says that it is ready [s]: it can do without its name.
BINDING_LIMIT_S = 5.0

_log = logging.getLogger(__name__)


def log_on(session: RemoteSession, orb: Orb, settings: RobotSettings) -> None:
    """Log on at the settings' pose, by default at the first free path node or beside one. Raises as
    `RemoteSession.log_on`."""
    if settings.at:
        session.log_on(Pose(settings.floor, *settings.at))
        return
    nodes = list(path_node_positions(orb, settings.floor))
    floor = nodes[0][0] if nodes else settings.floor
    places: Iterable[XY] = [(x, y) for _, x, y in nodes]
    with contextlib.suppress(NotReachable):  # without the floor's state, the server says which nodes are free
        places = start_places(list(places), floor_now(orb, floor), RADIUS_M)
    for place in places:
        with contextlib.suppress(PlaceTaken):  # another robot may be quicker
            session.log_on(Pose(floor, *place))
            return
    raise PlaceTaken(floor, 0.0, 0.0, "all path nodes and the places near them are occupied; give a place by --at X,Y")


def channel_for(orb: Orb, wanted: str | None, at: Pose) -> str:
    """The event channel of a robot that has logged on: `wanted`, by default that of the sub-network of its area if
    there is such a channel; empty for none."""
    channel, source = wanted or "", ""
    try:
        if wanted is None:
            areas = [area for _, area in elements_of_floor(orb, ElementKind.AREA, at.floor)]
            channel, source = subnet_at(areas, (at.x, at.y)), "the sub-network of its area "
        known = orb.names(CHANNELS)
    except (RoboCorbaError, CORBA.Exception) as error:
        _log.warning("channels and sub-networks are unknown: %s", error_of(error))
        return channel if wanted else ""
    if channel and channel not in known:
        there = ", ".join(sorted(known)[:40]) or "none"
        _log.warning("%s%s has no event channel; there are %s", source, channel, there)
    return channel if wanted or channel in known else ""


def perceiving(
    stack: contextlib.ExitStack,
    orb: Orb,
    session: RemoteSession,
    pool: DataPool,
    name: str,
    channel: str,
    agent: Callable[[], ControlAgent],
) -> tuple[Nearby, Perception]:
    """What is near a robot that goes by its sensors, until the end of `stack`: a robot in the pool reports its pose if
    its agent has a name; every other one has to be seen, like things that no map has. At the event channel it reports
    others what it sees, and learns what they see."""
    reporting: set[str] = set()

    def listen() -> None:
        with contextlib.suppress(NotReachable):
            names = set(orb.names(ROBOTS))
            reporting.update(names)
            reporting.intersection_update(names)

    listen()
    stack.callback(Repeating("names of robots", listen, 1.0).start().close)
    shared = SharedSightings(name, lambda: perception.obstacles, lambda: (session.latest.at.x, session.latest.at.y))
    nearby = Nearby(
        pool, name, DEFAULT_POLICY, lambda: shared.obstacles, lambda: perception.check(), reporting.__contains__
    )
    perception = Perception(
        senses=lambda: agent().senses,
        floor=lambda: session.latest.at.floor,
        explains=nearby.explains,
        is_needed=lambda: not agent().is_resting,
        carried=lambda: nearby.carried(session.latest.holding),
    )
    if channel:
        events = RobotChannel(orb, channel, name)
        stack.callback(events.close)
        events.keep_subscribed([(SIGHTING_EVENT, "*")], shared.receive)
        report = SightingReport(
            lambda: seen_obstacles(perception.things, time.time()),
            lambda seen: events.publish(SIGHTING_EVENT, msgspec.to_builtins(seen), 0.0, EXPIRY_S),
        )
        stack.callback(Repeating("sightings", report.update, sightings.INTERVAL_S).start().close)
    return nearby, perception


def progress_of(shown: Display, report: ProgramReport) -> RobotProgress:
    """What the robot shows, and how its last task has ended: a failure is shown already."""
    is_said = report.result in (ProgramResult.NO_RESULT, ProgramResult.FAILED)
    result = "" if is_said else ": ".join(filter(None, (report.result.name.lower(), report.reason)))
    return RobotProgress(shown.kind.name.lower(), shown.text, report.name, result)


def run_unless_stopped(agent: ControlAgent) -> None:
    """Run the loaded program. A robot whose name is held waits for its reset; somebody runs the program after that."""
    try:
        agent.run()
    except IllegalOrder as error:
        if not agent.stopped:
            raise
        _log.warning("its program is loaded and does not run: %s", error)


def preload() -> None:
    """Compile or load the kernels, and the robot's model."""
    InverseKinematics()
    carry_planning.warm_up()


def main(arguments: Sequence[str] | None = None) -> None:
    try:
        run(arguments)
    except (RoboCorbaError, CORBA.Exception) as error:
        fail(f"robot: {error_of(error)}")
    except KeyboardInterrupt:  # while it starts
        sys.exit(130)


def run(arguments: Sequence[str] | None) -> None:
    settings = RobotSettings.read(arguments, __doc__ or "")
    claim_state(settings.common.state)
    logs.setup(f"robot_{settings.name}", settings.common.state / "logs")
    if not store().is_complete:
        from robocorba.commands.compiling import compile_with_progress  # loads what is needed once on a machine

        compile_with_progress(settings.common.state / "logs")
    raise_process_priority()
    if settings.is_agent_only:
        run_alone(settings)
        return
    wanted = program.load(settings.program) if settings.program else None
    start = Pose(settings.floor, *(settings.at or (0.0, 0.0, 0.0)))
    with Orb(settings.common.naming, settings.endpoint) as orb, contextlib.ExitStack() as stack:
        stack.enter_context(settings.common.hinting(orb.check_naming))
        planner = RemotePlanner(orb)
        # Before logging on: while kernels compile, the robot sends no heartbeat, and its lease would expire.
        checker = Checker(planner)
        if settings.channel != "":
            carry_planning.warm_up()
        session = RemoteSession(orb, Description(settings.name, start, RADIUS_M, MASS_KG, BASE_LIMITS))
        log_on(session, orb, settings)
        channel = channel_for(orb, settings.channel, session.state().at)
        plans = Plans()
        reports = settings.common.state / MISSIONS
        others = Cooperation(orb, channel, settings.name, plans, reports)
        stack.callback(others.close)
        ticks = TickFile(settings.tick_file) if settings.tick_file else None
        if ticks:
            stack.callback(ticks.close)
        # What follows the robot rests while it does; the first task, or a reader of the pool, wakes it.
        follower = PoolFollower(
            *(orb, session.state().at.floor, settings.name),
            floor_of_robot=lambda: session.latest.at.floor,
            rests=lambda: agent.is_resting,
        )
        stack.callback(follower.close)
        posture = PostureReport(lambda: agent.joints, session.report_posture)
        postures = Repeating("posture", posture.update, lambda: REFRESH_S if agent.is_resting else INTERVAL_S)
        progress = Repeating(
            "progress", lambda: print(progress_of(agent.display, agent.state.program).line(), flush=True), math.inf
        )

        def prepare() -> None:
            follower.attend()
            postures.wake()
            if perception:
                perception.wake()

        nearby, perception = Nearby(follower.pool, settings.name), None
        if settings.perceives:
            nearby, perception = perceiving(stack, orb, session, follower.pool, settings.name, channel, lambda: agent)

        def check_now(wanted: Program, state: AgentState) -> CheckReport:
            follower.attend()
            objects = nearby.movable_objects(session.latest.holding)
            return checker(wanted, state, objects, nearby.parked_robots(), agent.senses)

        context = AdaptorContext(settings.name, session, orb)
        calls = AgentCalls(check_now, prepare, progress.wake, perception.observe if perception else None)
        agent = ControlAgent(context, planner, others, nearby, ticks, calls, settings.protects, settings.perceives)
        stack.callback(agent.close)
        session.stop_target = orb.activate(StopTargetServant(agent), f"stop/{secrets.token_urlsafe(24)}")
        session.floors_since = follower.floors_since
        follower.start()
        agent.start(settings.adaptor, settings.adaptor_arguments)
        if perception:
            stack.callback(perception.start().close)
        stack.callback(postures.start().close)

        def attend() -> None:
            agent.refresh()
            follower.attend()

        path = f"{ROBOTS}/{settings.name}"
        pool = orb.activate(DataPoolServant(follower.pool, plans, follower.postures, attend), f"{path}/pool")
        sensors = orb.activate(RobotSensorsServant(lambda: agent.senses), f"{path}/sensors")
        # One that was logged off must leave the name to another robot that has logged on by it.
        programs = CheckedPrograms(agent, map_at_editor(orb))
        servants = {path: RobotAgentServant(agent, pool, sensors, channel, others, programs)}
        orb.serve(servants, owns_names=lambda: session.is_logged_on)
        if channel:
            stops = RobotChannel(orb, channel, settings.name)
            stack.callback(stops.close)
            listen_for_stops(stops, settings.name, agent.stop)
        others.start(agent, follower.pool)
        if wanted:
            agent.load(wanted)
            run_unless_stopped(agent)
        orb.wait_until_bound(BINDING_LIMIT_S)
        print("ready", flush=True)
        if not channel:
            _log.warning("%s has no event channel: it takes part in no mission", settings.name)
        if settings.prints_progress:
            stack.callback(progress.start().close)
        orb.run()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # logs off
    main()
