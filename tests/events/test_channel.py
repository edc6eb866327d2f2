"""A channel: numbers, selection, what comes from peers and in which order, and clocks that are wrong."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import first_number_of
from robocorba.events.federation import Advertisement
from robocorba.events.feed import Feed
from robocorba.events.policies import ChannelPolicy, LinkPolicy
from robocorba.events.proxy_supplier import ProxyPullSupplier
from tests.events.samples import NOW, arrive, events, open_channel, pull_supplier_of, pulled, supplied


def payloads(proxy: ProxyPullSupplier) -> list[object]:
    return [batch.payloads[0] for batch in pulled(proxy)]


def from_hall(number: int, made: float = NOW, expiry: float = 0.0, count: int = 1) -> EventBatch:
    batch = events(number, count, expiry=expiry)
    batch.header, batch.times = batch.header._replace(origin="hall"), [made] * count
    return batch


def test_events_get_numbers_origin_and_time(tmp_path: Path) -> None:
    with open_channel(tmp_path, first_number=100) as channel:
        proxy, account = pull_supplier_of(channel), Account()
        before, given = time.time(), supplied("b", b"y", b"z")
        given.times = [NOW, 0.0]
        channel.publish(supplied("a", b"x"), account)
        channel.publish(given, account)
        assert channel.last_number == 102
        first, second, third = pulled(proxy)
        assert before <= first.times[0] <= third.times[0] <= time.time()
        assert [one.header.origin for one in (first, second, third)] == ["lab"] * 3
        found = [(one.first, one.payloads) for one in (first, second, third)]
        assert found == [(100, [b"x"]), (101, [b"y"]), (102, [b"z"])]
        assert second.times == [NOW]  # those that suppliers gave are kept
        assert account == Account(3, 3)
        channel.is_destroyed = True
        with pytest.raises(ProxyGone):
            channel.publish(supplied("t", b"a"), Account())


def test_events_that_arrive_expired_are_counted_and_get_no_number(channel: Channel) -> None:
    proxy, account, now = pull_supplier_of(channel), Account(), time.time()
    for ages_s in ((0.0, 9.0, 0.0, 9.0), (9.0,)):
        batch = supplied("t", *(str(age_s).encode() for age_s in ages_s), expiry=5.0)
        batch.times = [now - age_s for age_s in ages_s]
        channel.publish(batch, account)
    assert [(one.first, one.payloads) for one in pulled(proxy)] == [(1, [b"0.0"]), (2, [b"0.0"])]
    assert account == Account(5, 2, expired=3)
    assert channel.last_number == 2
    of_a_peer = from_hall(1, expiry=60.0, count=3)
    of_a_peer.times = [now - 90.0, now, now]
    assert arrive(channel, of_a_peer) == Account(received=3, delivered=2, expired=1)
    assert [one.first for one in pulled(proxy)] == [2, 3]


def test_duplicates_from_a_peer_are_recognised(channel: Channel) -> None:
    proxy, parts = pull_supplier_of(channel), ((1, 3), (2, 4), (1, 5), (7, 1), (6, 2))
    assert [arrive(channel, from_hall(first, count=count)).repeated for first, count in parts] == [0, 2, 5, 0, 1]
    assert [one.first for one in pulled(proxy)] == [1, 2, 3, 4, 5, 7, 6]
    assert arrive(channel, events(50, 2)).repeated == 2  # its own
    # Of its name, but of another life: of another channel with the same name, or of an earlier process.
    other = first_number_of(7)
    assert arrive(channel, events(other)) == Account(received=1, discarded=1, refused=1)
    assert channel.has_had("lab", other)


@pytest.fixture
def hall(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Channel]:
    """A channel that is not the origin of the events, and has a consumer. `request.param`: how many events it holds."""
    policy = ChannelPolicy(max_held=getattr(request, "param", 10), max_hops=20)
    with open_channel(tmp_path, name="hall", policy=policy) as channel:
        pull_supplier_of(channel)
        yield channel


def got(channel: Channel) -> list[object]:
    (proxy,) = channel.proxy_suppliers.values()
    assert isinstance(proxy, ProxyPullSupplier)
    return payloads(proxy)


def test_nobody_waits_longer_than_the_limit(hall: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    arrive(hall, events(5), before=4)
    arrive(hall, events(8), before=5)
    hall.release_overdue()
    assert got(hall) == []
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + ChannelPolicy().max_held_s)
    hall.release_overdue()
    assert got(hall) == [5, 8]
    arrive(hall, events(4))  # too late for its place, but not lost
    assert got(hall) == [4]


@pytest.mark.parametrize("hall", [3], indirect=True)
def test_what_waits_is_bounded(hall: Channel) -> None:
    for number in (5, 7, 9):
        arrive(hall, events(number), before=number - 1)
    assert got(hall) == []
    arrive(hall, events(11), before=10)
    assert got(hall) == [5]


def test_an_event_without_a_way_is_discarded(hall: Channel) -> None:
    batch, account = events(1), Account()
    batch.targets = {"yard": 0}
    assert hall.forward([batch], account) == []
    assert account == Account(received=1, discarded=1)
    hall.publish(events(1), Account())
    assert len(got(hall)) == 1


def test_a_copy_does_not_go_round_for_ever(hall: Channel) -> None:
    """Each of two channels takes the other one for the next on the way."""
    feed = Feed(hall.lock, "lab", LinkPolicy())
    with hall.lock:
        hall.feeds["lab"] = feed
        hall.update_routes()
        hall.federation.learn([Advertisement("lab", 1, ("hall", "yard"), ()), Advertisement("yard", 1, ("lab",), ())])
    batch, account = events(1), Account()
    for _ in range(21):
        batch.targets = {"yard": 0}
        hall.forward([batch], account)
    assert (account.delivered, account.discarded) == (20, 1)
    assert feed.account.received == 20
