"""Outlets: the side of a proxy that serves a consumer, with its subscription, its queue and its account.

The channel's lock guards all state of outlets. Methods are called with the lock held, except where noted.
"""

from __future__ import annotations

import threading
import time
from enum import Enum
from typing import Any

from robocorba.errors.events import Disconnected, ProxyGone
from robocorba.events.account import Account, Totals
from robocorba.events.clients import ClientPort
from robocorba.events.correlation import Correlator
from robocorba.events.event import CorrelatedEvents, EventRun
from robocorba.events.queue import EventQueue, OverflowRule, QueueItem, QueuePolicy
from robocorba.events.subscription import Subscription, SubscriptionMatch


class ProxyCondition(Enum):
    """Condition of a proxy."""

    WAITING = 0
    CONNECTED = 1
    STALLED = 2
    SUSPENDED = 3


class Selection:
    """Applies a subscription to events; holds the events of conjunctions that are not complete yet."""

    def __init__(self, subscription: Subscription, limit: int, before: Selection | None = None) -> None:
        """Conjunctions that the selection `before` has too keep their waiting events."""
        self.subscription = subscription
        kept = {correlator.clause: correlator for correlator in before._correlators.values()} if before else {}
        self._correlators: dict[int, Correlator] = {}
        for number, clause in enumerate(subscription):
            if clause.is_conjunction:
                correlator = kept.pop(clause) if clause in kept else Correlator(number, clause, limit)
                correlator.clause_number, correlator.limit = number, limit
                self._correlators[number] = correlator

    def __len__(self) -> int:
        return sum(map(len, self._correlators.values()))

    def correlate(
        self, run: EventRun, match: SubscriptionMatch, account: Account, now: float
    ) -> list[CorrelatedEvents]:
        """Add the events of a run to the matching conjunctions; returns those that are complete now."""
        found: list[CorrelatedEvents] = []
        for number, fitting in match.slots:
            correlator = self._correlators[number]
            account.received += len(run)
            for index in range(len(run)):
                outcome = correlator.add(fitting, run.part(index, index + 1), now)
                account.expired += outcome.expired
                account.discarded += outcome.discarded
                if outcome.together:
                    found.append(outcome.together)
        return found


class Outlet:
    """Base of both kinds of outlet: subscription, queue and account.

    name: makes it durable: it outlives its consumer, and failed deliveries never end it."""

    def __init__(
        self, lock: threading.Lock, id: str, subscription: Subscription, policy: QueuePolicy, name: str = ""
    ) -> None:
        self.id, self.name = id, name
        self.condition = ProxyCondition.WAITING
        self.is_ended = False
        self.account = Account()
        self.client: ClientPort | None = None
        self._lock = lock
        self._changed = threading.Condition(lock)
        self._room = threading.Condition(lock)
        self._queue = EventQueue(policy)
        self._selection = Selection(subscription, policy.size)
        self._in_flight = 0

    @property
    def subscription(self) -> Subscription:
        return self._selection.subscription

    @property
    def policy(self) -> QueuePolicy:
        return self._queue.policy

    @property
    def failures(self) -> int:
        """Number of failed calls to the client in a row."""
        return 0

    @property
    def is_selecting(self) -> bool:
        """Whether it receives events; a durable outlet does also while its consumer is away."""
        return not self.is_ended and (self.condition is not ProxyCondition.WAITING or bool(self.name))

    @property
    def is_blocking(self) -> bool:
        return self.policy.when_full is OverflowRule.BLOCK_SUPPLIER

    def lacks_room(self, count: int) -> bool:
        """Whether a supplier of `count` events has to wait for room in the queue."""
        return self.is_blocking and not self.is_ended and self._queue.room < min(count, self.policy.size)

    def select(self, subscription: Subscription) -> None:
        """Change the subscription; queued events stay."""
        waited = len(self._selection)
        self._selection = Selection(subscription, self.policy.size, self._selection)
        self.account.discarded += waited - len(self._selection)

    def resize(self, policy: QueuePolicy) -> None:
        self.account.discarded += self._queue.resize(policy)

    def offer(self, run: EventRun, match: SubscriptionMatch, now: float) -> bool:
        """Accept a run. True if the caller has claimed it and must call `deliver` or `defer` without the lock."""
        if match.slots:
            for together in self._selection.correlate(run, match, self.account, now):
                self._enqueue(together)
        if match.single:
            self.account.received += len(run)
            self._enqueue(run)
        self._wake()
        return False

    def wait_for_room(self, count: int, limit_s: float) -> None:
        """Wait at most `limit_s` for room for `count` events; releases the lock meanwhile."""
        self._room.wait_for(lambda: not self.lacks_room(count), limit_s)

    def deliver(self, run: EventRun) -> bool:
        """Deliver a claimed run; called without the lock. False if the call was slow or failed."""
        raise NotImplementedError

    def defer(self, run: EventRun) -> None:
        """Leave a claimed run to the outlet's own thread; called without the lock."""
        raise NotImplementedError

    def connect(self, client: Any) -> None:
        """Begin to serve a client."""
        raise NotImplementedError

    def totals(self) -> Totals:
        """Snapshot of its account."""
        return self.account.totals(len(self._queue) + self._in_flight + len(self._selection))

    def oldest_s(self) -> float:
        """Age of the next event in the queue [s], 0 if there is none."""
        oldest = self._queue.oldest_time()
        return max(0.0, time.time() - oldest) if oldest is not None else 0.0

    def end(self) -> None:
        """Stop deliveries and wake all waiting threads. Queued events count as discarded."""
        self.is_ended = True
        self.account.discarded += self._queue.clear() + len(self._selection)
        self._selection = Selection((), 1)
        self._changed.notify_all()
        self._room.notify_all()

    def _take(self, max_events: int, max_bytes: int = 2**62) -> list[QueueItem]:
        """The next items to deliver; empty if all queued events have expired."""
        items, expired = self._queue.take(max_events, time.time(), max_bytes)
        self.account.expired += expired
        if self.is_blocking:
            self._room.notify_all()
        return items

    def _take_one(self) -> EventRun | None:
        """The next single event. Of a conjunction, the other events go back to the head of the queue."""
        items = self._take(1)
        if not items:
            return None
        if isinstance(items[0], CorrelatedEvents):
            self.account.discarded += self._queue.put_back(list(items[0].runs[1:]))
            return items[0].runs[0]
        return items[0]

    def _enqueue(self, item: QueueItem) -> None:
        self.account.discarded += self._queue.put(item)

    def _wake(self) -> None:
        self._changed.notify_all()


class PullOutlet(Outlet):
    """Serves a consumer that pulls events, one at a time."""

    _is_released = False

    def release(self) -> None:
        """Let all waiting calls return, because the process ends."""
        self._is_released = True
        self._changed.notify_all()

    def connect(self, client: ClientPort | None) -> None:
        """Begin to queue events. A client of None is not notified of its disconnection."""
        self.client, self.condition = client, ProxyCondition.CONNECTED

    def pull(self, limit_s: float) -> EventRun | None:
        """Wait for the next event, returned as a run of one; None after `limit_s`, or when the process ends.

        Called without the lock. Raises Disconnected, ProxyGone."""
        deadline = time.monotonic() + limit_s
        with self._lock:
            while True:
                if self.is_ended:
                    raise ProxyGone(f"proxy {self.id} was disconnected")
                if self.condition is ProxyCondition.WAITING:
                    raise Disconnected(f"proxy {self.id} is not connected")
                if self._queue:
                    run = self._take_one()
                    if run is not None:
                        self.account.delivered += 1
                        return run
                    continue
                left = deadline - time.monotonic()
                if left <= 0 or self._is_released:
                    return None
                self._changed.wait(left)
