"""What consumers get, when, and their accounts, with real threads and consumers that fail."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.events import Disconnected, EventError, NotDelivered, Refused, Unconfirmed
from robocorba.events.account import Account
from robocorba.events.blocking_budget import BUDGET_S, STEADY_S, BlockingBudget
from robocorba.events.channel import Channel
from robocorba.events.event import CorrelatedEvents, EventBatch
from robocorba.events.policies import DeliveryPolicy
from robocorba.events.proxy import ProxyCondition
from robocorba.events.proxy_supplier import ProxyPullSupplier, ProxySupplier
from robocorba.events.queue import OverflowRule, QueueItem, QueuePolicy
from robocorba.events.subscription import ALL, Clause
from testkit.processes import eventually
from tests.events.samples import (
    BOTH,
    IMPATIENT,
    Consumer,
    LostClients,
    failing,
    is_balanced,
    is_settled,
    publish,
    pull_supplier_of,
    pulled,
    push_supplier_of,
    received,
    totals,
    wanting,
)
from tests.waits import outlast, pause

REAL_THREADS = settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.mark.parametrize("takes_batches", [False, True])
def test_inline_delivery_has_ended_when_the_supplier_returns(channel: Channel, takes_batches: bool) -> None:
    consumer = Consumer(takes_batches)
    gap_s = 0.0 if takes_batches else 60.0  # plain consumers are called also during a flood
    proxy = push_supplier_of(channel, consumer, delivery=DeliveryPolicy(max_flood_gap_s=gap_s))
    publish(channel, 0)
    eventually(lambda: is_settled(proxy))
    for number in range(1, 20):
        publish(channel, number)
        assert received(consumer)[-1] == number


def test_in_a_flood_suppliers_continue_and_calls_grow(channel: Channel) -> None:
    calls: list[int] = []
    is_called, may_end = threading.Event(), threading.Event()

    def take(items: Sequence[QueueItem]) -> None:
        calls.append(sum(map(len, items)))
        is_called.set()
        assert may_end.wait(60.0)

    consumer = Consumer(answer=take)
    proxy = push_supplier_of(channel, consumer, delivery=DeliveryPolicy(coalesce_s=0.3))
    publish(channel, 0)
    assert is_called.wait(60.0)
    for number in range(1, 4):
        publish(channel, number)  # while the first one is still being delivered
    may_end.set()
    for number in range(4, 9):
        publish(channel, number)  # while the thread rests
    eventually(lambda: is_settled(proxy))
    assert calls == [1, 8]
    assert received(consumer) == list(range(9))


def test_events_that_follow_too_soon_are_left_to_the_thread(channel: Channel) -> None:
    callers: list[str] = []
    consumer = Consumer(answer=lambda items: callers.append(threading.current_thread().name))
    proxy = push_supplier_of(channel, consumer, delivery=DeliveryPolicy(flood_gap=1e9, max_flood_gap_s=60.0))
    for number in range(5):
        publish(channel, number)
        eventually(lambda: is_settled(proxy))
    assert callers == ["to 1"] * 5


@pytest.mark.parametrize("takes_batches", [False, True])
def test_concurrent_suppliers_call_a_consumer_one_after_another(channel: Channel, takes_batches: bool) -> None:
    consumer = Consumer(takes_batches)
    proxy = push_supplier_of(channel, consumer)

    def supply(base: int) -> None:
        for number in range(200):
            publish(channel, base + number)

    bases = range(0, 4000, 1000)
    with ThreadPoolExecutor(len(bases)) as suppliers:
        list(suppliers.map(supply, bases))
    eventually(lambda: is_settled(proxy))
    assert consumer.overlaps == 0
    assert totals(proxy) == Account(received=800, delivered=800)
    for base in bases:
        assert [number for number in received(consumer) if 0 <= number - base < 1000] == [*range(base, base + 200)]


@pytest.mark.parametrize(
    ("error", "delivered", "account"),
    [
        (NotDelivered("not reachable"), [0, 1, 2, 3], Account(received=4, delivered=4)),
        (Unconfirmed("no answer"), [0, 2, 3], Account(received=4, delivered=4, unconfirmed=1)),
        (Refused("no"), [0, 2, 3], Account(received=4, delivered=3, discarded=1)),
    ],
)
def test_each_failure_is_counted_so(
    channel: Channel, error: EventError, delivered: list[int], account: Account
) -> None:
    consumer = Consumer()
    proxy = push_supplier_of(channel, consumer)
    for number in range(4):
        publish(channel, number)
        eventually(lambda: is_settled(proxy))
        consumer.answer = failing(error) if number == 0 else consumer.answer
    assert received(consumer) == delivered
    assert totals(proxy) == account
    assert proxy.condition is ProxyCondition.CONNECTED


@pytest.mark.parametrize(
    ("error", "answers_probes", "reason"),
    [
        (Unconfirmed("no answer"), False, "4 failures in a row"),
        (NotDelivered("stuck"), True, "stuck"),
        (ValueError("a fault"), True, "ValueError: a fault"),
    ],
)
def test_a_consumer_that_accepts_no_events_is_disconnected(
    channel: Channel, error: Exception, answers_probes: bool, reason: str
) -> None:
    lost, consumer = LostClients(), Consumer(takes_batches=False, answer=failing(*[error] * 99))
    consumer.is_alive = lambda: answers_probes
    proxy = push_supplier_of(channel, consumer, on_client_lost=lost)
    publish(channel, *range(10))
    eventually(lambda: lost.reasons)
    assert reason in lost.reasons[0]
    assert is_balanced(totals(proxy))


@pytest.mark.parametrize("is_defect", [False, True])
def test_failures_and_defects_never_end_a_durable_subscription(channel: Channel, is_defect: bool) -> None:
    lost, consumer, may_answer = LostClients(), Consumer(), threading.Event()

    def is_alive() -> bool:
        if is_defect and not may_answer.is_set():
            raise ValueError("a fault")
        return may_answer.is_set()

    consumer.answer, consumer.is_alive = failing(NotDelivered("not reachable")), is_alive
    proxy = push_supplier_of(channel, consumer, name="durable", on_client_lost=lost)
    publish(channel, 1)
    eventually(lambda: proxy.failures > 10)
    assert ("ValueError: a fault" if is_defect else "not reachable") in proxy.problem
    assert proxy.condition is ProxyCondition.STALLED
    may_answer.set()
    eventually(lambda: is_settled(proxy))
    assert (received(consumer), lost.reasons, proxy.failures, proxy.problem) == ([1], [], 0, "")


def test_events_wait_in_order_or_expire_while_delivery_is_suspended_until_the_end(channel: Channel) -> None:
    consumer = Consumer()
    proxy = push_supplier_of(channel, consumer)
    publish(channel, 0)
    eventually(lambda: is_settled(proxy))
    with channel.lock:
        proxy.suspend()
    publish(channel, 1, expiry=0.01)
    publish(channel, 2, 3)
    assert totals(proxy).queued == 3
    outlast(0.01)
    with channel.lock:
        proxy.resume()
    eventually(lambda: is_settled(proxy))
    with channel.lock:
        proxy.suspend()
    publish(channel, 4)
    with channel.lock:
        proxy.end()
    assert totals(proxy) == Account(received=5, delivered=3, expired=1, discarded=1)
    publish(channel, 5)  # by a route that still leads here
    assert received(consumer) == [0, 2, 3]


def test_a_blocked_supplier_loses_no_event_and_a_steady_consumer_spends_no_budget(channel: Channel) -> None:
    consumer = Consumer()
    proxy = push_supplier_of(channel, consumer, QueuePolicy(5, OverflowRule.BLOCK_SUPPLIER, 10.0))
    with channel.lock:
        proxy.suspend()
    with ThreadPoolExecutor(1) as supplier:
        supply = supplier.submit(publish, channel, *range(200))
        eventually(lambda: totals(proxy).queued == 5)
        assert not supply.done()
        with channel.lock:
            proxy.resume()
        supply.result(60.0)
    eventually(lambda: is_settled(proxy))
    assert received(consumer) == list(range(200))
    assert channel._blocking_budget.left_s() > BUDGET_S / 2


@pytest.mark.parametrize("how", ["has left", "takes no event", "does not answer"])
def test_an_absent_consumer_blocks_nobody(channel: Channel, how: str) -> None:
    """A wait of 10 s for each event would let this test take 100 s."""
    consumer = Consumer()
    if how == "does not answer":
        consumer.answer, consumer.is_alive = failing(*[NotDelivered("away")] * 100), lambda: False
    limit_s = 0.05 if how == "takes no event" else 10.0
    proxy = push_supplier_of(channel, consumer, QueuePolicy(1, OverflowRule.BLOCK_SUPPLIER, limit_s), name="logger")
    with channel.lock:
        if how == "has left":
            proxy.leave()
        elif how == "takes no event":
            proxy.suspend()
    if how == "does not answer":
        publish(channel, 0)
        eventually(lambda: proxy.condition is ProxyCondition.STALLED)
    waits = []
    wait_for = proxy._room.wait_for
    proxy._room.wait_for = lambda *args: (waits.append(wait_for(*args)), waits[-1])[1]  # type: ignore[method-assign]
    publish(channel, *range(10))
    assert is_balanced(totals(proxy)) and totals(proxy).queued == 1
    assert waits.count(False) == (how == "takes no event")
    if how == "takes no event":  # the newest events are discarded
        with channel.lock:
            proxy.resume()
        eventually(lambda: is_settled(proxy))
        assert received(consumer) == [0]


def limits_of(proxy: ProxySupplier) -> list[float]:
    """The time limits of all later waits for room [s]; none is waited for."""
    found: list[float] = []
    proxy._room.wait_for = lambda predicate, limit_s: (found.append(limit_s), predicate())[1]  # type: ignore[method-assign, assignment]
    return found


def test_a_consumer_that_hardly_takes_events_is_not_waited_for_without_end(channel: Channel) -> None:
    channel._blocking_budget = BlockingBudget(lambda: 100.0)
    slow, other = (
        push_supplier_of(channel, Consumer(), QueuePolicy(1, OverflowRule.BLOCK_SUPPLIER, 10.0), name=name)
        for name in ("slow", "other")
    )
    with channel.lock:
        slow.suspend()
        other.suspend()
    publish(channel, 0)
    limits, others = limits_of(slow), limits_of(other)
    publish(channel, 1)
    assert (limits, others) == ([pytest.approx(4.0, abs=1.0)], [pytest.approx(4.0, abs=1.0)])
    channel._blocking_budget.spend(BUDGET_S, "slow")
    for proxy in (slow, other):  # each takes an event, so that it is waited for again
        proxy._is_too_slow = False
    slow._is_unsteady = True
    other._is_unsteady = False
    publish(channel, 2)
    assert (limits[1:], others[1:]) == ([0.0], [STEADY_S])


def test_missions_and_stops_wait_for_nobody(channel: Channel) -> None:
    proxy = push_supplier_of(channel, Consumer(), QueuePolicy(1, OverflowRule.BLOCK_SUPPLIER, 10.0))
    with channel.lock:
        proxy.suspend()
    limits = limits_of(proxy)
    for type, waits in (("mission.order", False), ("robot.stop", False), ("robot.state", True)):
        publish(channel, 1, 2, type=type)
        assert bool(limits) is waits, type


def test_a_conjunction_keeps_its_waiting_events_when_the_subscription_changes(channel: Channel) -> None:
    consumer = Consumer()
    proxy = push_supplier_of(channel, consumer, wanted=(*BOTH, *wanting("x")))

    def select(*clauses: Clause) -> None:
        with channel.lock:
            proxy.select(clauses)
            channel.update_routes()

    publish(channel, 1, type="a")
    select(*wanting("y"), *BOTH)
    publish(channel, 2, type="b")
    eventually(lambda: consumer.items)
    (item,) = consumer.items
    assert isinstance(item, CorrelatedEvents) and item.clause_number == 1
    select(*BOTH)
    publish(channel, 3, type="a")
    select()
    assert totals(proxy) == Account(received=3, delivered=2, discarded=1)


FAILURES = st.sampled_from([NotDelivered("not reachable"), Unconfirmed("no answer"), Refused("no"), None, None])


@given(
    st.lists(FAILURES, max_size=12),
    st.lists(st.tuples(st.integers(1, 5), st.integers(0, 1), st.booleans()), min_size=1, max_size=15),
    st.integers(1, 12),
    st.sampled_from([OverflowRule.DISCARD_OLDEST, OverflowRule.DISCARD_NEWEST]),
    st.booleans(),
    st.booleans(),
)
@REAL_THREADS
def test_accounts_are_exact_whatever_fails(
    channel: Channel,
    failures: list[EventError | None],
    published: list[tuple[int, int, bool]],
    size: int,
    rule: OverflowRule,
    takes_batches: bool,
    is_idempotent: bool,
) -> None:
    pending = list(failures)

    def answer(items: Sequence[QueueItem]) -> None:
        if pending and (failure := pending.pop(0)):
            raise failure

    consumer = Consumer(takes_batches, answer)
    consumer.is_idempotent = is_idempotent
    proxy = push_supplier_of(channel, consumer, QueuePolicy(size, rule), (*ALL, *BOTH), name="durable")
    number = 0
    for count, priority, pauses in published:
        publish(channel, *range(number, number + count), type="ab"[number % 2], priority=priority)
        number += count
        assert is_balanced(totals(proxy))
        if pauses:
            pause(0.001)
    eventually(lambda: proxy.condition is ProxyCondition.CONNECTED and not proxy._queue.length)
    eventually(lambda: proxy._in_flight == 0)
    with channel.lock:
        proxy.end()
        channel.proxy_suppliers.pop(proxy.id)
        channel.update_routes()
    final = proxy.totals()
    assert is_balanced(final) and final.queued == 0
    assert final.received == 2 * number  # each fits as such, and one of the patterns
    assert final.delivered - final.unconfirmed == sum(map(len, consumer.items))
    assert consumer.overlaps == 0


def test_pull_returns_one_event_at_a_time_and_then_none(channel: Channel) -> None:
    proxy = pull_supplier_of(channel, (*ALL, *BOTH))
    with pytest.raises(Disconnected):  # before it is connected
        ProxyPullSupplier(channel.lock, "pull", ALL, QueuePolicy()).pull(0.0)
    publish(channel, 1, 2, type="a")
    publish(channel, 3, type="b")
    publish(channel, 4, expiry=0.01)
    outlast(0.01)
    # The conjunction of 1 and 3 came true before 3 came as such.
    assert [int(batch.payloads[0]) for batch in pulled(proxy)] == [1, 2, 1, 3, 3]
    assert totals(proxy) == Account(received=7, delivered=5, expired=1, queued=1)  # 2 waits for another b


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


def test_a_pull_behind_one_that_has_gone_is_served_and_the_rest_waits(channel: Channel) -> None:
    """Without another event that would wake it."""
    proxy = pull_supplier_of(channel)
    stays, *gone = (Pulling(proxy) for _ in range(3))
    for client in gone:
        client.has_gone = True
    publish(channel, 1, 2)
    assert [client.result() for client in (stays, *gone)] == [1, None, None]
    assert totals(proxy) == Account(received=2, delivered=1, queued=1)
    assert [batch.payloads for batch in pulled(proxy)] == [[b"2"]]


def test_of_a_few_pulls_that_wait_the_last_is_served_first(channel: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocorba.events.proxy_supplier.MAX_PULLS", 2)
    proxy = pull_supplier_of(channel)
    first, second, third = (Pulling(proxy) for _ in range(3))
    assert first.result() is None
    publish(channel, 3, 2)
    assert (third.result(), second.result()) == (3, 2)


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
        call = [int(payload) for batch in items if isinstance(batch, EventBatch) for payload in batch.payloads]
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
@REAL_THREADS
def test_idempotent_consumers_get_all_once_in_order(
    channel: Channel, outcomes: list[str], published: list[int]
) -> None:
    bounded: list[str] = []
    for outcome in outcomes:
        bounded += ["answered", outcome] if len(bounded) % 4 == IMPATIENT.max_repeats else [outcome]
    consumer = IdempotentConsumer(bounded)
    proxy = push_supplier_of(channel, consumer, name="durable")
    number = 0
    for count in published:
        publish(channel, *range(number, number + count))
        number += count
        assert is_balanced(totals(proxy))
    eventually(lambda: is_settled(proxy))
    assert consumer.executed == list(range(number))
    assert totals(proxy) == Account(received=number, delivered=number)
    with channel.lock:
        proxy.end()


def test_a_call_that_is_never_answered_is_given_up(channel: Channel) -> None:
    """Its events could be the cause; the others must not wait for ever."""
    consumer = IdempotentConsumer(["lost"] * (1 + IMPATIENT.max_repeats))
    proxy = push_supplier_of(channel, consumer, name="durable")
    publish(channel, 0)
    eventually(lambda: is_settled(proxy))
    publish(channel, 1)
    eventually(lambda: is_settled(proxy))
    assert consumer.executed == [1]
    assert totals(proxy) == Account(received=2, delivered=2, unconfirmed=1)


def test_a_successor_does_not_get_what_its_predecessor_may_have(channel: Channel) -> None:
    consumer = IdempotentConsumer(["unanswered"])
    consumer.is_alive = lambda: False
    proxy = push_supplier_of(channel, consumer, name="durable")
    publish(channel, 0)
    eventually(lambda: proxy.condition is ProxyCondition.STALLED)
    publish(channel, 1)
    assert totals(proxy) == Account(received=2, queued=2)
    successor = Consumer()
    with channel.lock:
        proxy.leave()
        proxy.connect(successor)
    eventually(lambda: is_settled(proxy))
    assert received(successor) == [1]
    assert totals(proxy) == Account(received=2, delivered=2, unconfirmed=1)
