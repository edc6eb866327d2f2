"""Servant of a robot adaptor written in Python, for agents in other processes."""

from __future__ import annotations

import threading
from typing import Any

from robocorba.control.adaptor import RobotAdaptor
from robocorba.corba.conversion import robot
from robocorba.corba.conversion.errors import translating
from robocorba.motion.robot_state import RobotState
from robocorba.stubs import RoboCorba__POA


class RobotAdaptorServant(RoboCorba__POA.RobotAdaptor):
    """RoboCorba::RobotAdaptor for an adaptor written in Python."""

    def __init__(self, adaptor: RobotAdaptor) -> None:
        self._adaptor = adaptor
        self._lock = threading.Lock()

    @translating
    def start(self, arguments: list[str]) -> bool:
        with self._lock:
            return self._adaptor.start(arguments)

    @translating
    def stop(self) -> bool:
        return self._adaptor.stop()

    @translating
    def read(self) -> tuple[bool, Any]:
        state = RobotState()
        with self._lock:
            return self._adaptor.read(state), robot.actor_state(state)

    @translating
    def write(self, wanted: Any) -> bool:
        command = robot.actor_command_of(wanted)
        with self._lock:
            return self._adaptor.write(command)
