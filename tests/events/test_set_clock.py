"""The system's clock is set while events wait and channels run: by hours, in both directions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.federation import Federation
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import Clause, Pattern, Subscription
from tests.events.samples import arrive, events, supplied, wanting
from tests.waits import outlast

HOURS_S = 7200.0
SetClock = Callable[[float], None]


@pytest.fixture
def set_clock(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    """Sets the system's clock ahead of the true one [s]."""
    real = time.time

    def set_clock(ahead_s: float) -> None:
        monkeypatch.setattr(time, "time", lambda: real() + ahead_s)

    return set_clock


@pytest.fixture
def channel(tmp_path: Path) -> Iterator[Channel]:
    with SeenEvents(tmp_path / "seen") as seen:
        yield Channel(Federation("lab"), seen, 1)


def waiting(channel: Channel, subscription: Subscription) -> ProxyPullSupplier:
    with channel.lock:
        proxy = ProxyPullSupplier(channel.lock, "1", subscription, QueuePolicy())
        channel.proxy_suppliers["1"] = proxy
        channel.update_routes()
        proxy.connect(None)  # type: ignore[arg-type]
    return proxy


def from_hall(number: int, made: float) -> EventBatch:
    batch = events(number, expiry=60.0)
    batch.header = batch.header._replace(origin="hall")
    batch.times = [made]
    return batch


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S])
def test_waiting_events_expire_by_the_time_that_passes(channel: Channel, set_clock: SetClock, ahead_s: float) -> None:
    proxy = waiting(channel, wanting("t"))
    channel.publish(supplied("t", b"short", expiry=0.01), Account())
    channel.publish(supplied("t", b"long", expiry=60.0), Account())
    set_clock(ahead_s)
    outlast(0.01)
    found = proxy.pull(0.0)
    assert found and found.payloads == [b"long"]


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S])
def test_events_on_both_sides_of_a_step_belong_together(channel: Channel, set_clock: SetClock, ahead_s: float) -> None:
    proxy = waiting(channel, (Clause((Pattern("a"), Pattern("b")), 5.0),))
    channel.publish(supplied("a", b"a"), Account())
    set_clock(ahead_s)
    channel.publish(supplied("b", b"b"), Account())
    assert [batch.payloads for batch in (proxy.pull(0.0), proxy.pull(0.0)) if batch] == [[b"a"], [b"b"]]


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S, 1e9, -1e9])
def test_events_of_a_machine_whose_clock_is_wrong_live_as_long_as_others(channel: Channel, ahead_s: float) -> None:
    """Their age is what passed since, by the clock that stamped them."""
    proxy = waiting(channel, wanting("t"))
    now = time.time() + ahead_s
    for number, age_s in ((1, 0.0), (2, 50.0), (3, 70.0)):
        batch = from_hall(number, now - age_s)
        batch.epoch = now - time.monotonic()
        arrive(channel, batch)
    assert [batch.first for batch in (proxy.pull(0.0), proxy.pull(0.0), proxy.pull(0.0)) if batch] == [1, 2]


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S])
def test_a_conjunction_of_events_of_two_machines(channel: Channel, ahead_s: float) -> None:
    proxy = waiting(channel, (Clause((Pattern("a"), Pattern("t")), 5.0),))
    channel.publish(supplied("a", b"a"), Account())
    batch = from_hall(1, time.time() + ahead_s)
    batch.epoch = time.time() + ahead_s - time.monotonic()
    arrive(channel, batch)
    assert [batch.header.type for batch in (proxy.pull(0.0), proxy.pull(0.0)) if batch] == ["a", "t"]
