"""A robot's subscription to the event of emergency stops."""

from __future__ import annotations

import logging
import math
from typing import Any, Protocol

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.system.names import STOP_EVENT
from robocorba.system.repeating import Repeating

#: Pause between attempts to subscribe [s].
RETRY_S = 2.0

_log = logging.getLogger(__name__)


class Stoppable(Protocol):
    def stop(self, reason: str) -> None:
        """Emergency stop."""


class StopListener:
    """Stops `agent` when the event arrives at `channel` (empty for none) that names the robot, or names no robot.

    The event comes again for later stops of the same robot; it has no effect on a robot that is stopped."""

    def __init__(self, orb: Orb, channel: str, name: str, agent: Stoppable) -> None:
        self._channel = RobotChannel(orb, channel, name) if channel else None
        self._name, self._agent, self._is_subscribed = name, agent, False
        self._problem = ""
        self._repeating = Repeating("stop events", self._subscribe, self._pause_s)

    def start(self) -> StopListener:
        self._repeating.start()
        return self

    def close(self) -> None:
        self._repeating.close()
        if self._channel:
            self._channel.close()

    def _pause_s(self) -> float:
        return math.inf if self._is_subscribed or self._channel is None else RETRY_S

    def _subscribe(self) -> None:
        if self._channel is None:
            return
        try:
            self._channel.subscribe([(STOP_EVENT, "*")], self._receive)
            self._is_subscribed = True
        except (NotReachable, EventError) as error:
            if str(error) != self._problem:
                self._problem = str(error)
                _log.info("no event channel for stops, attempts every %g s: %s", RETRY_S, error)

    def _receive(self, type: str, source: str, payload: Any, origin: str) -> None:
        if not isinstance(payload, dict) or not isinstance(robots := payload.get("robots"), (list, tuple)):
            return
        if not robots or self._name in robots:
            self._agent.stop(str(payload.get("reason") or "emergency stop")[:200])
