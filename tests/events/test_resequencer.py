"""Events of an origin are delivered in its order, whichever way they come."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.events import resequencer
from robocorba.events.account import Account, Arrivals
from robocorba.events.channel import MAX_HOPS, Channel
from robocorba.events.federation import Advertisement
from robocorba.events.feed import Feed
from robocorba.events.policies import LinkPolicy
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.resequencer import Arrival, Resequencer
from robocorba.events.subscription import ALL
from tests.events.samples import add, arrive, events, open_channel


@pytest.fixture
def hall(tmp_path: Path) -> Iterator[Channel]:
    """A channel that is not the origin of the events."""
    with open_channel(tmp_path, name="hall") as channel:
        add(channel, ProxyPullSupplier(channel.lock, "1", ALL, QueuePolicy()))
        yield channel


def got(channel: Channel) -> list[int]:
    (proxy,) = channel.proxy_suppliers.values()
    assert isinstance(proxy, ProxyPullSupplier)
    result: list[int] = []
    while batch := proxy.pull(0.0):
        result += batch.payloads
    return result


@given(st.permutations(range(1, 7)), st.lists(st.integers(1, 6), max_size=3))
def test_events_in_any_order(order: list[int], again: list[int]) -> None:
    """Numbers 10, 20, ... were sent here; those between went elsewhere."""
    seen: set[int] = set()
    held, account = Resequencer(lambda origin, number: number in seen), Arrivals()
    delivered = []
    for number in [*order, *again]:
        for arrival in held.add(Arrival(events(10 * number), 10 * (number - 1), 0.0, account)):
            if arrival.batch.first not in seen:
                delivered.append(arrival.batch.first)
            seen.add(arrival.batch.first)
    assert delivered == [10, 20, 30, 40, 50, 60]
    assert account.held == 0


def test_what_waits_is_counted_as_queued(hall: Channel) -> None:
    late = arrive(hall, events(5, 2), before=3)
    assert late.snapshot() == (2, 0, 0, 0, 0, 2)
    assert got(hall) == []
    soon = arrive(hall, events(2, 2), before=0)
    assert got(hall) == [2, 3, 5, 6]
    assert late.snapshot() == soon.snapshot() == (2, 2, 0, 0, 0, 0)


def test_nobody_waits_longer_than_the_limit(hall: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    arrive(hall, events(5), before=4)
    arrive(hall, events(8), before=5)
    hall.release_overdue()
    assert got(hall) == []
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + resequencer.MAX_WAIT_S)
    hall.release_overdue()
    assert got(hall) == [5, 8]
    arrive(hall, events(4))  # too late for its place, but not lost
    assert got(hall) == [4]


def test_a_copy_that_comes_again_holds_up_nothing(hall: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resequencer, "MAX_HELD", 0)
    arrive(hall, events(5), before=4)  # without the missing one
    monkeypatch.undo()
    again = arrive(hall, events(5), before=4)
    arrive(hall, events(6), before=5)
    assert got(hall) == [5, 6]
    assert again == Arrivals(repeated=1)


def test_what_waits_is_bounded(hall: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resequencer, "MAX_HELD", 3)
    for number in (5, 7, 9):
        arrive(hall, events(number), before=number - 1)
    assert got(hall) == []
    arrive(hall, events(11), before=10)
    assert got(hall) == [5]


def test_an_event_without_a_way_is_discarded(hall: Channel) -> None:
    batch, account = events(1), Arrivals()
    batch.targets = {"yard": 0}
    assert hall.forward([batch], account) == []
    assert account == Arrivals(received=1, discarded=1)
    hall.publish(events(1), Account())
    assert len(got(hall)) == 1


def test_a_copy_does_not_go_round_for_ever(hall: Channel) -> None:
    """Each of two channels takes the other one for the next on the way."""
    feed = Feed(hall.lock, "lab", LinkPolicy())
    with hall.lock:
        hall.feeds["lab"] = feed
        hall.update_routes()
        hall.federation.learn([Advertisement("lab", 1, ("hall", "yard"), ()), Advertisement("yard", 1, ("lab",), ())])
    batch, account = events(1), Arrivals()
    for _ in range(MAX_HOPS + 1):
        batch.targets = {"yard": 0}
        hall.forward([batch], account)
    assert (account.delivered, account.discarded) == (MAX_HOPS, 1)
    assert feed.account.received == MAX_HOPS
