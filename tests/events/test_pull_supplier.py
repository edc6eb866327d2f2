"""What consumers get that pull, when, and their accounts."""

from __future__ import annotations

import threading

import pytest

from robocorba.errors.events import Disconnected
from robocorba.events.account import Totals
from robocorba.events.channel import Channel
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL
from tests.events.samples import BOTH, publish, pull_supplier_of, pulled, totals
from tests.waits import outlast


def test_pull_returns_one_event_at_a_time_and_then_none(channel: Channel) -> None:
    proxy = pull_supplier_of(channel, (*ALL, *BOTH))
    with pytest.raises(Disconnected):  # before it is connected
        ProxyPullSupplier(channel.lock, "pull", ALL, QueuePolicy()).pull(0.0)
    publish(channel, 1, 2, type="a")
    publish(channel, 3, type="b")
    publish(channel, 4, expiry=0.01)
    outlast(0.01)
    assert [int(batch.payloads[0]) for batch in pulled(proxy)] == [
        1,
        2,
        1,
        3,
        3,
    ]  # the conjunction of 1 and 3 came true before 3 came as such
    assert totals(proxy) == Totals(received=7, delivered=5, expired=1, queued=1)  # 2 waits for another b


class Pulling:
    """A client whose call waits in a thread. has_gone: whether it has given the call up."""

    def __init__(self, proxy: ProxyPullSupplier) -> None:
        self.has_gone = False
        self.payload: int | None = None
        self._waits = threading.Event()
        self._thread = threading.Thread(target=self._pull, args=(proxy,), daemon=True)
        self._thread.start()
        assert self._waits.wait(60.0)

    def _pull(self, proxy: ProxyPullSupplier) -> None:
        batch = proxy.pull(600.0, self._is_to_end)
        self.payload = int(batch.payloads[0]) if batch else None

    def _is_to_end(self) -> bool:
        self._waits.set()
        return self.has_gone

    def result(self) -> int | None:
        """What it has pulled, None if it came back without an event."""
        self._thread.join(60.0)
        assert not self._thread.is_alive()
        return self.payload


def test_concurrent_pulls_get_one_event_each(channel: Channel) -> None:
    proxy = pull_supplier_of(channel)
    clients = [Pulling(proxy) for _ in range(4)]
    publish(channel, 1, 2, 3, 4)
    assert sorted(client.result() or 0 for client in clients) == [1, 2, 3, 4]


def test_the_last_pull_that_waits_is_served_first(channel: Channel) -> None:
    proxy = pull_supplier_of(channel)
    clients = [Pulling(proxy) for _ in range(3)]
    for number, client in enumerate(reversed(clients)):
        publish(channel, number)
        assert client.result() == number


def test_events_wait_for_a_client_that_has_not_gone(channel: Channel) -> None:
    proxy = pull_supplier_of(channel)
    clients = [Pulling(proxy) for _ in range(3)]
    for client in clients:
        client.has_gone = True
    publish(channel, 1, 2)
    assert [client.result() for client in clients] == [None] * 3
    assert totals(proxy) == Totals(received=2, queued=2)
    assert [batch.payloads for batch in pulled(proxy)] == [[b"1"], [b"2"]]
    assert totals(proxy) == Totals(received=2, delivered=2)


def test_a_pull_behind_one_that_has_gone_is_served(channel: Channel) -> None:
    """Also without another event that would wake it."""
    proxy = pull_supplier_of(channel)
    stays, goes = Pulling(proxy), Pulling(proxy)
    goes.has_gone = True
    publish(channel, 1, 2)
    assert (stays.result(), goes.result()) == (1, None)
    assert totals(proxy) == Totals(received=2, delivered=1, queued=1)


def test_the_number_of_pulls_that_wait_is_bounded(channel: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocorba.events.proxy_supplier.MAX_PULLS", 2)
    proxy = pull_supplier_of(channel)
    first, second = Pulling(proxy), Pulling(proxy)
    third = Pulling(proxy)
    assert first.result() is None
    publish(channel, 3, 2)
    assert (third.result(), second.result()) == (3, 2)
