"""Proxy consumers, with suppliers that push and suppliers that are polled."""

from __future__ import annotations

import threading

import pytest

from robocorba.backoff import Backoff
from robocorba.errors.events import (
    ClientGone,
    Disconnected,
    EventError,
    EventTooLarge,
    InvalidEvent,
    NotDelivered,
    ProxyGone,
    Refused,
    Unconfirmed,
)
from robocorba.events.account import Account
from robocorba.events.event import EventBatch
from robocorba.events.policies import PollingPolicy
from robocorba.events.proxy import ProxyCondition
from robocorba.events.proxy_consumer import ProxyConsumer, ProxyPullConsumer
from robocorba.testing.processes import eventually
from tests.events.samples import Supplier, supplied
from tests.waits import stays

#: Shorter pauses, and fewer failures, than the defaults.
POLICY = PollingPolicy(backoff=Backoff(0.001, 0.002), max_failures=4)


class Published:
    """What a proxy published, and the reasons why clients were lost."""

    def __init__(self) -> None:
        self.payloads: list[object] = []
        self.reasons: list[str] = []
        self.lock = threading.Lock()

    def publish(self, batch: EventBatch, account: Account) -> None:
        assert not batch.header.origin
        self.payloads += batch.payloads

    @staticmethod
    def has_had(origin: str, number: int) -> bool:
        return origin == "east" and number <= 5

    def lost(self, proxy: ProxyPullConsumer, reason: str) -> None:
        self.reasons.append(reason)

    def polled(self, supplier: Supplier, policy: PollingPolicy = POLICY) -> ProxyPullConsumer:
        one = ProxyPullConsumer(self.lock, "1", self.publish, self.has_had, policy, self.lost)
        one.connect(supplier)
        return one


@pytest.fixture
def published() -> Published:
    return Published()


def test_a_push_is_published_once_between_connect_and_end(
    published: Published, caplog: pytest.LogCaptureFixture
) -> None:
    one = ProxyConsumer(published.lock, "7", published.publish, published.has_had)

    def push(origin: str, first: int, *payloads: bytes) -> None:
        batch = supplied("t", *payloads)
        batch.header, batch.first = batch.header._replace(origin=origin), first
        one.push(batch)

    with pytest.raises(Disconnected):
        one.push(supplied("t", b"early"))
    one.connect(None)
    push("east", 4, b"again", b"again")
    push("east", 5, b"again")
    push("east", 5, b"new", b"new")
    push("west", 1, b"new")
    assert published.payloads == [b"new"] * 3
    assert (one.account.received, one.account.discarded) == (3, 3)  # those published are counted by the channel
    assert caplog.messages == ["the supplier of 7 publishes events that it has received; they are discarded"]
    one.end()
    with pytest.raises(ProxyGone):
        one.push(supplied("t", b"late"))


def test_a_supplier_is_polled_continuously(published: Published) -> None:
    supplier = Supplier(supplied("t", b"a"), supplied("t", b"b"))
    one = published.polled(supplier)
    eventually(lambda: supplier.asked > 5)
    supplier.batches.append(supplied("t", b"c"))
    eventually(lambda: published.payloads == [b"a", b"b", b"c"])
    one.end()
    eventually(lambda: not any(thread.name == "from 1" for thread in threading.enumerate()))


def test_polls_become_rare_after_an_event(published: Published) -> None:
    supplier = Supplier(supplied("t", b"a"))
    one = published.polled(supplier, PollingPolicy(intervals=Backoff(0.001, 3600.0, factor=1e7)))
    eventually(lambda: supplier.asked == 3, what="the poll with the event and two without")
    stays(lambda: supplier.asked == 3, 0.2)
    one.end()


@pytest.mark.parametrize("error", [NotDelivered("away"), Unconfirmed("no answer"), Refused("a fault of its own")])
def test_a_supplier_is_disconnected_after_max_failures_in_a_row(published: Published, error: EventError) -> None:
    supplier = Supplier(error, error, error, supplied("t", b"a"), error, error, error, supplied("t", b"b"))
    one = published.polled(supplier)
    eventually(lambda: published.payloads == [b"a", b"b"])
    eventually(lambda: one.condition is ProxyCondition.CONNECTED and one.failures == 0)
    assert published.reasons == []
    supplier.batches += [error] * 9
    eventually(lambda: published.reasons)
    assert published.reasons == [f"4 failures in a row ({error})"]


def test_a_supplier_that_is_gone_is_disconnected_immediately(published: Published) -> None:
    supplier = Supplier(ClientGone("gone"), supplied("t", b"a"))
    published.polled(supplier)
    eventually(lambda: published.reasons == ["gone"])
    assert (supplier.asked, published.payloads) == (1, [])


def test_an_event_of_a_supplier_that_the_channel_does_not_take_is_counted(published: Published) -> None:
    supplier = Supplier(EventTooLarge(9, 8), InvalidEvent("type", "is empty"), supplied("t", b"a"))
    one = published.polled(supplier)
    eventually(lambda: published.payloads == [b"a"])
    assert (one.account.received, one.account.discarded) == (2, 2)  # the one published is counted by the channel
    assert not published.reasons
    one.end()
