"""Delivery to a consumer that the channel calls.

If no event waits and the consumer is known to be fast, the supplier's own thread calls it ("inline"). Otherwise the
event waits in the queue for the thread of the proxy, which lives while there is work. Only one thread calls the client
at a time.

When events follow each other quickly (a flood), only the thread of the proxy calls a consumer that takes batches: the
supplier returns sooner, and larger calls raise the throughput. A plain consumer would only fall behind, since it
takes one event per call.

A consumer that does not answer is stalled: the proxy probes it with exponential backoff. When it answers, delivery
continues where it stopped. After too many failures in a row it is disconnected.

A call without an answer may have been executed, or still wait in the consumer, where a later one could overtake it. To
an idempotent consumer, which recognises a repeated call, the proxy repeats it before it goes on, so that each event
arrives once and in order. For any other its events count as delivered, but unconfirmed.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from robocorba.errors.events import ClientGone, EventError, InternalFault, NotDelivered, Refused, Unconfirmed
from robocorba.events.call_limiter import CallLimiter
from robocorba.events.clients import ConsumerPort
from robocorba.events.event import EventBatch, merged
from robocorba.events.policies import DeliveryPolicy
from robocorba.events.proxy import ProxyCondition, ProxyKind
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.queue import QueueItem, QueuePolicy
from robocorba.events.subscription import Subscription, SubscriptionMatch
from robocorba.system.background import Background

#: More than a few threads that call at the same time only wait for the interpreter lock, and each call costs twice as
#: much; a call that hangs occupies its slot for at most 50 ms.
_call_limiter = CallLimiter(4, 0.05)
_log = logging.getLogger(__name__)


class ProxyPushSupplier(ProxySupplier):
    """Calls a consumer. `leave` ends the service of a client, and `end` that of the proxy.

    on_client_lost: called, without the lock, with the reason when the client is gone or failed too often."""

    kind = ProxyKind.PUSH_SUPPLIER
    client: ConsumerPort | None

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        subscription: Subscription,
        policy: QueuePolicy,
        delivery: DeliveryPolicy,
        on_client_lost: Callable[[ProxyPushSupplier, str], None],
        name: str = "",
    ) -> None:
        super().__init__(lock, id, subscription, policy, name)
        #: Why the last call failed, empty after one that did not.
        self.problem = ""
        self._on_client_lost = on_client_lost
        self._delivery = delivery
        #: Whether a thread is calling the client, or has claimed a batch for it.
        self._busy = False
        #: How many events a supplier's thread may deliver in one call; 0 before the first call of the proxy's thread.
        self._inline = 0
        #: Events that arrive before this time are a flood [s, time.perf_counter].
        self._flood_until = 0.0
        self._thread: Background | None = None
        #: The items of a call without an answer, which is to be repeated; they are in flight meanwhile.
        self._unanswered: Sequence[QueueItem] = ()
        #: How many times the current call has been, or is to be, repeated.
        self._repeats = 0

    def connect(self, client: ConsumerPort) -> None:
        self._give_up_repeating()
        super().connect(client)
        self.failures, self.mean_s, self._inline = 0, 0.0, 0
        self.problem = ""
        self._wake()

    def leave(self) -> None:
        """The consumer of a durable subscription has left; events wait for the next consumer."""
        self._give_up_repeating()
        self.client, self.condition, self._inline = None, ProxyCondition.WAITING, 0
        self._room.notify_all()  # suppliers no longer wait for it

    def suspend(self) -> None:
        """Let events wait; a stalled consumer is not probed meanwhile."""
        if self.client:
            self.condition, self._inline = ProxyCondition.SUSPENDED, 0

    def resume(self) -> None:
        if self.condition is ProxyCondition.SUSPENDED:
            self.condition = ProxyCondition.CONNECTED
            self._wake()

    def end(self) -> None:
        self._give_up_repeating()
        super().end()
        self._inline = 0

    def accept(self, batch: EventBatch, match: SubscriptionMatch, now: float) -> bool:
        count = len(batch.payloads)
        if batch.via == self.id:  # a foreign channel has had it
            return False
        if count > self._inline or self._busy or self._queue.length or match.conjunctions:
            return super().accept(batch, match, now)
        if self._inline > 1 and time.perf_counter() < self._flood_until:  # a flood, and the consumer takes batches
            return super().accept(batch, match, now)
        self.account.received += count
        self._busy, self._in_flight = True, count
        return True

    def deliver(self, batch: EventBatch) -> bool:
        return self._call(self.client, (batch,), self._delivery.inline_timeout_s)

    def defer(self, batch: EventBatch) -> None:
        with self._lock:
            self._busy, self._in_flight = False, 0
            self._requeue([batch])
            self._wake()

    def _wake(self) -> None:
        """Wake or start the thread if there is work. While a call is in progress, its end calls this method."""
        if self._busy or self.is_ended:
            return
        is_stalled = self.condition is ProxyCondition.STALLED
        has_work = self._queue.length or self._unanswered
        if not is_stalled and not (self.condition is ProxyCondition.CONNECTED and has_work):
            return
        if self._thread is None:
            self._thread = Background(f"to {self.id}", self._run, self._thread_failed)
            self._thread.start()
        elif not is_stalled:  # else it wakes up when the next probe is due
            self._changed.notify()

    def _run(self) -> None:
        delivery = self._delivery
        while (task := self._next_task()) is not None:
            client, items = task
            if not items:
                self._probe(client)
                continue
            with _call_limiter.slot():
                self._call(client, items, delivery.call_timeout_s)
            if client.takes_batches and 1 < self._queue.length < min(delivery.call_events, self.policy.size // 2):
                time.sleep(delivery.coalesce_s)

    def _thread_failed(self, reason: str) -> None:
        """The proxy's thread has ended: the consumer is stalled, so that the next one probes it first."""
        with self._lock:
            self._thread, self._busy, self.problem = None, False, reason
            self.account.discarded += self._in_flight
            self._unanswered, self._in_flight, self._repeats = (), 0, 0
            self.failures += 1
            if self.condition is ProxyCondition.CONNECTED:
                self.condition, self._inline = ProxyCondition.STALLED, 0
                self._room.notify_all()
            is_lost = self.failures >= self._delivery.max_failures and not self.name
            self._wake()
        if is_lost:
            self._on_client_lost(self, reason)

    def _next_task(self) -> tuple[ConsumerPort, list[QueueItem]] | None:
        """Client and items to deliver; no items if the client must be probed; None when there is no more work."""
        with self._lock:
            idle_until = time.monotonic() + self._delivery.idle_s
            while not self.is_ended:
                if self.condition is ProxyCondition.STALLED and self._pause() and self.client:
                    return self.client, []
                has_work = self._queue.length or self._unanswered
                if self.condition is ProxyCondition.CONNECTED and self.client and has_work and not self._busy:
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

    def _claim_next(self, client: ConsumerPort) -> list[QueueItem]:
        """Items to deliver in one call; empty if all waiting events have expired."""
        if self._unanswered:
            items, self._unanswered, self._busy = [*self._unanswered], (), True
            return items
        items = []
        if client.takes_batches:
            items = self._take(self._delivery.call_events, self._delivery.call_bytes)
            batches = [item for item in items if isinstance(item, EventBatch)]
            if len(batches) == len(items):
                items = [*merged(batches)]
        elif batch := self._take_one():
            items = [batch]
        if items:
            self._busy, self._in_flight = True, sum(map(len, items))
        return items

    def _pause(self) -> bool:
        """Wait for the next probe; False if the consumer is no longer stalled."""
        pause = self._delivery.backoff.pause_s(self.failures)
        return not self._changed.wait_for(lambda: self.is_ended or self.condition is not ProxyCondition.STALLED, pause)

    def _call(self, client: ConsumerPort | None, items: Sequence[QueueItem], timeout_s: float) -> bool:
        """Deliver claimed items. False if the call was slow or failed."""
        began = time.perf_counter()
        try:
            if client is None:
                raise NotDelivered("the client has left")
            client.deliver(items, timeout_s)
        except EventError as failure:
            self._note_failure(failure, client, items)
            return False
        except Exception as error:  # a defect: neither the supplier whose thread this is nor the proxy may end by it
            _log.exception("delivery by %s", self.id)
            self._note_failure(InternalFault(error), client, items)
            return False
        took = time.perf_counter() - began
        delivery = self._delivery
        with self._lock:
            self.account.delivered += self._in_flight
            self._busy, self._in_flight = False, 0
            self.failures = self._repeats = 0
            self.problem = ""
            self.mean_s = 0.9 * self.mean_s + 0.1 * took if self.mean_s else took
            self.fastest_s = min(took, 1.001 * self.fastest_s or took)
            self._flood_until = time.perf_counter() + min(delivery.flood_gap * self.mean_s, delivery.max_flood_gap_s)
            if (
                self.mean_s > delivery.fast_call_s
                or client is not self.client
                or self.condition is not ProxyCondition.CONNECTED
            ):
                self._inline = 0
            else:
                self._inline = delivery.call_events if client.takes_batches else 1
            if self._queue.length:
                self._wake()
        return took < delivery.fast_call_s

    def _note_failure(self, failure: EventError, client: ConsumerPort | None, items: Sequence[QueueItem]) -> None:
        with self._lock:
            self._busy = False
            if isinstance(failure, Refused | InternalFault):  # another attempt would fail too
                self.account.discarded += self._in_flight
                self._unanswered, self._in_flight, self._repeats = (), 0, 0
                _log.info("an event was not delivered by %s (%s)", self.id, failure)
            elif isinstance(failure, Unconfirmed) or self._repeats:
                self._unanswered = items
                self._repeats += isinstance(failure, Unconfirmed)
                is_gone = client is not self.client or isinstance(failure, ClientGone) or self.is_ended
                if is_gone or not (client and client.is_idempotent and self._repeats <= self._delivery.max_repeats):
                    self._give_up_repeating()
            else:
                self._in_flight = 0
                self._requeue(items)
            if client is not None and client is self.client and not isinstance(failure, Refused):
                self.failures += 1
                self.problem = str(failure)
                if self.condition is ProxyCondition.CONNECTED:
                    self.condition, self._inline = ProxyCondition.STALLED, 0
                    self._changed.notify()  # the thread may be waiting for work
                    self._room.notify_all()  # suppliers no longer wait for it
                    _log.info("the consumer of %s at %s is stalled (%s)", self.id, client.address, failure)
            is_lost = isinstance(failure, ClientGone) or (
                self.failures >= self._delivery.max_failures and not self.name
            )
            self._wake()
        if is_lost:
            self._on_client_lost(self, str(failure))

    def _give_up_repeating(self) -> None:
        """Count the events of a call without an answer as delivered; the client may have them."""
        if self._unanswered:
            self.account.delivered += self._in_flight
            self.account.unconfirmed += self._in_flight
            self._unanswered, self._in_flight, self._repeats = (), 0, 0

    def _requeue(self, items: Sequence[QueueItem]) -> None:
        if self.is_ended:
            self.account.discarded += sum(map(len, items))
        else:
            self._queue.put_back(items)

    def _probe(self, client: ConsumerPort) -> None:
        """Probe a stalled client; resume delivery, or report the client as lost."""
        reason = ""
        try:
            is_alive = client.answers(self._delivery.probe_timeout_s)
        except ClientGone as error:
            is_alive, reason = False, str(error)
        if is_alive and not client.is_idempotent:
            time.sleep(self._delivery.settle_s)
        with self._lock:
            if client is not self.client or self.condition is not ProxyCondition.STALLED:
                return
            if is_alive:
                self.condition = ProxyCondition.CONNECTED
                return
            self.failures += 1
            if not reason and self.failures >= self._delivery.max_failures and not self.name:
                reason = f"{self.failures} failures in a row"
        if reason:
            self._on_client_lost(self, reason)
