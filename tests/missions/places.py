"""Robots of one process that talk over a bus in memory: their missions are real, and so is the building."""

from __future__ import annotations

import fnmatch
import itertools
import threading
from collections.abc import Callable, Sequence
from typing import Any

import msgpack

from robocorba.collision_avoidance.neighbours import PoolNearby
from robocorba.control.agent import ControlAgent
from robocorba.control.model_switcher import AdaptorContext
from robocorba.data_pool.pool import DataPool
from robocorba.errors.services import NotReachable
from robocorba.missions.leader import Leader
from robocorba.missions.mission_agent import MissionAgent
from robocorba.missions.subplan import CooperativePlan, Step, SubPlan, Wait
from robocorba.missions.transport import Transport
from robocorba.planning.request import Place as Spot
from robocorba.repeating import Repeating
from robocorba.simulation.registry import Pose
from tests.control.places import Channel, Place

#: Data pools follow the building so often, s.
FOLLOW_S = 0.033
_numbers = itertools.count()
Receive = Callable[[str, str, Any, str], None]


class Bus:
    """An event channel in memory. `cut`: robots that neither send nor receive events."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listening: dict[int, tuple[str, Sequence[tuple[str, str]], Receive]] = {}
        self.cut: set[str] = set()
        self.said: list[tuple[str, str]] = []

    def end(self, name: str) -> BusEnd:
        return BusEnd(self, name)

    def publish(self, source: str, type: str, payload: Any) -> None:
        content = msgpack.unpackb(msgpack.packb(payload), strict_map_key=False)
        with self._lock:
            self.said.append((source, type))
            listening = list(self._listening.values())
        for name, patterns, receive in listening:
            if {name, source} & self.cut:
                continue
            if any(fnmatch.fnmatch(type, each) and fnmatch.fnmatch(source, who) for each, who in patterns):
                receive(type, source, content, "bus")

    def subscribe(self, key: int, name: str, patterns: Sequence[tuple[str, str]], receive: Receive) -> None:
        with self._lock:
            self._listening[key] = (name, patterns, receive)


class BusEnd:
    """One robot's connection to a bus."""

    def __init__(self, bus: Bus, name: str) -> None:
        self._bus, self._name = bus, name

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        if self._name in self._bus.cut:
            raise NotReachable("the network is cut")
        self._bus.publish(self._name, type, payload)

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Receive) -> None:
        self._bus.subscribe(id(self), self._name, patterns, receive)


class Crew:
    """Robots, each with its control agent and its mission agent."""

    def __init__(self, place: Place, bus: Bus, robots: dict[str, Pose]) -> None:
        self.bus, self.place = bus, place
        self.agents: dict[str, ControlAgent] = {}
        self._missions = []
        self._followers = []
        for name, at in robots.items():
            pool = DataPool(place.agent.database, lambda floor: place.building, at.floor, name)
            self._followers.append(Repeating(f"pool of {name}", pool.follow, FOLLOW_S).start())
            context = AdaptorContext(name, place.session(name, at), None)
            agent = ControlAgent(context, place.planner, Channel(), nearby=PoolNearby(pool, name))
            agent.start("simulated")
            self.agents[name] = agent
            transport = Transport(bus.end(name), name)
            self._missions.append(MissionAgent(transport, agent, lambda thing: None).start())

    def leader(self, name: str) -> Leader:
        agent = self.agents[name]
        course = agent.robot.execution
        course.reset(False)
        transport = Transport(self.bus.end(name), name)
        return Leader(
            f"m{next(_numbers)}",
            transport,
            lambda: Spot(*agent.place[:3]),
            is_interrupted=lambda: str(course.interruption or ""),
        )

    def close(self) -> None:
        for mission in self._missions:
            mission.close()
        for agent in self.agents.values():
            agent.close()
        for follower in self._followers:
            follower.close()


class Given:
    """An expansion whose steps are given: a list of steps for the leader, and one for each helper."""

    def __init__(self, own: Sequence[Step | Wait], *others: Sequence[Step | Wait]) -> None:
        self._steps = [own, *others]
        self.helpers, self.wanted = len(others), frozenset[str]()
        self.meeting_point = Spot("L1", 5.0, 2.0)

    def plan(self, mission: str, leader: str, robots: dict[str, Spot]) -> CooperativePlan:
        names = [leader, *sorted(name for name in robots if name != leader)][: len(self._steps)]
        subplans = tuple(
            SubPlan(name, "leader" if name == leader else "helper", tuple(steps))
            for name, steps in zip(names, self._steps, strict=True)
        )
        phases = tuple(f"phase {number}" for number in range(len(self._steps[0])))
        return CooperativePlan(mission, "test", leader, "nothing", phases, subplans)
