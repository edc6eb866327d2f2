"""Servants of a robot adaptor written in Python, for agents in other processes, and of what a robot senses."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from typing import Any

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import AdaptorFailed
from robocorba.orb.exceptions import translating
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.corba import robot_states, senses
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.senses import Senses
from robocorba.stubs import RoboCorba__POA

_log = logging.getLogger(__name__)


def _failing(method: Callable[..., Any]) -> Callable[..., Any]:
    """Any error of an adaptor is a failure of its robot, with the error as its cause."""

    @functools.wraps(method)
    def call(*arguments: Any) -> Any:
        try:
            return method(*arguments)
        except RoboCorbaError:
            raise
        except Exception as error:  # whatever a driver raises
            _log.exception("the adaptor failed")
            raise AdaptorFailed(f"{type(error).__name__}: {error}") from error

    return call


class RobotAdaptorServant(RoboCorba__POA.RobotAdaptor):
    """RoboCorba::RobotAdaptor for an adaptor written in Python."""

    def __init__(self, adaptor: RobotAdaptor) -> None:
        self._adaptor = adaptor
        self._lock = threading.Lock()

    @translating
    @_failing
    def start(self, arguments: list[str]) -> bool:
        with self._lock:
            return self._adaptor.start(arguments)

    @translating
    @_failing
    def stop(self) -> bool:
        return self._adaptor.stop()

    @translating
    @_failing
    def read(self) -> tuple[bool, Any]:
        state = RobotState()
        with self._lock:
            return self._adaptor.read(state), robot_states.actor_state(state)

    @translating
    @_failing
    def write(self, wanted: Any) -> bool:
        command = robot_states.actor_command_of(wanted)
        with self._lock:
            return self._adaptor.write(command)


class RobotSensorsServant(RoboCorba__POA.RobotSensors):
    """RoboCorba::RobotSensors. find: returns the robot's senses now; None without sensors."""

    def __init__(self, find: Callable[[], Senses | None]) -> None:
        self._find = find

    @property
    def _senses(self) -> Senses:
        found = self._find()
        if found is None:
            raise AdaptorFailed("the robot has no sensors")
        return found

    @translating
    @_failing
    def rangeSensors(self) -> list[Any]:
        return [senses.range_sensor(sensor) for sensor in self._senses.sensors]

    @translating
    @_failing
    def ranges(self, name: str) -> Any:
        found = self._senses
        return senses.ranges(found.ranges(name), found.sensor(name))

    @translating
    @_failing
    def readings(self) -> list[Any]:
        return [senses.reading(value) for value in self._senses.readings()]


class SensingAdaptorServant(RoboCorba__POA.SensingAdaptor, RobotAdaptorServant, RobotSensorsServant):
    """RoboCorba::SensingAdaptor for an adaptor with senses written in Python."""

    def __init__(self, adaptor: RobotAdaptor) -> None:
        RobotAdaptorServant.__init__(self, adaptor)
        RobotSensorsServant.__init__(self, lambda: adaptor.senses)
