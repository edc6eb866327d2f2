"""Robot agents, called from other processes: what operators and leaders use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from omniORB import CORBA

from robocorba.control.agent import AgentState
from robocorba.control.runner import Begun
from robocorba.corba.calls import describe, limit_calls
from robocorba.corba.conversion import robot
from robocorba.corba.conversion.errors import domain_error
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.names import ROBOTS
from robocorba.stubs import RoboCorba

#: Of a call; to take another robot over takes longer, s.
CALL_LIMIT_S, SWITCH_LIMIT_S = 3.0, 40.0
Answer = TypeVar("Answer")


class RemoteAgent:
    """The agent of the robot called `name`. Raises NotReachable where it is not there within `timeout_s`; every call
    where it does not answer."""

    def __init__(self, orb: Orb, name: str, timeout_s: float = 3.0) -> None:
        self.name = name
        self._agent = orb.resolve(f"{ROBOTS}/{name}", RoboCorba.RobotAgent, timeout_s, CALL_LIMIT_S)
        self._patient = orb.reference(orb.uri(self._agent), RoboCorba.RobotAgent)
        limit_calls(self._patient, SWITCH_LIMIT_S)

    def state(self) -> AgentState:
        return robot.agent_state_of(self._call(self._agent._get_state))

    def load(self, json: str) -> None:
        """Raises InvalidProgram, IllegalOrder."""
        self._call(lambda: self._patient.loadProgram(json))

    def run(self, is_stepping: bool = False) -> None:
        """Raises IllegalOrder."""
        self._call(lambda: self._agent.run(is_stepping))

    def begun(self, first: int) -> list[Begun]:
        """Icons that have begun, from a number on."""
        return [robot.begun_of(struct) for struct in self._call(lambda: self._agent.iconsFrom(first))]

    def pause(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.pause)

    def resume(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.resume)

    def step(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.step)

    def abort(self) -> None:
        self._call(self._agent.abort)

    def stop(self) -> None:
        """Emergency."""
        self._call(self._agent.stop)

    def reset_stop(self) -> None:
        """Raises IllegalOrder, AdaptorFailed."""
        self._call(self._patient.resetStop)

    def switch(self, adaptor: str, argv: Sequence[str]) -> None:
        """Raises UnknownAdaptor, IllegalOrder, AdaptorFailed."""
        self._call(lambda: self._patient.switchAdaptor(adaptor, list(argv)))

    def cap_speed(self, speed: float) -> None:
        """m/s. Raises InvalidChoice."""
        self._call(lambda: self._agent.setSpeedCap(speed))

    def _call(self, call: Callable[[], Answer]) -> Answer:
        try:
            return call()
        except CORBA.UserException as wrong:
            raise (domain_error(wrong) or wrong) from None
        except CORBA.SystemException as wrong:
            raise NotReachable(f"robot {self.name} does not answer ({describe(wrong)})") from None


def robots(orb: Orb) -> list[str]:
    """Names of the robots whose agents are bound. Raises NotReachable."""
    return orb.names(ROBOTS)
