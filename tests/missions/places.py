"""Robots of one process on an event channel in memory: their missions are real, and so is the building. A World that
consists of a map only."""

from __future__ import annotations

import contextlib
import fnmatch
import itertools
import threading
from collections.abc import Callable, Collection, Sequence
from typing import Any

import msgpack

from robocorba.errors.robots import MissionFailed, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.map_editor.geometry import Obstacle, object_geometry
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables, object_outline
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions import leader_policy, member
from robocorba.missions.attempt import LeaderRobot
from robocorba.missions.cooperative_planner import CooperativePlanner
from robocorba.missions.leader import Leader
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.lookout import Look
from robocorba.missions.member import MemberPolicy
from robocorba.missions.mission_agent import MissionAgent
from robocorba.missions.recorder import LedMission, MissionRecorder
from robocorba.missions.subplan import CooperativePlan, Idle, PhaseSteps, Step, plan_of
from robocorba.missions.transport import Transport
from robocorba.missions.world import MovableObject, StandingRobot
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest
from robocorba.planning.request import Place as Spot
from robocorba.robot.agent import ControlAgent
from robocorba.robot.collision_avoidance import policy
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.collision_avoidance.policy import GivingWayPolicy
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MissionContent, decoded
from robocorba.simulation.store import Mission, SimulationStore
from robocorba.system.repeating import Repeating
from tests.robot.places import Channel, Place

#: Interval at which data pools follow the building [s].
FOLLOW_S = 0.033
_numbers = itertools.count()
Receive = Callable[[str, str, Any, str], None]


class Bus:
    """An event channel in memory. disconnected: robots that neither send nor receive events. lost: robots with the
    types of events that they don't receive."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._subscriptions: dict[int, tuple[str, Sequence[tuple[str, str]], Receive]] = {}
        self.disconnected: set[str] = set()
        self.lost: set[tuple[str, str]] = set()

    def publish(self, source: str, type: str, payload: Any) -> None:
        content = msgpack.unpackb(msgpack.packb(payload), strict_map_key=False)
        with self._lock:
            subscriptions = list(self._subscriptions.values())
        for name, patterns, receive in subscriptions:
            if {name, source} & self.disconnected or (name, type) in self.lost:
                continue
            if any(fnmatch.fnmatch(type, types) and fnmatch.fnmatch(source, sources) for types, sources in patterns):
                receive(type, source, content, "bus")

    def subscribe(self, key: int, name: str, patterns: Sequence[tuple[str, str]], receive: Receive) -> None:
        with self._lock:
            self._subscriptions[key] = (name, patterns, receive)


class BusEnd:
    """One robot's connection to a bus."""

    def __init__(self, bus: Bus, name: str) -> None:
        self._bus, self._name = bus, name

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        if self._name in self._bus.disconnected:
            raise NotReachable("disconnected")
        self._bus.publish(self._name, type, payload)

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Receive) -> None:
        self._bus.subscribe(id(self), self._name, patterns, receive)


class NoRecorder(MissionRecorder):
    """There is no database for the records of missions."""

    def __init__(self) -> None: ...

    def record(self, name: str, content: MissionContent) -> None: ...

    def write(self, name: str, content: MissionContent) -> None: ...


class WatchedDirectory(MissionDirectory):
    """note_change: called with the name of each mission that changes, and its records before and after."""

    def __init__(
        self,
        store: SimulationStore,
        clock: Callable[[], float],
        note_change: Callable[[str, MissionContent, MissionContent], None],
    ) -> None:
        super().__init__(store, clock)
        self._note_change = note_change

    def put_mission(self, mission: Mission) -> int:
        before = None
        with contextlib.suppress(UnknownMission):
            before = decoded(self.stored(mission.name).document)
        version = super().put_mission(mission)
        if before and (after := decoded(mission.document)):
            self._note_change(mission.name, before, after)
        return version


class Crew:
    """Robots, each with its control agent and its mission agent."""

    def __init__(
        self,
        place: Place,
        robots: dict[str, Pose],
        leading: LeaderPolicy = leader_policy.DEFAULT_POLICY,
        taking_part: MemberPolicy = member.DEFAULT_POLICY,
        giving_way: GivingWayPolicy = policy.DEFAULT_POLICY,
    ) -> None:
        self.bus, self.place, self._leading = Bus(), place, leading
        self.agents: dict[str, ControlAgent] = {}
        self._missions = []
        self._followers = []
        for name, at in robots.items():
            pool = DataPool(place.agent.database.changes, lambda floor: place.building, at.floor, name)
            self._followers.append(Repeating(f"pool of {name}", pool.follow, FOLLOW_S).start())
            surroundings = AdaptorContext(name, place.session(name, at), None)
            agent = ControlAgent(surroundings, place.planner, Channel(), nearby=Nearby(pool, name, giving_way))
            agent.start("simulated")
            self.agents[name] = agent
            transport = Transport(BusEnd(self.bus, name), name)
            self._missions.append(MissionAgent(transport, agent, lambda thing: None, taking_part).start())

    def leader(
        self,
        name: str,
        leading: LeaderPolicy | None = None,
        look: Look = lambda: (),
        led: type[LedMission] = LedMission,
    ) -> Leader:
        """led: keeps the mission's record."""
        agent = self.agents[name]
        agent.robot.execution.reset(False)
        robot = LeaderRobot(
            lambda: Spot(*agent.place[:3]),
            LeaderAreas(agent.robot.session),
            lambda: str(agent.robot.execution.interruption or ""),
            look,
        )
        content = MissionContent(kind="test", about="nothing", leader=name, begun=1.0)
        kept = led(NoRecorder(), f"m{next(_numbers)}", content)
        return Leader(kept, Transport(BusEnd(self.bus, name), name), robot, leading or self._leading)

    def close(self) -> None:
        """Emergency stops are reset, since they would hold the robots of these names from then on."""
        for mission in self._missions:
            mission.close()
        for agent in self.agents.values():
            if agent.stopped:
                with contextlib.suppress(RobotLost):  # then no stop holds it
                    agent.reset_stop()
            agent.close()
        for follower in self._followers:
            follower.close()


class Given(CooperativePlanner):
    """A CooperativePlanner whose steps are given: a list of steps for the leader, and one for each helper."""

    def __init__(self, own: Sequence[Step | Idle], *others: Sequence[Step | Idle]) -> None:
        self._steps = [own, *others]
        self.helpers, self.required = len(others), frozenset[str]()
        self.meeting_point = Spot("L1", 5.0, 2.0)

    def plan(
        self, mission: str, leader: str, robots: dict[str, Spot], staying: Collection[str] = ()
    ) -> CooperativePlan:
        names = [leader, *sorted(name for name in robots if name != leader)][: len(self._steps)]
        roles = [(name, "leader" if name == leader else "helper") for name in names]
        phases = [PhaseSteps(f"phase {number}", steps) for number, steps in enumerate(zip(*self._steps, strict=True))]
        return plan_of(mission, "test", leader, "nothing", roles, phases)


def first_way(alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
    """Reserve the first one of several ways."""
    return 0


class MapWorld:
    """Objects are at their places on the map; each has the same mass. standing: the robots."""

    def __init__(self, building: Building, mass_kg: float = 2.0, standing: Sequence[StandingRobot] = ()) -> None:
        self.standing = list(standing)
        self._building, self._mass_kg = building, mass_kg
        self._planner = PathPlanner(building)

    def building(self) -> Building:
        return self._building

    def movable(self, name: str) -> MovableObject:
        known = movables(self._building)
        if name not in known:
            raise MissionFailed(f"there is no object {name!r}")
        entry, floor = known[name]
        return MovableObject(name, floor, *entry.at, entry.heading, object_outline(entry), self._mass_kg, entry.height)

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        found: dict[str, list[Obstacle]] = {}
        for name, (entry, floor) in movables(self._building).items():
            if name != carried:
                found.setdefault(floor, []).append(Obstacle("object", name, object_geometry(entry)))
        return found

    def robots(self) -> list[StandingRobot]:
        return self.standing

    def paths(self, request: PathRequest) -> Sequence[Path]:
        return self._planner.paths(request)
