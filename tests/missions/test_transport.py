"""A robot's messages, and what it answers to those of leaders."""

from __future__ import annotations

import logging
import threading
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions import mission_agent
from robocorba.missions.messages import Answer, Assignment, Call, Offer, payload, sender_of, type_of
from robocorba.missions.mission_agent import WARN_AFTER, MissionAgent
from robocorba.missions.subplan import Idle, SubPlan
from robocorba.missions.transport import MAX_QUEUED, Transport
from robocorba.robot.kinematics.smartpal import JOINTS
from tests.missions.places import Bus, BusEnd

CALL = Call(mission="m", leader="A", floor="L1", x=1.0, y=2.0, helpers=2)


def subscribed() -> tuple[Bus, Transport]:
    """B receives calls and offers."""
    bus = Bus()
    transport = Transport(BusEnd(bus, "B"), "B")
    transport.subscribe([(Call, "*"), (Offer, "*")])
    return bus, transport


def test_messages_arrive_in_their_order_but_for_invalid_ones_and_those_in_the_name_of_another_robot() -> None:
    bus, transport = subscribed()
    offer = Offer(mission="m", leader="A", robot="B", floor="L1", x=1.0, y=2.0)
    assert (sender_of(CALL), sender_of(offer)) == ("A", "B")
    for message in (CALL, offer):
        bus.publish("C", type_of(message), payload(message))
    bus.publish("A", type_of(Call), {"mission": 7})
    other = msgspec.structs.replace(CALL, leader="C")
    for call in (CALL, other):
        bus.publish(call.leader, type_of(call), payload(call))
    found = [transport.receive(1.0), transport.receive(1.0)]
    assert [(one.source, one.origin, one.message) for one in found if one] == [("A", "bus", CALL), ("C", "bus", other)]
    assert transport.receive(0.0) is None


def test_who_waits_can_be_woken_and_a_full_queue_drops_what_is_new() -> None:
    _, transport = subscribed()
    got: list[object] = []
    waiting = threading.Thread(target=lambda: got.append(transport.receive(None)), daemon=True)
    waiting.start()
    transport.wake()
    waiting.join(60.0)
    assert got == [None]
    bus, transport = subscribed()
    for _ in range(MAX_QUEUED + 1):
        bus.publish("A", type_of(Call), payload(CALL))
    transport.wake()
    received = [transport.receive(0.0) for _ in range(MAX_QUEUED + 1)]
    assert received[-1] is None and None not in received[:-1]


def test_publishing_tells_whether_the_channel_has_accepted_it() -> None:
    bus, transport = subscribed()
    published: list[Any] = []
    bus.subscribe(0, "", [("*", "*")], lambda *event: published.append(event))
    assert transport.publish(CALL)
    ((type_, source, content, _),) = published
    assert (type_, source, content["leader"]) == (type_of(Call), "B", "A")
    assert content["sent"] > 0.0
    bus.disconnected = {"B"}
    assert not transport.publish(CALL)


class FreeAgent(SimpleNamespace):
    """A control agent without a task, whose robot has this number of joints, or does not answer."""

    is_free, is_busy, place = True, False, Pose("L1", 1.0, 2.0, 0.0)

    @property
    def joints(self) -> Any:
        if self.has_joints is None:
            raise RobotLost("it does not answer")
        return np.zeros(self.has_joints)


@pytest.mark.parametrize("joints", [0, 7, None])
def test_one_without_arms_refuses(joints: int | None) -> None:
    bus, agent = Bus(), FreeAgent(has_joints=joints)
    leader = Transport(BusEnd(bus, "A"), "A")
    leader.subscribe([(Offer, "*"), (Answer, "*")])
    missions = MissionAgent(Transport(BusEnd(bus, "B"), "B"), agent, lambda thing: None).start()  # type: ignore[arg-type]
    assignment = Assignment(mission="m.1", leader="A", phases=("one",), subplan=SubPlan("B", "helper", (Idle(),)))
    answer = None
    while answer is None:
        leader.publish(CALL)
        leader.publish(assignment)
        answer = leader.receive(0.1)
    missions.close()
    assert isinstance(answer.message, Answer)
    assert (answer.message.accepts, answer.message.reason) == (False, "does not have the joints of a SmartPal")
    assert not any(isinstance(received.message, Offer) for received in leader.received)


class Unreachable(BusEnd):
    """A channel that is not there for its first calls."""

    failures = 0

    def subscribe(self, *arguments: Any) -> None:
        if self.failures:
            self.failures -= 1
            raise NotReachable("EventChannels/hall is not reachable")
        super().subscribe(*arguments)


@pytest.mark.parametrize(("failures", "warnings"), [(WARN_AFTER - 1, 0), (WARN_AFTER, 1), (3 * WARN_AFTER, 1)])
def test_a_channel_that_stays_away_is_logged_once_as_a_warning(
    failures: int, warnings: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mission_agent, "RETRY_S", 0.001)
    bus = Bus()
    leader, end = Transport(BusEnd(bus, "A"), "A"), Unreachable(bus, "B")
    leader.subscribe([(Offer, "*")])
    end.failures = failures
    agent: Any = FreeAgent(has_joints=len(JOINTS))
    missions = MissionAgent(Transport(end, "B"), agent, lambda thing: None).start()
    try:
        while not leader.receive(0.1):  # until it has subscribed at last
            leader.publish(CALL)
    finally:
        missions.close()
    logged = [each for each in caplog.records if each.levelno >= logging.WARNING and "event channel" in each.message]
    assert len(logged) == warnings
