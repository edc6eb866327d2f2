"""The event of emergency stops reaches a robot, also by a channel that answers later."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

import pytest

from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event
from robocorba.robot.corba import robot_channel
from robocorba.robot.corba.stop_listener import listen_for_stops
from robocorba.system.names import STOP_EVENT
from tests.robot.places import eventually


def test_events_that_name_the_robot_or_none_stop_it(monkeypatch: pytest.MonkeyPatch) -> None:
    client, reasons, receivers = MagicMock(), list[str](), list[Any]()
    attempts = [NotReachable("away"), NotReachable("away"), client]
    monkeypatch.setattr(robot_channel, "EventClient", MagicMock(side_effect=attempts))
    monkeypatch.setattr(robot_channel, "RETRY_S", 0.01)
    client.subscribe.side_effect = lambda receive, *patterns, queue: (
        receivers.append((receive, patterns)) or MagicMock()
    )
    channel = robot_channel.RobotChannel(MagicMock(), "main", "A")
    listen_for_stops(channel, "A", reasons.append)
    eventually(lambda: receivers, "subscribed")
    channel.close()
    ((receive, patterns),) = receivers
    assert patterns == ((STOP_EVENT, "*"),)
    for payload in ({"robots": ["B"]}, {"robots": "A"}, "A", {"robots": ["A"], "reason": "fire"}, {"robots": []}):
        receive(MagicMock(spec=Event, type=STOP_EVENT, source="x", payload=payload, origin=""))
    assert reasons == ["fire", "emergency stop"]
