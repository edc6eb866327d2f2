"""What peers send each other: events with their targets, and advertisements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import omniORB
import pytest

from robocorba.corba.conversion import events
from robocorba.corba.orb import Orb
from robocorba.corba.servants.event_gateway import PeerGatewayServant
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.federation import Advertisement
from robocorba.events.subscription import Pattern
from robocorba.settings import Address
from robocorba.stubs import RoboCorba

#: As of a life in the upper half.
NUMBER = (1 << 64) - 10


class Links:
    """Keeps what a gateway is given."""

    def __init__(self) -> None:
        self.batches: list[EventBatch] = []
        self.invalid = 0

    def forward(self, session: str, position: int, batches: list[EventBatch], invalid: int) -> None:
        self.batches += batches
        self.invalid += invalid


def batch(**targets: int) -> EventBatch:
    result = EventBatch(EventHeader("t", "s", "lab"), [1.0, 2.0], [b"x", b"y"], NUMBER, epoch=1.0)
    result.targets, result.hops = targets, 3
    return result


def forward(ways: list[Any], runs: list[Any]) -> Links:
    links = Links()
    PeerGatewayServant(links).forwardOn("s1", 1, [1.0] * len(runs), ways, runs)  # type: ignore[arg-type]
    return links


@pytest.fixture(scope="module")
def orb() -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb


def across(typecode: Any, value: Any) -> Any:
    """A value after its way over the wire."""
    return omniORB.cdrUnmarshal(typecode, omniORB.cdrMarshal(typecode, value))


@pytest.mark.parametrize("targets", [{"hall": NUMBER - 1, "yard": 0}, {}])
def test_targets_arrive(orb: Orb, targets: dict[str, int]) -> None:
    sent = [batch(**targets)]
    ways = across(RoboCorba._tc_EventWaySeq, events.event_ways(sent))
    (came,) = forward(ways, across(RoboCorba._tc_EventRunSeq, events.event_runs(sent))).batches
    assert (came.targets, came.hops, came.first, came.payloads) == (targets, 3, NUMBER, [b"x", b"y"])


@pytest.mark.parametrize("name", ["", "a/b", "x" * 61])
def test_events_for_names_that_no_channel_can_have_are_refused(name: str) -> None:
    links = forward([RoboCorba.EventWay([RoboCorba.EventTarget(name, 0)], 0)], events.event_runs([batch()]))
    assert (links.batches, links.invalid) == ([], 2)


def test_events_without_a_way_of_each_run_are_refused() -> None:
    links = forward([], events.event_runs([batch()]))
    assert (links.batches, links.invalid) == ([], 2)


def test_advertisements_arrive(orb: Orb) -> None:
    sent = [Advertisement("lab", 1 << 40, ("hall", "yard"), (Pattern("t", "*"),), ("yard",))]
    assert events.advertisements_of(across(RoboCorba._tc_LinkNoticeSeq, events.advertisements(sent))) == sent
