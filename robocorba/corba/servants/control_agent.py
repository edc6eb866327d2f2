"""Servant of a robot's control agent."""

from __future__ import annotations

from typing import Any

from robocorba.control import model_switcher
from robocorba.control.agent import ControlAgent
from robocorba.corba.conversion import robot
from robocorba.corba.conversion.errors import translating
from robocorba.programs import program
from robocorba.stubs import RoboCorba__POA


class RobotAgentServant(RoboCorba__POA.RobotAgent):
    """RoboCorba::RobotAgent. pool: the reference of its data pool."""

    def __init__(self, agent: ControlAgent, pool: Any) -> None:
        self._agent, self._pool = agent, pool

    def _get_name(self) -> str:
        return self._agent.name

    @translating
    def _get_state(self) -> Any:
        return robot.agent_state(self._agent.state)

    def _get_pool(self) -> Any:
        return self._pool

    @translating
    def loadProgram(self, json: str) -> None:
        self._agent.load(program.loads(json))

    @translating
    def run(self, stepping: bool) -> None:
        self._agent.run(stepping)

    def iconsFrom(self, number: int) -> list[Any]:
        return [robot.begun(icon) for icon in self._agent.begun(number)]

    @translating
    def pause(self) -> None:
        self._agent.pause()

    @translating
    def resume(self) -> None:
        self._agent.resume()

    @translating
    def step(self) -> None:
        self._agent.step()

    def abort(self) -> None:
        self._agent.abort()

    def stop(self) -> None:
        self._agent.stop()

    @translating
    def resetStop(self) -> None:
        self._agent.reset_stop()

    @translating
    def switchAdaptor(self, adaptor: str, arguments: list[str]) -> None:
        self._agent.switch(adaptor, arguments)

    def adaptors(self) -> list[str]:
        return model_switcher.installed()

    @translating
    def setSpeedCap(self, speed: float) -> None:
        self._agent.cap_speed(speed)
