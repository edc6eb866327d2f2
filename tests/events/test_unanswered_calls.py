"""Calls without an answer to idempotent consumers: repeated, and executed once."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.events import NotDelivered, Unconfirmed
from robocorba.events.account import Totals
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.proxy import ProxyCondition
from robocorba.events.proxy_push_supplier import MAX_REPEATS
from robocorba.events.queue import QueueItem
from robocorba.testing.processes import eventually
from tests.events.outlets import is_settled, publish, push_supplier_of, received, totals
from tests.events.samples import Consumer, is_balanced


class IdempotentConsumer(Consumer):
    """Ignores calls that it has had. `outcomes` of its next calls: "answered"; "unanswered", executed at once; "late",
    executed after the next one; "lost" and "refused", not executed, the latter known to the caller."""

    def __init__(self, outcomes: Sequence[str]) -> None:
        super().__init__(answer=self._answer)
        self.is_idempotent = True
        self.calls: list[list[int]] = []
        self.executed: list[int] = []
        self._outcomes = list(outcomes)
        self._late: list[list[int]] = []

    def _answer(self, items: Sequence[QueueItem]) -> None:
        call = [
            int(str(payload, "ascii")) for batch in items if isinstance(batch, EventBatch) for payload in batch.payloads
        ]
        outcome = self._outcomes.pop(0) if self._outcomes else "answered"
        if outcome == "refused":
            raise NotDelivered("not reachable")
        if outcome in ("answered", "unanswered"):
            self._execute(call)
        late, self._late = self._late, [call] if outcome == "late" else []
        for one in late:
            self._execute(one)
        if outcome != "answered":
            raise Unconfirmed("no answer")

    def _execute(self, call: list[int]) -> None:
        if call not in self.calls:
            self.calls.append(call)
            self.executed += call


@given(
    st.lists(st.sampled_from(["answered", "unanswered", "late", "lost", "refused"]), max_size=20),
    st.lists(st.integers(1, 4), min_size=1, max_size=15),
)
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_an_idempotent_consumer_gets_all_once_and_in_order(
    channel: Channel, outcomes: list[str], published: list[int]
) -> None:
    bounded: list[str] = []
    for outcome in outcomes:
        bounded += ["answered", outcome] if len(bounded) % 4 == MAX_REPEATS else [outcome]
    consumer = IdempotentConsumer(bounded)
    proxy = push_supplier_of(channel, consumer, name="durable")
    number = 0
    for count in published:
        publish(channel, *range(number, number + count))
        number += count
        assert is_balanced(totals(proxy))
    eventually(lambda: is_settled(proxy))
    assert consumer.executed == list(range(number))
    assert totals(proxy) == Totals(received=number, delivered=number)
    with channel.lock:
        proxy.end()


def test_a_call_that_is_never_answered_is_given_up(channel: Channel) -> None:
    """Its events could be the cause; the others must not wait for ever."""
    consumer = IdempotentConsumer(["lost"] * (1 + MAX_REPEATS))
    proxy = push_supplier_of(channel, consumer, name="durable")
    publish(channel, 0)
    eventually(lambda: is_settled(proxy))
    publish(channel, 1)
    eventually(lambda: is_settled(proxy))
    assert consumer.executed == [1]
    assert totals(proxy) == Totals(received=2, delivered=2, unconfirmed=1)


def test_a_successor_does_not_get_what_its_predecessor_may_have(channel: Channel) -> None:
    consumer = IdempotentConsumer(["unanswered"])
    consumer.is_alive = lambda: False
    proxy = push_supplier_of(channel, consumer, name="durable")
    publish(channel, 0)
    eventually(lambda: proxy.condition is ProxyCondition.STALLED)
    publish(channel, 1)
    assert totals(proxy) == Totals(received=2, queued=2)
    successor = Consumer()
    with channel.lock:
        proxy.leave()
        proxy.connect(successor)
    eventually(lambda: is_settled(proxy))
    assert received(successor) == [1]
    assert totals(proxy) == Totals(received=2, delivered=2, unconfirmed=1)
