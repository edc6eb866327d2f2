"""Proxy suppliers: each serves a consumer, with its subscription, its queue and its account."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable

from robocorba.errors.events import Disconnected, ProxyGone
from robocorba.events.account import Account
from robocorba.events.blocking_budget import STEADY_S, BlockingBudget
from robocorba.events.correlation import Correlator
from robocorba.events.event import CorrelatedEvents, EventBatch
from robocorba.events.proxy import Proxy, ProxyCondition, ProxyKind
from robocorba.events.queue import EventQueue, OverflowRule, QueueItem, QueuePolicy
from robocorba.events.subscription import Subscription, SubscriptionMatch

#: Maximum number of pulls that wait at one proxy; a further one ends the first of them.
MAX_PULLS = 64
#: Interval at which a waiting pull checks whether its caller has gone [s].
CHECK_INTERVAL_S = 1.0


class ProxySupplier(Proxy):
    """Base of both kinds. A name makes the subscription durable: it outlives its consumer, and failed deliveries never
    end it."""

    def __init__(
        self, lock: threading.Lock, id: str, subscription: Subscription, policy: QueuePolicy, name: str = ""
    ) -> None:
        super().__init__(lock, id, name)
        self._changed = threading.Condition(lock)
        self._room = threading.Condition(lock)
        self._queue = EventQueue(policy, self.account)
        self.subscription: Subscription = ()
        #: Of its conjunctions, by their indices in the subscription.
        self._correlators: dict[int, Correlator] = {}
        self.select(subscription)
        self._in_flight = 0
        #: Mean and shortest duration of the latest calls to its consumer [s], 0 before the first one.
        self.mean_s = self.fastest_s = 0.0
        #: Whether it let a supplier wait in vain since it last took an event.
        self._is_too_slow = False
        #: Whether a supplier waited longer for it than for a steady consumer, the last time.
        self._is_unsteady = False
        self._events_taken = 0

    @property
    def _waiting(self) -> int:
        """Number of events of conjunctions that are not complete yet."""
        return sum(map(len, self._correlators.values()))

    @property
    def policy(self) -> QueuePolicy:
        return self._queue.policy

    @property
    def is_selecting(self) -> bool:
        """Whether it receives events; a durable proxy does also while its consumer is away."""
        return not self.is_ended and (self.condition is not ProxyCondition.WAITING or bool(self.name))

    @property
    def is_blocking(self) -> bool:
        return self.policy.when_full is OverflowRule.BLOCK_SUPPLIER

    def select(self, subscription: Subscription) -> None:
        """Change the subscription; queued events stay, and what waits in conjunctions that it has, too."""
        waited, kept = self._waiting, {correlator.clause: correlator for correlator in self._correlators.values()}
        self.subscription, self._correlators = subscription, {}
        for number, clause in enumerate(subscription):
            if clause.is_conjunction:
                correlator = kept.pop(clause) if clause in kept else Correlator(number, clause, self.policy.size)
                correlator.clause_number, correlator.limit = number, self.policy.size
                self._correlators[number] = correlator
        self.account.discarded += waited - self._waiting

    def resize(self, policy: QueuePolicy) -> None:
        self._queue.resize(policy)

    def accept(self, batch: EventBatch, match: SubscriptionMatch, now: float) -> bool:
        """Queue a batch, or let the caller claim it: see channel.Claims."""
        for number, pattern_numbers in match.conjunctions:
            self.account.received += len(batch)
            for index in range(len(batch)):
                event = batch.part(index, index + 1)
                if together := self._correlators[number].add(pattern_numbers, event, now, self.account):
                    self._queue.put(together)
        if match.single:
            self.account.received += len(batch)
            self._queue.put(batch)
        self._wake()
        return False

    def wait_for_room(self, count: int, limit_s: float, budget: BlockingBudget) -> None:
        """Wait for room for `count` events, at most for `limit_s`, the queue's time limit, and what is left of the
        budget; releases the lock meanwhile.

        Not for a consumer that is away or does not answer; one that let a supplier wait in vain is not waited for again
        until it has taken an event."""

        def has_room() -> bool:
            is_here = self.condition in (ProxyCondition.CONNECTED, ProxyCondition.SUSPENDED)
            is_waited_for = self.is_blocking and is_here and not self._is_too_slow
            return (
                self.is_ended
                or not is_waited_for
                or self.policy.size - self._queue.length >= min(count, self.policy.size)
            )

        if has_room():
            return
        left_s = budget.left_s()
        limit_s = min(limit_s, self.policy.block_limit, max(left_s, 0.0 if self._is_unsteady else STEADY_S))
        began, taken = time.monotonic(), self._events_taken
        if not self._room.wait_for(has_room, max(0.0, limit_s)):
            self._is_too_slow = True
        held_up_s = time.monotonic() - began - STEADY_S * (self._events_taken - taken)
        self._is_unsteady = held_up_s > 0.0 or (self._is_unsteady and left_s <= 0.0)
        budget.spend(max(0.0, held_up_s), self.name or self.id)

    def deliver(self, batch: EventBatch) -> bool:
        """Deliver a claimed batch; called without the lock. False if the call was slow or failed."""
        raise NotImplementedError

    def defer(self, batch: EventBatch) -> None:
        """Return a claimed batch to the queue, for the proxy's own thread; called without the lock."""
        raise NotImplementedError

    def totals(self) -> Account:
        return self.account.snapshot(self._queue.length + self._in_flight + self._waiting)

    def oldest_s(self) -> float:
        """Age of the next event in the queue [s], 0 if there is none."""
        oldest = self._queue.oldest_time()
        return max(0.0, time.monotonic() - oldest) if oldest is not None else 0.0

    def end(self) -> None:
        """Stop deliveries and wake all waiting threads. Queued events count as discarded."""
        super().end()
        self._queue.discard_all()
        self.select(())
        self._changed.notify_all()
        self._room.notify_all()

    def _take(self, max_events: int, max_bytes: int = 2**62) -> list[QueueItem]:
        """The next items to deliver; empty if all queued events have expired."""
        items = self._queue.take(max_events, time.monotonic(), max_bytes)
        self._events_taken += sum(map(len, items))
        self._is_too_slow = False
        if self.is_blocking:
            self._room.notify_all()
        return items

    def _take_one(self) -> EventBatch | None:
        """The next single event. Of a conjunction, the other events go back to the head of the queue."""
        items = self._take(1)
        if not items:
            return None
        if isinstance(items[0], CorrelatedEvents):
            self._queue.put_back(items[0].batches[1:])
            return items[0].batches[0]
        return items[0]

    def _wake(self) -> None:
        self._changed.notify_all()


class ProxyPullSupplier(ProxySupplier):
    """Serves a consumer that pulls events, one at a time.

    Of several calls that wait the last one gets the next event: a client that has given a call up, and pulls again, may
    have left the earlier one behind."""

    kind = ProxyKind.PULL_SUPPLIER
    _is_released = False

    def __init__(self, lock: threading.Lock, id: str, subscription: Subscription, policy: QueuePolicy) -> None:
        super().__init__(lock, id, subscription, policy)
        self._numbers = itertools.count()
        #: Calls that wait, the last one at the end: whether the caller has gone, by the number of the call.
        self._pulls: dict[int, Callable[[], bool]] = {}

    @property
    def pulls(self) -> int:
        """Number of calls that wait."""
        return len(self._pulls)

    def release(self) -> None:
        """Let all waiting calls return, because the process ends."""
        self._is_released = True
        self._changed.notify_all()

    def pull(self, limit_s: float, has_gone: Callable[[], bool] = lambda: False) -> EventBatch | None:
        """Wait for the next event, returned as a batch of one; None after `limit_s`, when the process ends, when the
        caller `has_gone`, or when MAX_PULLS later calls wait.

        Called without the lock. Raises Disconnected, also if the proxy ends meanwhile, as the OMG standard requires
        for a call in progress; ProxyGone if it had ended before."""
        deadline = time.monotonic() + limit_s
        with self._lock:
            number = next(self._numbers)
            self._pulls[number] = has_gone
            try:
                if self.is_ended:
                    raise ProxyGone(f"proxy {self.id} was disconnected")
                return self._wait_for_event(number, deadline)
            finally:
                del self._pulls[number]
                self.used_at = time.monotonic()
                if self._queue.length:  # for another call
                    self._changed.notify_all()

    def _wait_for_event(self, number: int, deadline: float) -> EventBatch | None:
        while True:
            if self.is_ended or self.condition is ProxyCondition.WAITING:
                raise Disconnected(f"proxy {self.id} is not connected")
            if self._queue.length and self._is_served(number):
                batch = self._take_one()
                if batch is not None:
                    self.account.delivered += 1
                    return batch
                continue
            left = deadline - time.monotonic()
            is_excess = number not in list(self._pulls)[-MAX_PULLS:]
            if left <= 0 or self._is_released or self._pulls[number]() or is_excess:
                return None
            self._changed.wait(min(left, CHECK_INTERVAL_S))

    def _is_served(self, number: int) -> bool:
        """Whether a call gets the next event."""
        return next((each for each in reversed(self._pulls) if not self._pulls[each]()), None) == number
