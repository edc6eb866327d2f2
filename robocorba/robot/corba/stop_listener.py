"""A robot's subscription to the event of emergency stops."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.system.names import STOP_EVENT
from robocorba.system.repeating import Repeating

#: Pause between attempts to subscribe [s].
RETRY_S = 2.0

_log = logging.getLogger(__name__)


class StopListener:
    """Calls `stop` with a reason when the event arrives at `channel` that names the robot, or names no robot.

    The event comes again for later stops of the same robot; it has no effect on a robot that is stopped."""

    def __init__(self, orb: Orb, channel: str, name: str, stop: Callable[[str], None]) -> None:
        self._channel = RobotChannel(orb, channel, name)
        self._name, self._stop, self._is_subscribed = name, stop, False
        self._problem = ""
        self._repeating = Repeating(
            "stop events", self._subscribe, lambda: math.inf if self._is_subscribed else RETRY_S
        )

    def start(self) -> StopListener:
        self._repeating.start()
        return self

    def close(self) -> None:
        self._repeating.close()
        self._channel.close()

    def _subscribe(self) -> None:
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
            self._stop(str(payload.get("reason") or "emergency stop")[:200])
