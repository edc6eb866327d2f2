"""A channel: numbers, selection, and what comes from peers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account, Arrivals
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import first_number_of
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, Pattern, Subscription
from tests.events.samples import NOW, add, arrive, events, open_channel, supplied, wanting


@pytest.fixture
def channel(tmp_path: Path) -> Iterator[Channel]:
    with open_channel(tmp_path, first_number=100) as channel:
        yield channel


def consumer(channel: Channel, id: str, wanted: Subscription = ALL) -> ProxyPullSupplier:
    proxy = ProxyPullSupplier(channel.lock, id, wanted, QueuePolicy())
    add(channel, proxy)
    return proxy


def pulled(proxy: ProxyPullSupplier) -> list[tuple[int, object]]:
    found = []
    while batch := proxy.pull(0.0):
        found.append((batch.first, batch.payloads[0]))
    return found


def test_events_get_numbers_origin_and_time(channel: Channel) -> None:
    proxy, account = consumer(channel, "1"), Account()
    before = time.time()
    channel.publish(supplied("a", b"x", b"y"), account)
    channel.publish(supplied("b", b"z"), account)
    assert channel.last_number == 102
    batch = proxy.pull(0.0)
    assert batch is not None and batch.header.origin == "lab"
    assert before <= batch.times[0] <= time.time()
    assert [(batch.first, batch.payloads[0]), *pulled(proxy)] == [(100, b"x"), (101, b"y"), (102, b"z")]
    assert account.totals(0) == (3, 3, 0, 0, 0, 0)


def test_each_consumer_gets_the_events_of_its_current_subscription(channel: Channel) -> None:
    first, second = consumer(channel, "1", wanting("a*")), consumer(channel, "2", wanting("b", "a1"))
    for type in ("a1", "a2", "b", "c"):
        channel.publish(supplied(type, type.encode()), Account())
    assert [payload for _, payload in pulled(first)] == [b"a1", b"a2"]
    assert [payload for _, payload in pulled(second)] == [b"a1", b"b"]
    with channel.lock:
        first.select(wanting("c"))
        channel.update_routes()
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
        channel.update_routes(second)
    assert channel.interest() == (Pattern("a*"),)


def test_events_that_arrive_expired_get_no_number(channel: Channel) -> None:
    proxy, account = consumer(channel, "1"), Account()
    batch = supplied("t", b"a", b"b", b"c", b"d", expiry=5.0)
    now = time.time()
    batch.times = [now, now - 9.0, now, now - 9.0]
    channel.publish(batch, account)
    assert pulled(proxy) == [(100, b"a"), (101, b"c")]
    assert account.totals(0) == (4, 2, 0, 0, 2, 0)
    batch = supplied("t", b"a", expiry=5.0)
    batch.times = [now - 9.0]
    channel.publish(batch, account)
    assert (channel.last_number, account.expired) == (101, 3)


def from_hall(first: int, count: int = 1) -> EventBatch:
    batch = events(first, count)
    batch.header = batch.header._replace(origin="hall")
    return batch


def test_duplicates_from_a_peer_are_recognised(channel: Channel) -> None:
    proxy = consumer(channel, "1")

    def forward(first: int, count: int, origin: str = "hall") -> int:
        batch = events(first, count)
        batch.header = batch.header._replace(origin=origin)
        return arrive(channel, batch).repeated

    assert [forward(1, 3), forward(2, 4), forward(1, 5), forward(7, 1), forward(6, 2)] == [0, 2, 5, 0, 1]
    assert forward(50, 2, origin="lab") == 2  # its own
    assert [number for number, _ in pulled(proxy)] == [1, 2, 3, 4, 5, 7, 6]


def test_forged_numbers_harm_no_other_event(channel: Channel) -> None:
    proxy = consumer(channel, "1")
    first = first_number_of(7)
    forged = ((1 << 64) - 1, first + 1000, first_number_of(8))
    sent = [*forged, first, first + 1, first + 999, first + 1001]
    for number in sent:
        account = arrive(channel, from_hall(number))
        assert (account.repeated, account.refused) == (0, 0)
    assert [number for number, _ in pulled(proxy)] == sent
    assert arrive(channel, from_hall(first, 2)).repeated == 2


def test_events_that_waited_on_an_earlier_path_are_no_duplicates(channel: Channel) -> None:
    """A direct link was added, and a newer event came by it."""
    proxy = consumer(channel, "1")
    for first, count in ((1, 10), (1011, 1), (11, 1000), (500, 600)):
        account = arrive(channel, from_hall(first, count))
        assert (account.repeated, account.refused) == ((512, 0) if first == 500 else (0, 0))
    assert sorted(number for number, _ in pulled(proxy)) == list(range(1, 1100))


def test_events_of_its_name_from_another_life_are_refused(channel: Channel) -> None:
    """They are of another channel with the same name, or of an earlier process."""
    consumer(channel, "1")
    batch = events(first_number_of(7))
    assert arrive(channel, batch) == Arrivals(received=1, discarded=1, refused=1)
    assert channel.has_had("lab", first_number_of(7))


def test_a_destroyed_channel_accepts_no_events(channel: Channel) -> None:
    with channel.lock:
        channel.is_destroyed = True
    with pytest.raises(ProxyGone):
        channel.publish(supplied("t", b"a"), Account())


def test_times_that_suppliers_gave_are_kept(channel: Channel) -> None:
    proxy = consumer(channel, "1")
    batch = supplied("t", b"a")
    batch.times = [NOW]
    channel.publish(batch, Account())
    found = proxy.pull(0.0)
    assert found is not None and found.times == [NOW]
