"""What is kept for one consumer: its subscription, its queue and its account.

All state of outlets is guarded by the channel's lock. Methods are called with it unless they say otherwise.
"""

from __future__ import annotations

import threading
import time
from enum import Enum
from typing import Any

from robocorba.errors.events import Disconnected, ProxyGone
from robocorba.events.account import Account, Totals
from robocorba.events.clients import Client
from robocorba.events.correlation import Correlator
from robocorba.events.event import Run, Together
from robocorba.events.queue import EventQueue, Item, OverflowRule, QueuePolicy
from robocorba.events.subscription import Fit, Subscription


class Condition(Enum):
    """Of a proxy."""

    WAITING = 0
    CONNECTED = 1
    STALLED = 2
    SUSPENDED = 3


class Selection:
    """How what comes in fits a subscription: which events wait for others, and what to put into the queue."""

    def __init__(self, subscription: Subscription, limit: int, before: Selection | None = None) -> None:
        """Conjunctions that stood in the subscription `before` as well keep the events that wait in them."""
        self.subscription = subscription
        kept = {correlator.clause: correlator for correlator in before._correlators.values()} if before else {}
        self._correlators: dict[int, Correlator] = {}
        for number, clause in enumerate(subscription):
            if clause.is_conjunction:
                correlator = kept.pop(clause) if clause in kept else Correlator(number, clause, limit)
                correlator.which, correlator.limit = number, limit
                self._correlators[number] = correlator

    def __len__(self) -> int:
        return sum(map(len, self._correlators.values()))

    def correlate(self, run: Run, fit: Fit, account: Account, now: float) -> list[Together]:
        """Offer the events of a run to the conjunctions; those that came true."""
        found: list[Together] = []
        for number, fitting in fit.slots:
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
    """Base of both kinds of outlet: what is subscribed, queued and counted.

    `name` makes it durable: it outlives its consumer, and is never given up."""

    def __init__(
        self, lock: threading.Lock, id: str, subscription: Subscription, policy: QueuePolicy, name: str = ""
    ) -> None:
        self.id, self.name = id, name
        self.condition = Condition.WAITING
        self.is_ended = False
        self.account = Account()
        self.client: Client | None = None
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
        """Of calls to the client, in a row."""
        return 0

    @property
    def is_selecting(self) -> bool:
        """Whether events are meant for it; for a durable one also while its consumer is away."""
        return not self.is_ended and (self.condition is not Condition.WAITING or bool(self.name))

    @property
    def is_blocking(self) -> bool:
        return self.policy.when_full is OverflowRule.BLOCK_SUPPLIER

    def lacks_room(self, count: int) -> bool:
        """Whether a supplier of so many events has to wait for it."""
        return self.is_blocking and not self.is_ended and self._queue.room < min(count, self.policy.size)

    def select(self, subscription: Subscription) -> None:
        """Change what it gets from now on; what is queued stays."""
        waited = len(self._selection)
        self._selection = Selection(subscription, self.policy.size, self._selection)
        self.account.discarded += waited - len(self._selection)

    def resize(self, policy: QueuePolicy) -> None:
        self.account.discarded += self._queue.resize(policy)

    def offer(self, run: Run, fit: Fit, now: float) -> bool:
        """Take in a run; True where the caller has claimed it and must call `deliver` with it, without the lock."""
        if fit.slots:
            for together in self._selection.correlate(run, fit, self.account, now):
                self._enqueue(together)
        if fit.single:
            self.account.received += len(run)
            self._enqueue(run)
        self._wake()
        return False

    def wait_for_room(self, count: int, limit_s: float) -> None:
        """Let a supplier of `count` events wait until there is room, at most `limit_s`; lets go of the lock."""
        self._room.wait_for(lambda: not self.lacks_room(count), limit_s)

    def deliver(self, run: Run) -> bool:
        """Deliver what was claimed, without the lock. False where that took long."""
        raise NotImplementedError

    def hand_over(self, run: Run) -> None:
        """Give back what was claimed, without the lock: it is delivered later, by somebody else."""
        raise NotImplementedError

    def connect(self, client: Any) -> None:
        """Begin to serve the client for this kind of outlet."""
        raise NotImplementedError

    def totals(self) -> Totals:
        """Its account now."""
        return self.account.totals(len(self._queue) + self._in_flight + len(self._selection))

    def oldest_s(self) -> float:
        """The age of the event that is next."""
        oldest = self._queue.oldest_time()
        return max(0.0, time.time() - oldest) if oldest is not None else 0.0

    def end(self) -> None:
        """No more deliveries; whoever waits is woken. What is queued counts as discarded."""
        self.is_ended = True
        self.account.discarded += self._queue.clear() + len(self._selection)
        self._selection = Selection((), 1)
        self._changed.notify_all()
        self._room.notify_all()

    def _take(self, most: int, most_bytes: int = 2**62) -> list[Item]:
        """What is to be delivered next, nothing where the queue holds only what has expired."""
        items, expired = self._queue.take(most, time.time(), most_bytes)
        self.account.expired += expired
        if self.is_blocking:
            self._room.notify_all()
        return items

    def _take_one(self) -> Run | None:
        """The next single event; of a conjunction the first one, the others stay next in the queue."""
        items = self._take(1)
        if not items:
            return None
        if isinstance(items[0], Together):
            self.account.discarded += self._queue.put_back(list(items[0].runs[1:]))
            return items[0].runs[0]
        return items[0]

    def _enqueue(self, item: Item) -> None:
        self.account.discarded += self._queue.put(item)

    def _wake(self) -> None:
        self._changed.notify_all()


class PullOutlet(Outlet):
    """Serves a consumer that fetches events, one at a time."""

    _is_released = False

    def release(self) -> None:
        """This process ends: nobody waits for an event any more."""
        self._is_released = True
        self._changed.notify_all()

    def connect(self, client: Client | None) -> None:
        """Begin to collect events; a nil client is never called back."""
        self.client, self.condition = client, Condition.CONNECTED

    def pull(self, limit_s: float) -> Run | None:
        """The next event, as a run of one, once there is one; None after `limit_s`, and where this process ends before.

        Raises Disconnected, ProxyGone."""
        deadline = time.monotonic() + limit_s
        with self._lock:
            while True:
                if self.is_ended:
                    raise ProxyGone(f"proxy {self.id} was disconnected")
                if self.condition is Condition.WAITING:
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
