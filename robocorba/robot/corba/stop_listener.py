"""A robot's subscription to the event of emergency stops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.robot.corba.robot_channel import RobotChannel
from robocorba.system.names import STOP_EVENT


def listen_for_stops(channel: RobotChannel, name: str, stop: Callable[[str], object]) -> None:
    """Call `stop` with a reason when the event arrives at a channel of its own that names the robot `name`, or names no
    robot; until the channel is closed.

    The event comes again for later stops of the same robot; it has no effect on a robot that is stopped."""

    def receive(type: str, source: str, payload: Any, origin: str) -> None:
        if not isinstance(payload, dict) or not isinstance(robots := payload.get("robots"), (list, tuple)):
            return
        if not robots or name in robots:
            stop(str(payload.get("reason") or "emergency stop")[:200])

    channel.keep_subscribed([(STOP_EVENT, "*")], receive)
