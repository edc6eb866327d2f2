"""Robots as mission control calls them."""

from __future__ import annotations

from typing import Any

from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.stubs import RoboCorba
from robocorba.system.names import ROBOTS

#: Timeout to find a robot, and of a call [s].
RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S = 1.0, 2.0
#: Timeout of the start of a mission, before which the robot checks its program [s].
START_TIMEOUT_S = 10.0


class RemoteLeaders:
    """The robots whose agents are bound. All methods raise NotReachable."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

    def start(self, leader: str, mission: str, icon: str, term: int) -> None:
        """Let a robot lead a mission in this term. Raises InvalidProgram, IllegalOrder."""
        agent = self._agent(leader, START_TIMEOUT_S)
        with translated(f"robot {leader}"):
            try:
                agent.leadMission(mission, icon, term)
            except CORBA.BAD_OPERATION:  # a robot of release 0.1.0
                agent.startMission(mission, icon)

    def abort(self, leader: str, mission: str) -> None:
        """Abort a mission. Raises UnknownMission if the robot does not lead it."""
        agent = self._agent(leader, CALL_TIMEOUT_S)
        with translated(f"robot {leader}"):
            agent.abortMission(mission)

    def mission_of(self, leader: str) -> str:
        """The mission that a robot leads or takes part in; empty for none."""
        agent = self._agent(leader, CALL_TIMEOUT_S)
        with translated(f"robot {leader}"):
            return str(agent._get_mission())

    def leads(self, leader: str, mission: str) -> bool:
        """Whether a robot answers that it leads a mission, or takes part in it."""
        try:
            return self.mission_of(leader) == mission
        except NotReachable:
            return False

    def _agent(self, name: str, call_timeout_s: float) -> Any:
        return self._orb.resolve(f"{ROBOTS}/{name}", RoboCorba.RobotAgent, RESOLVE_TIMEOUT_S, call_timeout_s)
