"""The supplying end of a link: store and forward toward the gateway of one peer.

Events for the peer wait in a bounded queue, also while the link is down. The feed sends them in batches, numbered by
position, and keeps each batch until the gateway has acknowledged it. At most WINDOW batches are in flight. On an idle
link the supplier's own thread sends; otherwise the feed's thread sends all waiting events in one batch, so that under
load the batches grow instead of the delay.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.events.account import Account, Totals
from robocorba.events.event import Encoding, EventRun, merged
from robocorba.events.queue import EventQueue, QueuePolicy
from robocorba.events.subscription import SubscriptionMatch

#: Maximum number of events that wait for a peer; beyond that the oldest are discarded.
STORE_EVENTS = 100_000
#: Maximum number of batches in flight.
WINDOW = 64
#: A supplier's thread sends only while fewer batches than this are in flight.
INLINE_WINDOW = 16
#: Maximum size of a batch [events, bytes]; a single larger event is a batch of its own.
BATCH_EVENTS, BATCH_BYTES = 1000, 2**20
#: The link is down when the gateway has not called for this time [s].
LEASE_S = 3.0
#: A batch counts as lost when it is not acknowledged this long after it was sent and after the last progress [s].
RETRANSMIT_S = 0.3
#: Timeout of a send by the feed's thread [s].
SEND_LIMIT_S = 2.0
#: Timeout of a send by a supplier's thread [s].
INLINE_LIMIT_S = 0.05
#: Maximum interval at which the feed's thread checks for work [s].
RECHECK_S = 1.0
#: After a send slower than this, a supplier's thread leaves its other calls to their own threads [s].
QUICK_S = 0.005

_log = logging.getLogger(__name__)


class GatewayPort(Protocol):
    """The peer's gateway; the CORBA layer implements it."""

    def forward(self, session: str, position: int, runs: list[EventRun], limit_s: float) -> list[EventRun]:
        """Send a batch without waiting for an answer. Returns the runs that were left out because they cannot be sent.

        Raises NotDelivered if the batch was certainly not sent completely."""


@dataclass(slots=True, eq=False)
class _FeedBatch:
    position: int
    runs: list[EventRun]
    count: int
    sent_at: float = 0.0


class _Shipment(NamedTuple):
    """A batch, and the session and port to send it by."""

    session: str
    port: GatewayPort | None
    batch: _FeedBatch


class FeedState(NamedTuple):
    """Snapshot of a feed. oldest_s: age of the oldest queued event [s]."""

    is_up: bool
    problem: str
    joins: int
    oldest_s: float
    batches: int
    bytes: int
    unseen: int
    totals: Totals


class Feed:
    """Sends events to `peer`. Its state is guarded by the channel's lock."""

    def __init__(self, lock: threading.Lock, peer: str, size: int = STORE_EVENTS) -> None:
        self.peer = peer
        self.account = Account()
        self.unseen = 0
        self.is_ended = False
        self._lock = lock
        self._changed = threading.Condition(lock)
        self._queue = EventQueue(QueuePolicy(size))
        self._in_flight: deque[_FeedBatch] = deque()
        self._unsent = 0
        #: The run that a supplier's thread has claimed, and neither sent nor deferred yet.
        self._claimed: EventRun | None = None
        self._next = 1
        self.session = ""
        self._port: GatewayPort | None = None
        self._contact_at = self._progress_at = 0.0
        self._problem = "not joined yet"
        self._joins = self._batches = self._bytes = 0
        self._busy = False
        self._thread: threading.Thread | None = None

    # ---- called with the lock ----

    @property
    def is_up(self) -> bool:
        return self._port is not None and not self._problem and time.monotonic() - self._contact_at < LEASE_S

    def offer(self, run: EventRun, match: SubscriptionMatch, now: float) -> bool:
        """Accept events for the peer, unless the peer forwarded them. True if the caller has claimed them and must call
        `deliver` or `defer`."""
        count = len(run.payloads)
        if run.via == self.peer or not count:
            return False
        self.account.received += count
        is_small = count == 1 or (count <= BATCH_EVENTS and run.size <= BATCH_BYTES)
        if (
            not self._busy
            and not self._queue.length
            and self._unsent == len(self._in_flight) < INLINE_WINDOW
            and is_small
            and self.is_up
        ):
            self._busy, self._claimed = True, run
            return True
        for piece in (run,) if is_small else _pieces(run):
            self.account.discarded += self._queue.put(piece)
        self._changed.notify()
        return False

    def join(self, port: GatewayPort) -> tuple[str, int]:
        """Begin a session with the peer's gateway, and end the earlier one.

        Returns the name of the session and the position of its first batch.
        Batches in flight are sent again first; the gateway drops duplicates."""
        self._requeue()
        self.session, self._port = uuid.uuid4().hex, port
        # Nothing is sent before the first `renew`, which proves that the gateway has the answer to this call.
        self._contact_at, self._problem = time.monotonic(), "joining"
        self._joins += 1
        self._next = 1
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"feed of {self.peer}", daemon=True)
            self._thread.start()
        self._changed.notify()
        return self.session, self._next

    def acknowledge(self, session: str, position: int) -> None:
        """The gateway has received every batch before `position`. Raises SessionOver."""
        if session != self.session or self.is_ended:
            raise SessionOver(f"the session is not the current one of {self.peer}")
        self._contact_at = time.monotonic()
        while self._in_flight and self._in_flight[0].position < position:
            self.account.delivered += self._in_flight.popleft().count
            self._unsent = max(0, self._unsent - 1)
            self._progress_at = self._contact_at
        self._changed.notify()

    def renew(self, session: str, position: int) -> None:
        """The gateway is alive and expects `position`: retransmit lost batches. Raises SessionOver."""
        self.acknowledge(session, position)
        self._problem = ""
        if self._unsent and max(self._in_flight[0].sent_at, self._progress_at) < self._contact_at - RETRANSMIT_S:
            self._unsent = 0

    def end(self) -> None:
        """End the feed of a removed peer; queued events count as discarded."""
        self.is_ended = True
        self._requeue()
        self.account.discarded += self._queue.clear()
        self._port, self._problem = None, "removed"
        self._changed.notify_all()

    def state(self) -> FeedState:
        next_one = next((run for batch in self._in_flight for run in batch.runs), self._claimed)
        oldest = next_one.times[0] if next_one else self._queue.oldest_time()
        queued = len(self._queue) + sum(batch.count for batch in self._in_flight)
        queued += len(self._claimed) if self._claimed else 0
        problem = self._problem or ("" if self.is_up else f"the peer has not called for {LEASE_S:g} s")
        return FeedState(
            not problem,
            problem,
            self._joins,
            max(0.0, time.time() - oldest) if oldest is not None else 0.0,
            self._batches,
            self._bytes,
            self.unseen,
            self.account.totals(queued),
        )

    # ---- called without the lock ----

    def deliver(self, run: EventRun) -> bool:
        """Send a claimed run. False if the call was slow or failed."""
        with self._lock:
            if self._claimed is not run:  # requeued or discarded meanwhile
                return True
            self._claimed = None
            self._append([run])
            if self._unsent < len(self._in_flight) - 1:  # older batches must be retransmitted first
                self._busy = False
                self._changed.notify()
                return True
            shipment = self._next_shipment()
        return self._send(shipment, INLINE_LIMIT_S)

    def defer(self, run: EventRun) -> None:
        """Leave a claimed run to the feed's thread."""
        with self._lock:
            if self._claimed is run:
                self._requeue_claimed()
                self._changed.notify()

    # ---- sending ----

    def _append(self, runs: list[EventRun]) -> None:
        """Append a batch of these runs."""
        self._in_flight.append(_FeedBatch(self._next, runs, sum(map(len, runs))))
        self._next += 1

    def _next_shipment(self) -> _Shipment:
        """The oldest unsent batch; the feed is busy until the caller has sent it."""
        batch = self._in_flight[self._unsent]
        batch.sent_at = time.monotonic()
        self._unsent += 1
        self._busy = True
        return _Shipment(self.session, self._port, batch)

    def _send(self, shipment: _Shipment, limit_s: float) -> bool:
        """Send one batch. False if the call was slow or failed."""
        session, port, batch = shipment
        began = time.monotonic()
        problem = "" if port else "not joined"
        unsendable: list[EventRun] = []
        try:
            if port:
                unsendable = port.forward(session, batch.position, batch.runs, limit_s)
        except NotDelivered as error:
            problem = str(error)
        except Exception:  # a defect must not end the link permanently
            _log.exception("feed of %s", self.peer)
            problem = "internal fault, see the log"
        took = time.monotonic() - began
        with self._lock:
            self._busy = False
            if session == self.session and not self.is_ended:
                if unsendable:
                    self._discard(unsendable, batch)
                self._batches += 1
                self._bytes += sum(run.size for run in batch.runs)
                if problem and batch in self._in_flight:
                    self._problem = problem
                    self._unsent = min(self._unsent, self._in_flight.index(batch))
                    _log.info("the link to %s is down (%s)", self.peer, problem)
            if self._queue.length or self._unsent < len(self._in_flight):
                self._changed.notify()
        return not problem and took < QUICK_S

    def _discard(self, unsendable: list[EventRun], batch: _FeedBatch) -> None:
        count = sum(map(len, unsendable))
        self.account.discarded += count
        if batch in self._in_flight:
            batch.runs = [run for run in batch.runs if run not in unsendable]
            batch.count -= count
        else:  # the gateway has already acknowledged the rest of the batch
            self.account.delivered -= count
        _log.warning("discarded %d events that cannot be sent to %s", count, self.peer)

    def _run(self) -> None:
        while (shipment := self._wait_for_shipment()) is not None:
            self._send(shipment, SEND_LIMIT_S)

    def _wait_for_shipment(self) -> _Shipment | None:
        """The next batch to send, retransmissions first; None at the end of the feed."""
        with self._lock:
            while not self.is_ended:
                if not self._busy and self.is_up:
                    if self._unsent < len(self._in_flight):
                        return self._next_shipment()
                    if self._queue.length and len(self._in_flight) < WINDOW:
                        items, expired = self._queue.take(BATCH_EVENTS, time.time(), BATCH_BYTES)
                        self.account.expired += expired
                        runs = merged(item for item in items if isinstance(item, EventRun))
                        if runs:
                            self._append(runs)
                        continue
                self._changed.wait(RECHECK_S)
            return None

    def _requeue(self) -> None:
        """Put unacknowledged batches and the claimed run back at the head of the queue."""
        self._requeue_claimed()
        runs = [run for batch in self._in_flight for run in batch.runs]
        self._in_flight.clear()
        self._unsent = 0
        self.account.discarded += self._queue.put_back([*runs])

    def _requeue_claimed(self) -> None:
        if self._claimed is not None:
            self.account.discarded += self._queue.put_back([self._claimed])
            self._busy, self._claimed = False, None


def _pieces(run: EventRun) -> list[EventRun]:
    """Split a run into parts that fit into a batch; a single event that is larger is a part of its own."""
    pieces, start, size = [], 0, 0
    for index, payload in enumerate(run.payloads):
        known = len(payload) if run.header.encoding is not Encoding.NATIVE else 0
        if index > start and (index - start >= BATCH_EVENTS or size + known > BATCH_BYTES):
            pieces.append(run.part(start, index))
            start, size = index, 0
        size += known
    return [*pieces, run.part(start)]
