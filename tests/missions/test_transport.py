"""A robot's messages: the queue between the ORB's threads and the thread of the mission."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from robocorba.errors.services import NotReachable
from robocorba.missions.messages import Call, Offer, payload, sender_of, type_of
from robocorba.missions.transport import MAX_QUEUED, Transport

CALL = Call(mission="m", leader="A", floor="L1", x=1.0, y=2.0, helpers=2)


class Channel:
    """Keeps what is published."""

    is_there = True
    receive: Callable[[str, str, Any, str], None]

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        if not self.is_there:
            raise NotReachable("away")
        self.published.append((type, payload))

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[str, str, Any, str], None]) -> None:
        self.receive = receive


def subscribed() -> tuple[Channel, Transport]:
    channel = Channel()
    transport = Transport(channel, "B")
    transport.subscribe([(Call, "*")])
    return channel, transport


def test_messages_arrive_in_their_order() -> None:
    channel, transport = subscribed()
    other = msgspec.structs.replace(CALL, leader="C")
    for call in (CALL, other):
        channel.receive(type_of(Call), call.leader, payload(call), "lab")
    found = [transport.receive(1.0), transport.receive(1.0)]
    assert [(one.source, one.origin, one.message) for one in found if one] == [("A", "lab", CALL), ("C", "lab", other)]
    assert transport.receive(0.0) is None


def test_invalid_messages_and_those_in_the_name_of_another_robot_are_dropped() -> None:
    channel, transport = subscribed()
    offer = Offer(mission="m", leader="A", robot="B", floor="L1", x=1.0, y=2.0)
    assert (sender_of(CALL), sender_of(offer)) == ("A", "B")
    for message in (CALL, offer):
        channel.receive(type_of(message), "C", payload(message), "lab")
    channel.receive(type_of(Call), "A", {"mission": 7}, "lab")
    assert transport.receive(0.0) is None


def test_who_waits_without_a_timeout_can_be_woken() -> None:
    _, transport = subscribed()
    got: list[object] = ["nothing yet"]
    waiting = threading.Thread(target=lambda: got.append(transport.receive(None)), daemon=True)
    waiting.start()
    transport.wake()
    waiting.join(60.0)
    assert got == ["nothing yet", None]


def test_a_full_queue_drops_what_is_new_and_waking_does_not_fail() -> None:
    channel, transport = subscribed()
    for _ in range(MAX_QUEUED + 1):
        channel.receive(type_of(Call), "A", payload(CALL), "lab")
    transport.wake()
    received = [transport.receive(0.0) for _ in range(MAX_QUEUED + 1)]
    assert received[-1] is None and None not in received[:-1]


def test_publishing_tells_whether_the_channel_has_accepted_it() -> None:
    channel, transport = subscribed()
    assert transport.publish(CALL)
    (type_, content), channel.is_there = channel.published[0], False
    assert (type_, content["leader"]) == (type_of(Call), "A")
    assert content["sent"] > 0.0
    assert not transport.publish(CALL)
