"""Delivery to a consumer that is called.

An event reaches it in one of two ways. Where nothing waits and the consumer is known to be quick, the
supplier's own thread makes the call. Else the event waits in the queue, and the outlet's thread, which
lives while there is work, takes it from there. Only one of them calls the client at any time.

In a flood a consumer that takes batches is left to its thread: the supplier has its answer sooner, and calls of
many events get more of them through. A plain one, which gets one event a call, would only fall behind.

A consumer that does not answer is stalled: it is asked again and again, with growing pauses, whether it is there.
When it answers, delivery goes on where it stopped. When it does not for MAX_FAILURES times, it is given up.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from robocorba.errors.events import ClientGone, EventError, NotDelivered, Refused, Unconfirmed
from robocorba.events.call_limiter import Turns
from robocorba.events.clients import Consumer
from robocorba.events.event import Run, merged
from robocorba.events.outlet import Condition, Outlet
from robocorba.events.queue import Item, QueuePolicy
from robocorba.events.subscription import Fit, Subscription

#: Longest call from a supplier's thread: what one consumer that hangs costs the others, once.
INLINE_LIMIT_S = 0.05
#: Longest call from an outlet's own thread.
CALL_LIMIT_S = 10.0
PING_LIMIT_S = 1.0
#: A consumer is quick while its calls take less than this on average.
QUICK_S = 0.002
#: An event in a flood follows the one before within so many times a call's duration, and within this.
FLOOD_GAP, LONGEST_GAP_S = 1.5, 0.0005
#: After a stall, time for the consumer to end what it had begun: the next event must not overtake it.
SETTLE_S = 0.1
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 1.0
#: An outlet's thread ends after so long without work.
IDLE_S = 5.0
#: What goes out in one call to a consumer that takes batches.
BATCH_EVENTS, BATCH_BYTES = 1000, 2**20
#: Where more than so many came during a call of the outlet's thread, it rests before the next one.
FEW, REST_S = 1, 0.001
#: Threads of outlets that call at the same time, for how long one that hangs counts, and calls that one makes in a row.
TURNS, TURN_LIMIT_S, TURN_CALLS = 4, 0.05, 16
#: How often a consumer may fail in a row. With the pauses in between, one that died is given up after 17 s.
MAX_FAILURES = 20

_turns = Turns(TURNS, TURN_LIMIT_S)
_log = logging.getLogger(__name__)


class PushOutlet(Outlet):
    """on_given_up is told, without the lock, that the client is gone or has failed too often, and why."""

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        subscription: Subscription,
        policy: QueuePolicy,
        on_given_up: Callable[[PushOutlet, str], None],
        name: str = "",
    ) -> None:
        super().__init__(lock, id, subscription, policy, name)
        self._on_given_up = on_given_up
        self._busy = False
        #: How many events a supplier's thread may deliver in one call: none before the thread has made the first one.
        self._inline = 0
        self._mean_s = self._flood_until = 0.0
        self._failed = 0
        self._thread: threading.Thread | None = None

    client: Consumer | None

    @property
    def failures(self) -> int:
        return self._failed

    def connect(self, client: Consumer) -> None:
        """Begin to deliver to it."""
        self.client, self.condition = client, Condition.CONNECTED
        self._failed, self._mean_s, self._inline = 0, 0.0, 0
        self._wake()

    def leave(self) -> None:
        """The consumer of a durable subscription went away; its events wait for the next one."""
        self.client, self.condition, self._inline = None, Condition.WAITING, 0

    def suspend(self) -> None:
        """Let events wait; also those of a stalled consumer."""
        if self.client:
            self.condition, self._inline = Condition.SUSPENDED, 0

    def end(self) -> None:
        super().end()
        self._inline = 0

    def resume(self) -> None:
        if self.condition is Condition.SUSPENDED:
            self.condition = Condition.CONNECTED
            self._wake()

    def offer(self, run: Run, fit: Fit, now: float) -> bool:
        count = len(run.payloads)
        if count > self._inline or self._busy or self._queue.length or fit.slots or self._is_flooded():
            return super().offer(run, fit, now)
        self.account.received += count
        self._busy, self._in_flight = True, count
        return True

    def _is_flooded(self) -> bool:
        """Whether events follow each other faster than calls do, to a consumer that takes batches."""
        return self._inline > 1 and time.perf_counter() < self._flood_until

    def deliver(self, run: Run) -> bool:
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

    def hand_over(self, run: Run) -> None:
        with self._lock:
            self._busy, self._in_flight = False, 0
            self._take_back([run])
            self._wake()

    def _wake(self) -> None:
        """Let the thread look for work, unless there is none, or whoever is busy will call this at its end."""
        if self._busy or self.is_ended:
            return
        is_stalled = self.condition is Condition.STALLED
        if not is_stalled and not (self.condition is Condition.CONNECTED and self._queue.length):
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"to {self.id}", daemon=True)
            self._thread.start()
        elif not is_stalled:  # else it wakes by itself when the next question is due
            self._changed.notify()

    def _run(self) -> None:
        while (task := self._next_task()) is not None:
            client, items = task
            if not items:
                self._probe(client)
                continue
            with _turns.one():
                self._call(client, items)
                for _ in range(TURN_CALLS - 1):
                    if not (items := self._next_of_turn(client)):
                        break
                    self._call(client, items)
            self._rest(client)

    def _next_task(self) -> tuple[Consumer, list[Item]] | None:
        """Whom to give what; nothing, where it has to be asked whether it is there; None at the end of work."""
        with self._lock:
            idle_until = time.monotonic() + IDLE_S
            while not self.is_ended:
                if self.condition is Condition.STALLED and self._pause() and self.client:
                    return self.client, []
                if self.condition is Condition.CONNECTED and self.client and self._queue and not self._busy:
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

    def _next_of_turn(self, client: Consumer) -> list[Item]:
        """What to deliver next in the same turn to a client that takes one event a call; nothing at its end."""
        with self._lock:
            is_over = client.takes_batches or client is not self.client or self.condition is not Condition.CONNECTED
            return [] if is_over or self._busy or not self._queue.length else self._claim_next(client)

    def _claim_next(self, client: Consumer) -> list[Item]:
        """What to deliver in one call; nothing where all that waited has expired."""
        items: list[Item] = []
        if client.takes_batches:
            items = self._take(BATCH_EVENTS, BATCH_BYTES)
            runs = [item for item in items if isinstance(item, Run)]
            if len(runs) == len(items):
                items = [*merged(runs)]
        elif run := self._take_one():
            items = [run]
        if items:
            self._busy, self._in_flight = True, sum(map(len, items))
        return items

    def _rest(self, client: Consumer) -> None:
        """Let a batch grow, where events come faster than calls are made."""
        if client.takes_batches and FEW < self._queue.length < min(BATCH_EVENTS, self.policy.size // 2):
            time.sleep(REST_S)

    def _pause(self) -> bool:
        """Wait before the next question; False where there is nothing to ask any more."""
        pause = min(FIRST_PAUSE_S * 2.0 ** min(max(self._failed - 1, 0), 10), LONGEST_PAUSE_S)
        return not self._changed.wait_for(lambda: self.is_ended or self.condition is not Condition.STALLED, pause)

    def _call(self, client: Consumer, items: list[Item]) -> None:
        """Deliver what the thread has taken."""
        began = time.perf_counter()
        try:
            client.deliver(items, CALL_LIMIT_S)
        except EventError as failure:
            self._note_failure(failure, client, items)
            return
        took = time.perf_counter() - began
        with self._lock:
            self._note_success(client, sum(map(len, items)), took)

    def _note_success(self, client: Consumer, count: int, took: float) -> None:
        self._busy, self._in_flight = False, 0
        self.account.delivered += count
        self._failed = 0
        self._mean_s = 0.9 * self._mean_s + 0.1 * took if self._mean_s else took
        self._flood_until = time.perf_counter() + min(FLOOD_GAP * self._mean_s, LONGEST_GAP_S)
        if self._mean_s > QUICK_S or client is not self.client or self.condition is not Condition.CONNECTED:
            self._inline = 0
        else:
            self._inline = BATCH_EVENTS if client.takes_batches else 1
        if self._queue.length:
            self._wake()

    def _note_failure(self, failure: EventError, client: Consumer | None, items: Sequence[Item]) -> None:
        count = sum(map(len, items))
        with self._lock:
            self._busy, self._in_flight = False, 0
            if isinstance(failure, Refused):  # it is there
                self.account.discarded += count
                _log.info("%s refused an event (%s)", self.id, failure)
            elif isinstance(failure, Unconfirmed):
                self.account.delivered += count
                self.account.unconfirmed += count
            else:
                self._take_back(items)
            if client is not None and client is self.client and not isinstance(failure, Refused):
                self._failed += 1
                if self.condition is Condition.CONNECTED:
                    self.condition, self._inline = Condition.STALLED, 0
                    self._changed.notify()  # the thread may rest after its work
                    _log.info("%s at %s does not take events (%s)", self.id, client.address, failure)
            is_given_up = isinstance(failure, ClientGone) or (self._failed >= MAX_FAILURES and not self.name)
            self._wake()
        if is_given_up:
            self._on_given_up(self, str(failure))

    def _take_back(self, items: Sequence[Item]) -> None:
        if self.is_ended:
            self.account.discarded += sum(map(len, items))
        else:
            self.account.discarded += self._queue.put_back([*items])

    def _probe(self, client: Consumer) -> None:
        """Ask a stalled client whether it is there; go on, or give it up."""
        gone = ""
        try:
            is_there = client.answers(PING_LIMIT_S)
        except ClientGone as error:
            is_there, gone = False, str(error)
        if is_there:
            time.sleep(SETTLE_S)
        with self._lock:
            if client is not self.client or self.condition is not Condition.STALLED:
                return
            if is_there:
                self.condition = Condition.CONNECTED
                return
            self._failed += 1
            if not gone and self._failed >= MAX_FAILURES and not self.name:
                gone = f"{self._failed} failures in a row"
        if gone:
            self._on_given_up(self, gone)
