"""Cooperation of a robot with others: it leads missions of its own and takes part in those of others."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import shapely
from shapely import MultiPoint, Point

from robocorba.clients.cooperative_planners import planner_of
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder, MissionFailed, RobotError, StalePlan
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.missions import carry_planning
from robocorba.missions.attempt import LeaderRobot
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.corba.remote_leaders import RemoteLeaders
from robocorba.missions.corba.remote_world import RemoteWorld
from robocorba.missions.execution import pose_in_robot_frame
from robocorba.missions.leader import Leader
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.leader_policy import DEFAULT_POLICY, LeaderPolicy
from robocorba.missions.lookout import Seen
from robocorba.missions.mission_agent import MissionAgent
from robocorba.missions.recorder import LedMission, MissionRecorder, claimed
from robocorba.missions.remaining_carry import RemainingCarry, reservation
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import CooperativePlan, StoredPlan
from robocorba.missions.succession import Succession
from robocorba.missions.transport import Transport
from robocorba.orb.orb import Orb
from robocorba.planning.request import Place
from robocorba.robot.agent import ControlAgent
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.robot.data_pool.plans import Plans
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.execution_control import Aborted, PartEnded
from robocorba.robot.programs.icons import Icon, kind
from robocorba.robot.programs.program import Program, of_icon
from robocorba.robot.runner import ReceivedEvent
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import MissionContent, new_mission_name
from robocorba.system.decoding import convert

#: A program's event must be accepted by the channel within this time [s].
PUBLISH_TIMEOUT_S = 5.0
#: Number of latest plans that the leader's data pool keeps.
MAX_PLANS_KEPT = 20
#: Timeouts to find the Omni database for a record of a mission, and a leader's data pool [s].
RECORD_RESOLVE_S = POOL_RESOLVE_S = 1.0
_log = logging.getLogger(__name__)


class Cooperation:
    """The interface of programs to other robots, and the robot's part in missions.

    plans: of the data pool. reports: folder for the reports of missions that it leads."""

    def __init__(self, orb: Orb, channel: str, name: str, plans: Plans, reports: Path) -> None:
        self._orb, self._channel_name, self._name = orb, channel, name
        self._plans, self._reports = plans, reports
        self._channel = RobotChannel(orb, channel, name)
        self._closing = contextlib.ExitStack()
        self._closing.callback(self._channel.close)
        self._world = RemoteWorld(orb)
        self._records = RemoteDatabase(orb, RECORD_RESOLVE_S)
        self._leaders = RemoteLeaders(orb)
        self._recorder = MissionRecorder(self._records)
        self._closing.callback(self._recorder.close)
        #: Set by `start` if the robot has an event channel.
        self._agent: ControlAgent | None = None
        self._pool: DataPool | None = None
        self._missions: MissionAgent | None = None
        self._lock = threading.Lock()
        #: The mission that the robot leads, and the terms in which it will claim missions; guarded by the lock.
        self._led = ""
        self._terms: dict[str, int] = {}

    def start(self, agent: ControlAgent, pool: DataPool) -> None:
        """Be available for missions, if the robot has an event channel."""
        if not self._channel_name:
            return
        carry_planning.warm_up()
        channel = RobotChannel(self._orb, self._channel_name, self._name)
        self._closing.callback(channel.close)

        def locate(name: str) -> Pose2D | None:
            with contextlib.suppress(NotReachable):
                snapshot = pool.snapshot()  # object and robot after the same simulation step
                item, own = snapshot.object(name), snapshot.robot(self._name)
                if item and own:
                    return pose_in_robot_frame((item.x, item.y, item.heading), (own.x, own.y, own.heading))
            return None

        def can_lead(mission: str) -> bool:
            return agent.is_free or self.is_holding_for(mission)

        def lead(mission: str, icon: dict[str, Any], term: int) -> None:
            program = of_icon(msgspec.json.encode(icon).decode())
            goes_on = self.is_holding_for(mission)
            self.claim(mission, term, lambda: agent.take_over(mission, program, goes_on))

        succession = Succession(self._name, self._records, self._leaders.leads, can_lead, lead)
        self._closing.callback(succession.close)
        transport = Transport(channel, self._name)
        self._missions = missions = MissionAgent(
            transport, agent, locate, on_orphaned=succession.begin, plan_of=self._plan_of
        ).start()
        self._closing.callback(missions.close)
        self._agent, self._pool = agent, pool

    def close(self) -> None:
        self._closing.close()

    # ---- called by programs ----

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[ReceivedEvent], None]) -> None:
        """Subscribe to events. Raises EventError, NotReachable."""
        self._channel.subscribe(
            patterns, lambda type, source, payload, origin: receive(ReceivedEvent(type, source, payload))
        )

    def publish(self, type: str, payload: Any) -> None:
        """Publish an event. Raises EventError, NotReachable."""
        self._channel.publish(type, payload, PUBLISH_TIMEOUT_S)

    @property
    def mission(self) -> str:
        """The mission that the robot leads or takes part in; empty for none."""
        return self._led or (self._missions.mission if self._missions else "")

    def is_holding_for(self, mission: str) -> bool:
        """Whether the robot holds an object for a mission whose leader is silent."""
        return self._missions is not None and self._missions.is_holding_for(mission)

    def lead_mission(self, mission: str, program: Program, term: int = 0) -> None:
        """Lead a mission in the term in which it is offered, 0 if that is not known. Raises InvalidProgram,
        IllegalOrder."""
        if self._agent is None:
            raise IllegalOrder("lead a mission", "has no event channel; start it with --channel")
        agent = self._agent
        self.claim(mission, term, lambda: agent.start_mission(mission, program))

    def claim(self, mission: str, term: int, start: Callable[[], None]) -> None:
        """Begin, by `start`, to lead a mission in this term."""
        with self._lock:
            self._terms[mission] = term
        try:
            start()
        except RoboCorbaError:
            with self._lock:
                self._terms.pop(mission, None)
            raise

    def abort_mission(self, mission: str) -> None:
        """Abort the mission if the robot leads it at present. Raises UnknownMission."""
        with self._lock:  # so that it can't end meanwhile, and another program begin
            if self._agent is None or self._led != mission:
                raise UnknownMission(mission)
            self._agent.abort()

    def cooperate(self, icon: Icon, mission: str = "") -> None:
        """Lead a mission to its end; `mission` names it, empty for a new name. One that another robot leads is taken
        over if the robot claims it in its present term, and that robot does not answer.

        Raises MissionFailed with the reason; Aborted if a user has aborted it; NotReachable."""
        if not self.is_holding_for(mission):  # else its part in the mission goes on by this clock
            OWN_CLOCK.synchronize()
        about, begun = str(getattr(icon, "table", getattr(icon, "object", ""))), OWN_CLOCK.now()
        content = MissionContent(
            kind=kind(icon), about=about, leader=self._name, icon=msgspec.to_builtins(icon), begun=begun
        )
        if mission:
            with self._lock:
                term = self._terms.pop(mission, 0)
            content = claimed(self._records, mission, content, term, self._leaders.leads)
        else:
            mission = new_mission_name(self._name)
        led = LedMission(self._recorder, mission, content, store_plan=self._store_plan)
        self._lead_as(mission)
        try:
            report, is_aborted = self._lead(icon, led, content)
            report.save(self._reports)  # before others see that it has ended
            led.end(report, is_aborted)
        except Exception as error:
            led.fail(str(error) or type(error).__name__, isinstance(error, Aborted))
            raise
        finally:
            self._lead_as("")
        for old in [stored.name for stored in self._plans.all()][:-MAX_PLANS_KEPT]:
            self._plans.remove(old)
        if report.result != "done":
            raise (Aborted if is_aborted else MissionFailed)(report.reason)

    def _lead_as(self, mission: str) -> None:
        with self._lock:
            self._led = mission

    def _inherited(self, mission: str, content: MissionContent, areas: LeaderAreas) -> RemainingCarry | None:
        """What the robots of a former leader hold; None if they do not, or if it is not known what they do."""
        has_areas = self._takes_over_areas([each.robot for each in content.leaders[:-1]], areas)
        if not self.is_holding_for(mission) or self._missions is None or content.plan is None:
            return None
        try:
            plan = convert(content.plan, CooperativePlan)
            inherited = RemainingCarry(self._world, plan)
            self._missions.take_over_reservation(reservation(plan), has_areas)
        except (msgspec.ValidationError, RoboCorbaError) as error:
            _log.warning("mission %s is not carried on: %s", mission, error)
            return None
        return inherited

    def _takes_over_areas(self, leaders: Sequence[str], areas: LeaderAreas) -> bool:
        """Take over what the last of these leaders has reserved. Returns whether there was something."""
        if not leaders:
            return False
        former = leaders[-1]
        try:
            is_taken = areas.take_over(former, lambda: all(each.name != former for each in self._world.robots()))
        except RoboCorbaError as error:
            _log.warning("the areas of %s can't be taken over: %s", former, error)
            return False
        _log.info("areas of %s: %s", former, "taken over" if is_taken else "nothing is kept")
        return is_taken

    def _lead(self, icon: Icon, led: LedMission, content: MissionContent) -> tuple[MissionReport, bool]:
        """The report, and whether a user has aborted the mission."""
        agent = self._agent
        if agent is None:
            raise MissionFailed("the robot has no event channel; start it with --channel")
        make_planner = planner_of(icon)
        execution, areas = agent.robot.execution, LeaderAreas(agent.robot.session)
        is_aborted = False

        def interruption() -> str:
            nonlocal is_aborted
            why = execution.interruption
            if isinstance(why, (PartEnded, MissionFailed)):  # of the robot's own part: then the leader tries again
                return ""
            is_aborted = is_aborted or isinstance(why, Aborted)
            return str(why or "")

        with contextlib.closing(RobotChannel(self._orb, self._channel_name, self._name)) as channel:
            here = (lambda: Place(*agent.place[:3]), areas)
            robot = LeaderRobot(*here, interruption, self._look, execution.awaiting)
            report = Leader(led, Transport(channel, self._name), robot, _policy(icon)).lead(
                kind(icon).replace("_", " "),
                lambda: make_planner(icon, self._world, self._name, robot.place()),
                self._inherited(led.name, content, areas),
            )
        return report, is_aborted

    def _look(self) -> list[Seen]:
        """The robots and movable objects on the floor. Raises NotReachable."""
        if self._pool is None:
            return []
        snapshot = self._pool.current_snapshot()
        found = [
            Seen(
                each.name, True, Point(each.x, each.y).buffer(each.radius_m, quad_segs=8), each.vx, each.vy, each.number
            )
            for each in snapshot.robots
        ]
        objects = (each for each in snapshot.objects() if each.is_movable)
        return found + [
            Seen(each.name, False, shapely.convex_hull(MultiPoint(each.corners)), each.vx, each.vy, each.number)
            for each in objects
        ]

    def _plan_of(self, leader: str, mission: str) -> CooperativePlan | None:
        """A plan in its leader's data pool."""
        try:
            stored = RemotePool(self._orb, leader, POOL_RESOLVE_S).plan(mission)
            return StoredPlan.decode(stored.content).plan
        except (NotReachable, RobotError, msgspec.ValidationError, msgspec.DecodeError) as error:
            _log.info("the plan of mission %s can't be read in the data pool of %s: %s", mission, leader, error)
            return None

    def _store_plan(self, plan: CooperativePlan, phase: str) -> None:
        """Store the plan in the data pool, where other robots and clients can read it."""
        content = StoredPlan(plan, phase).encode()
        for _ in range(2):
            with contextlib.suppress(StalePlan):
                versions = {stored.name: stored.version for stored in self._plans.all()}
                self._plans.put(plan.mission, content, versions.get(plan.mission, 0))
                return


def _policy(icon: Icon) -> LeaderPolicy:
    """The leader's policy with the user's limit."""
    limit_s: float | None = getattr(icon, "recovery_timeout", None)
    return DEFAULT_POLICY if limit_s is None else replace(DEFAULT_POLICY, recovery_timeout_s=limit_s)
