"""The robots of a system in which missions lose some: replaced before a mission, and checked after it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from functools import partial

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.simulation.registry import Pose
from testkit.missions import MissionSystem, RobotStart
from testkit.processes import eventually

#: Time limits for the robots to be free after a mission, and for those that were killed to be logged off [s].
FREE_LIMIT_S, GONE_LIMIT_S = 40.0, 10.0


class Crew:
    """As many robots as there are `starts`. item: what they carry. members: those that run, with their start."""

    def __init__(self, place: MissionSystem, starts: Sequence[RobotStart], item: str) -> None:
        self.place, self._starts, self._item = place, starts, item
        self.members: dict[str, RobotStart] = {}
        self._count = 0
        self.restore()

    def restore(self) -> None:
        """Start robots in place of those that are gone, far from all others, so that each sub-network has some."""
        channels = {start.channel for start in self._starts}
        while len(self.members) < len(self._starts):
            missing = channels - {start.channel for start in self.members.values()}
            start = max(self._starts, key=partial(_gap_m, list(self.place.poses().values())))
            self._count += 1
            name = f"r{self._count}"
            self.members[name] = start._replace(channel=min(missing)) if missing else start
            self.place.start({name: self.members[name]})

    def kill(self, name: str) -> None:
        """kill -9 a robot."""
        process = self.place.robots.pop(name)
        process.kill()
        process.communicate()
        self.members.pop(name)

    def aftermath(self) -> list[str]:
        """Errors in the state of robots and object after a mission."""
        wrong: list[str] = []
        names = list(self.members)
        for name in names:
            with contextlib.suppress(RoboCorbaError):
                agent = self.place.agent(name)
                if agent.state().condition is AgentCondition.STOPPED and not _soon(partial(_reset, agent), 15.0):
                    wrong.append(f"the emergency stop of {name} cannot be reset")
        if not _soon(lambda: all(map(self.place.is_free, names)), FREE_LIMIT_S):
            wrong.append(f"not free: {[name for name in names if not self.place.is_free(name)]}")
        if not _soon(lambda: self.place.names() == set(names), GONE_LIMIT_S):
            wrong.append(f"logged on: {self.place.names()}, expected: {names}")
        if held := self.place.holding():
            wrong.append(f"still held: {held}")
        if not self.place.is_stationary((*names, self._item)):
            wrong.append("something moves")
        return wrong


def _gap_m(poses: Sequence[Pose], start: RobotStart) -> float:
    """Distance of a start pose from the nearest of `poses` [m]."""
    near = (math.dist((start.x, start.y), at[1:3]) for at in poses if at.floor == start.floor)
    return min(near, default=math.inf)


def _reset(agent: RemoteAgent) -> bool:
    try:
        agent.reset_stop()
    except NotReachable:
        raise
    except RoboCorbaError:
        return agent.state().condition is not AgentCondition.STOPPED
    return True


def _soon(is_so: Callable[[], bool], limit_s: float) -> bool:
    try:
        return bool(eventually(is_so, limit_s))
    except AssertionError:
        return False
