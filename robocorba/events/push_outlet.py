"""Delivery to a consumer that the channel calls.

If no event waits and the consumer is known to be fast, the supplier's own thread calls it. Otherwise the event waits
in the queue for the outlet's thread, which lives while there is work. Only one thread calls the client at a time.

When events follow each other quickly (a flood), only the outlet's thread calls a consumer that takes batches: the
supplier returns sooner, and large batches raise the throughput. A plain consumer would only fall behind, since it
takes one event a call.

A consumer that does not answer is stalled: the outlet probes it with exponential backoff. When it answers, delivery
continues where it stopped. After MAX_FAILURES failures in a row it is disconnected.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from robocorba.errors.events import ClientGone, EventError, NotDelivered, Refused, Unconfirmed
from robocorba.events.call_limiter import CallLimiter
from robocorba.events.clients import ConsumerPort
from robocorba.events.event import EventRun, merged
from robocorba.events.outlet import Outlet, ProxyCondition
from robocorba.events.queue import QueueItem, QueuePolicy
from robocorba.events.subscription import Subscription, SubscriptionMatch

#: Timeout of a call from a supplier's thread [s]. A consumer that hangs delays the others once by this time.
INLINE_LIMIT_S = 0.05
#: Timeout of a call from an outlet's own thread [s].
CALL_LIMIT_S = 10.0
#: Timeout of a probe of a stalled consumer [s].
PING_LIMIT_S = 1.0
#: A consumer is fast while its mean call duration is below this [s].
QUICK_S = 0.002
#: Events are a flood when they follow each other within this multiple of the mean call duration.
FLOOD_GAP = 1.5
#: Upper limit of that gap [s].
MAX_GAP_S = 0.0005
#: Pause after a stall [s]: the consumer finishes the call that timed out, so that the next event cannot overtake it.
SETTLE_S = 0.1
#: Backoff between probes: first, longest [s].
FIRST_PAUSE_S, MAX_PAUSE_S = 0.05, 1.0
#: An outlet's thread ends after this time without work [s].
IDLE_S = 5.0
#: Maximum size of a call to a consumer that takes batches [events, bytes].
BATCH_EVENTS, BATCH_BYTES = 1000, 2**20
#: If more events than this arrived during a call of the outlet's thread, it pauses to let the batch grow.
COALESCE_ABOVE = 1
#: Duration of that coalescing pause [s].
COALESCE_S = 0.001
#: Maximum number of outlet threads that call at the same time.
CONCURRENT_CALLS = 4
#: A call that hangs occupies its slot for at most this time [s].
SLOT_LIMIT_S = 0.05
#: Maximum number of calls that a thread makes in one slot.
CALLS_PER_SLOT = 16
#: A consumer is disconnected after this many failures in a row; with the backoff, a dead one after 17 s.
MAX_FAILURES = 20

_call_limiter = CallLimiter(CONCURRENT_CALLS, SLOT_LIMIT_S)
_log = logging.getLogger(__name__)


class PushOutlet(Outlet):
    """on_client_lost: called, without the lock, with the reason when the client is gone or failed too often."""

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        subscription: Subscription,
        policy: QueuePolicy,
        on_client_lost: Callable[[PushOutlet, str], None],
        name: str = "",
    ) -> None:
        super().__init__(lock, id, subscription, policy, name)
        self._on_client_lost = on_client_lost
        self._busy = False
        #: How many events a supplier's thread may deliver in one call; 0 before the first call of the outlet's thread.
        self._inline = 0
        self._mean_s = self._flood_until = 0.0
        self._failed = 0
        self._thread: threading.Thread | None = None

    client: ConsumerPort | None

    @property
    def failures(self) -> int:
        return self._failed

    def connect(self, client: ConsumerPort) -> None:
        """Begin to deliver to a consumer."""
        self.client, self.condition = client, ProxyCondition.CONNECTED
        self._failed, self._mean_s, self._inline = 0, 0.0, 0
        self._wake()

    def leave(self) -> None:
        """The consumer of a durable subscription has left; events wait for the next consumer."""
        self.client, self.condition, self._inline = None, ProxyCondition.WAITING, 0

    def suspend(self) -> None:
        """Let events wait; a stalled consumer is not probed meanwhile."""
        if self.client:
            self.condition, self._inline = ProxyCondition.SUSPENDED, 0

    def end(self) -> None:
        super().end()
        self._inline = 0

    def resume(self) -> None:
        if self.condition is ProxyCondition.SUSPENDED:
            self.condition = ProxyCondition.CONNECTED
            self._wake()

    def offer(self, run: EventRun, match: SubscriptionMatch, now: float) -> bool:
        count = len(run.payloads)
        if count > self._inline or self._busy or self._queue.length or match.slots or self._is_flooded():
            return super().offer(run, match, now)
        self.account.received += count
        self._busy, self._in_flight = True, count
        return True

    def _is_flooded(self) -> bool:
        """Whether the consumer takes batches and events arrive faster than single calls could deliver them."""
        return self._inline > 1 and time.perf_counter() < self._flood_until

    def deliver(self, run: EventRun) -> bool:
        client = self.client
        began = time.perf_counter()
        try:
            if client is None:
                raise NotDelivered("the client has left")
            client.deliver((run,), INLINE_LIMIT_S)
        except EventError as failure:
            self._note_failure(failure, client, (run,))
            return False
        took = time.perf_counter() - began
        with self._lock:
            self._note_success(client, len(run.payloads), took)
        return took < QUICK_S

    def defer(self, run: EventRun) -> None:
        with self._lock:
            self._busy, self._in_flight = False, 0
            self._requeue([run])
            self._wake()

    def _wake(self) -> None:
        """Wake or start the thread if there is work. While a call is in progress, its end calls this method."""
        if self._busy or self.is_ended:
            return
        is_stalled = self.condition is ProxyCondition.STALLED
        if not is_stalled and not (self.condition is ProxyCondition.CONNECTED and self._queue.length):
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"to {self.id}", daemon=True)
            self._thread.start()
        elif not is_stalled:  # else it wakes up when the next probe is due
            self._changed.notify()

    def _run(self) -> None:
        while (task := self._next_task()) is not None:
            client, items = task
            if not items:
                self._probe(client)
                continue
            with _call_limiter.slot():
                self._call(client, items)
                for _ in range(CALLS_PER_SLOT - 1):
                    if not (items := self._next_of_slot(client)):
                        break
                    self._call(client, items)
            self._coalesce(client)

    def _next_task(self) -> tuple[ConsumerPort, list[QueueItem]] | None:
        """Client and items to deliver; no items if the client must be probed; None when there is no more work."""
        with self._lock:
            idle_until = time.monotonic() + IDLE_S
            while not self.is_ended:
                if self.condition is ProxyCondition.STALLED and self._pause() and self.client:
                    return self.client, []
                if self.condition is ProxyCondition.CONNECTED and self.client and self._queue and not self._busy:
                    items = self._claim_next(self.client)
                    if items:
                        return self.client, items
                    continue
                left = idle_until - time.monotonic()
                if left <= 0:
                    break
                self._changed.wait(left)
            self._thread = None
            return None

    def _next_of_slot(self, client: ConsumerPort) -> list[QueueItem]:
        """Items of the next call in the same slot, for a client that takes one event a call; empty to end the slot."""
        with self._lock:
            is_over = (
                client.takes_batches or client is not self.client or self.condition is not ProxyCondition.CONNECTED
            )
            return [] if is_over or self._busy or not self._queue.length else self._claim_next(client)

    def _claim_next(self, client: ConsumerPort) -> list[QueueItem]:
        """Items to deliver in one call; empty if all waiting events have expired."""
        items: list[QueueItem] = []
        if client.takes_batches:
            items = self._take(BATCH_EVENTS, BATCH_BYTES)
            runs = [item for item in items if isinstance(item, EventRun)]
            if len(runs) == len(items):
                items = [*merged(runs)]
        elif run := self._take_one():
            items = [run]
        if items:
            self._busy, self._in_flight = True, sum(map(len, items))
        return items

    def _coalesce(self, client: ConsumerPort) -> None:
        """Pause to let a batch grow, if events arrive faster than calls are made."""
        if client.takes_batches and COALESCE_ABOVE < self._queue.length < min(BATCH_EVENTS, self.policy.size // 2):
            time.sleep(COALESCE_S)

    def _pause(self) -> bool:
        """Wait for the next probe; False if the consumer is no longer stalled."""
        pause = min(FIRST_PAUSE_S * 2.0 ** min(max(self._failed - 1, 0), 10), MAX_PAUSE_S)
        return not self._changed.wait_for(lambda: self.is_ended or self.condition is not ProxyCondition.STALLED, pause)

    def _call(self, client: ConsumerPort, items: list[QueueItem]) -> None:
        """Deliver items from the queue."""
        began = time.perf_counter()
        try:
            client.deliver(items, CALL_LIMIT_S)
        except EventError as failure:
            self._note_failure(failure, client, items)
            return
        took = time.perf_counter() - began
        with self._lock:
            self._note_success(client, sum(map(len, items)), took)

    def _note_success(self, client: ConsumerPort, count: int, took: float) -> None:
        self._busy, self._in_flight = False, 0
        self.account.delivered += count
        self._failed = 0
        self._mean_s = 0.9 * self._mean_s + 0.1 * took if self._mean_s else took
        self._flood_until = time.perf_counter() + min(FLOOD_GAP * self._mean_s, MAX_GAP_S)
        if self._mean_s > QUICK_S or client is not self.client or self.condition is not ProxyCondition.CONNECTED:
            self._inline = 0
        else:
            self._inline = BATCH_EVENTS if client.takes_batches else 1
        if self._queue.length:
            self._wake()

    def _note_failure(self, failure: EventError, client: ConsumerPort | None, items: Sequence[QueueItem]) -> None:
        count = sum(map(len, items))
        with self._lock:
            self._busy, self._in_flight = False, 0
            if isinstance(failure, Refused):  # the client is alive
                self.account.discarded += count
                _log.info("%s refused an event (%s)", self.id, failure)
            elif isinstance(failure, Unconfirmed):
                self.account.delivered += count
                self.account.unconfirmed += count
            else:
                self._requeue(items)
            if client is not None and client is self.client and not isinstance(failure, Refused):
                self._failed += 1
                if self.condition is ProxyCondition.CONNECTED:
                    self.condition, self._inline = ProxyCondition.STALLED, 0
                    self._changed.notify()  # the thread may be waiting for work
                    _log.info("the consumer of %s at %s is stalled (%s)", self.id, client.address, failure)
            is_lost = isinstance(failure, ClientGone) or (self._failed >= MAX_FAILURES and not self.name)
            self._wake()
        if is_lost:
            self._on_client_lost(self, str(failure))

    def _requeue(self, items: Sequence[QueueItem]) -> None:
        if self.is_ended:
            self.account.discarded += sum(map(len, items))
        else:
            self.account.discarded += self._queue.put_back([*items])

    def _probe(self, client: ConsumerPort) -> None:
        """Probe a stalled client; resume delivery, or report the client as lost."""
        gone = ""
        try:
            is_there = client.answers(PING_LIMIT_S)
        except ClientGone as error:
            is_there, gone = False, str(error)
        if is_there:
            time.sleep(SETTLE_S)
        with self._lock:
            if client is not self.client or self.condition is not ProxyCondition.STALLED:
                return
            if is_there:
                self.condition = ProxyCondition.CONNECTED
                return
            self._failed += 1
            if not gone and self._failed >= MAX_FAILURES and not self.name:
                gone = f"{self._failed} failures in a row"
        if gone:
            self._on_client_lost(self, gone)
