"""A channel: numbers, selection, and what comes from peers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.outlet import PullOutlet
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, Pattern, Subscription
from tests.events.samples import NOW, add, events, open_channel, supplied, wanting


@pytest.fixture
def channel(tmp_path: Path) -> Iterator[Channel]:
    with open_channel(tmp_path, first_number=100) as channel:
        yield channel


def consumer(channel: Channel, id: str, wanted: Subscription = ALL) -> PullOutlet:
    outlet = PullOutlet(channel.lock, id, wanted, QueuePolicy())
    add(channel, outlet)
    return outlet


def pulled(outlet: PullOutlet) -> list[tuple[int, object]]:
    found = []
    while run := outlet.pull(0.0):
        found.append((run.first, run.payloads[0]))
    return found


def test_events_get_numbers_origin_and_time(channel: Channel) -> None:
    outlet, account = consumer(channel, "1"), Account()
    before = time.time()
    channel.publish(supplied("a", b"x", b"y"), account)
    channel.publish(supplied("b", b"z"), account)
    assert channel.last_number == 102
    run = outlet.pull(0.0)
    assert run is not None and run.header.origin == "lab"
    assert before <= run.times[0] <= time.time()
    assert [(run.first, run.payloads[0]), *pulled(outlet)] == [(100, b"x"), (101, b"y"), (102, b"z")]
    assert account.totals(0) == (3, 3, 0, 0, 0, 0)


def test_each_consumer_gets_what_it_wants_as_soon_as_it_wants_it(channel: Channel) -> None:
    first, second = consumer(channel, "1", wanting("a*")), consumer(channel, "2", wanting("b", "a1"))
    for type in ("a1", "a2", "b", "c"):
        channel.publish(supplied(type, type.encode()), Account())
    assert [payload for _, payload in pulled(first)] == [b"a1", b"a2"]
    assert [payload for _, payload in pulled(second)] == [b"a1", b"b"]
    with channel.lock:
        first.select(wanting("c"))
        channel.changed()
    for type in ("a1", "c"):
        channel.publish(supplied(type, type.encode()), Account())
    assert [payload for _, payload in pulled(first)] == [b"c"]


def test_the_interest_is_the_union_of_all_subscriptions(channel: Channel) -> None:
    assert channel.interest() == ()
    consumer(channel, "1", wanting("a*"))
    second = consumer(channel, "2", wanting("a1", "b"))
    assert channel.interest() == (Pattern("a*"), Pattern("b"))
    with channel.lock:
        second.end()
    assert channel.interest() == (Pattern("a*"),)


def test_what_had_expired_when_it_came_gets_no_number(channel: Channel) -> None:
    outlet, account = consumer(channel, "1"), Account()
    run = supplied("t", b"a", b"b", b"c", b"d", expiry=5.0)
    now = time.time()
    run.times = [now, now - 9.0, now, now - 9.0]
    channel.publish(run, account)
    assert pulled(outlet) == [(100, b"a"), (101, b"c")]
    assert account.totals(0) == (4, 2, 0, 0, 2, 0)
    run = supplied("t", b"a", expiry=5.0)
    run.times = [now - 9.0]
    channel.publish(run, account)
    assert (channel.last_number, account.expired) == (101, 3)


def test_what_comes_again_from_a_peer_is_recognised(channel: Channel) -> None:
    outlet = consumer(channel, "1")

    def forward(first: int, count: int, origin: str = "hall") -> int:
        run = events(first, count)
        run.header = run.header._replace(origin=origin)
        claimed, repeated = channel.forward([run])
        channel.deliver(claimed)
        return repeated

    assert [forward(1, 3), forward(2, 4), forward(1, 5), forward(7, 1), forward(6, 1)] == [0, 2, 5, 0, 1]
    assert forward(50, 2, origin="lab") == 2  # its own
    assert [number for number, _ in pulled(outlet)] == [1, 2, 3, 4, 5, 7]


def test_a_destroyed_channel_takes_nothing(channel: Channel) -> None:
    with channel.lock:
        channel.is_destroyed = True
    with pytest.raises(ProxyGone):
        channel.publish(supplied("t", b"a"), Account())


def test_times_that_suppliers_gave_are_kept(channel: Channel) -> None:
    outlet = consumer(channel, "1")
    run = supplied("t", b"a")
    run.times = [NOW]
    channel.publish(run, Account())
    found = outlet.pull(0.0)
    assert found is not None and found.times == [NOW]
