"""The system's clock is set while events wait and channels run: by hours, in both directions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import first_number_of, start_second
from robocorba.events.federation import Federation
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Clause, Pattern, Subscription
from robocorba.events.watermarks import Watermarks
from tests.events.samples import events, supplied, wanting

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
    with Watermarks(tmp_path / "seen") as watermarks:
        yield Channel(Federation("lab"), watermarks, first_number_of(start_second(time.time())))


def waiting(channel: Channel, subscription: Subscription) -> ProxyPullSupplier:
    with channel.lock:
        proxy = ProxyPullSupplier(channel.lock, "1", subscription, QueuePolicy())
        channel.proxy_suppliers["1"] = proxy
        channel.update_routes()
        proxy.connect(None)  # type: ignore[arg-type]
    return proxy


def from_hall(number: int) -> EventBatch:
    batch = events(number)
    batch.header = batch.header._replace(origin="hall")
    return batch


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S])
def test_waiting_events_expire_by_the_time_that_passes(channel: Channel, set_clock: SetClock, ahead_s: float) -> None:
    proxy = waiting(channel, wanting("t"))
    channel.publish(supplied("t", b"short", expiry=0.01), Account())
    channel.publish(supplied("t", b"long", expiry=60.0), Account())
    set_clock(ahead_s)
    time.sleep(0.02)
    found = proxy.pull(0.0)
    assert found and found.payloads == [b"long"]


@pytest.mark.parametrize("ahead_s", [HOURS_S, -HOURS_S])
def test_events_on_both_sides_of_a_step_belong_together(channel: Channel, set_clock: SetClock, ahead_s: float) -> None:
    proxy = waiting(channel, (Clause((Pattern("a"), Pattern("b")), 5.0),))
    channel.publish(supplied("a", b"a"), Account())
    set_clock(ahead_s)
    channel.publish(supplied("b", b"b"), Account())
    assert [batch.payloads for batch in (proxy.pull(0.0), proxy.pull(0.0)) if batch] == [[b"a"], [b"b"]]


def test_peers_are_believed_after_the_clock_was_set_back(channel: Channel, set_clock: SetClock) -> None:
    began = first_number_of(start_second(time.time()))
    set_clock(-HOURS_S)
    _, _, refused = channel.forward([from_hall(began)])
    assert refused == 0


def test_a_peer_is_believed_by_a_channel_that_started_after_the_clock_was_set_back(
    tmp_path: Path, set_clock: SetClock
) -> None:
    began = first_number_of(start_second(time.time()))
    with Watermarks(tmp_path / "seen") as watermarks:
        watermarks.raise_to("hall", began)
    set_clock(-HOURS_S)
    with Watermarks(tmp_path / "seen") as watermarks:
        again = Channel(Federation("lab"), watermarks, first_number_of(start_second(time.time())))
        assert again.forward([from_hall(began)]).duplicates == 1
        assert again.forward([from_hall(began + 1)]).refused == 0
        assert again.forward([from_hall(began + (3600 << 32))]).refused == 1
