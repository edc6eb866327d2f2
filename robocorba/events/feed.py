"""The supplying end of a link: store and forward toward the gateway of one peer.

Events that the peer has to get wait in a bounded queue, also while the link is down. They go out in
batches with positions that count up; a batch is kept until the gateway has acknowledged it. At most WINDOW of
them are on their way. Where the link is idle a supplier's own thread sends; else the feed's thread does, and
takes all that waits in one batch: under load a batch carries more, not later.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from robocorba.errors import NotDelivered, SessionOver
from robocorba.events.account import Account, Totals
from robocorba.events.event import Run, merged
from robocorba.events.queue import EventQueue, QueuePolicy
from robocorba.events.subscription import Fit

#: Events that wait for a peer; the oldest are discarded beyond.
STORE_EVENTS = 100_000
#: Batches on their way, and how many of them a supplier's thread may have sent.
WINDOW, INLINE_WINDOW = 64, 16
BATCH_EVENTS, BATCH_BYTES = 1000, 2**20
#: A session without a sign of the gateway for so long is down.
LEASE_S = 3.0
#: A batch that the gateway does not have after so long was lost.
LOST_S = 0.3
SEND_LIMIT_S, INLINE_LIMIT_S = 2.0, 0.05
#: What waits is looked at at least so often.
LOOK_S = 1.0

_log = logging.getLogger(__name__)


class GatewayPort(Protocol):
    """The peer's gateway, as a translator presents it."""

    def forward(self, session: str, position: int, runs: list[Run], limit_s: float) -> None:
        """Send without waiting for an answer. Raises NotDelivered where it surely did not get out whole."""


@dataclass(slots=True)
class _Batch:
    position: int
    runs: list[Run]
    count: int
    sent_at: float = 0.0


class FeedState(NamedTuple):
    """A feed at one moment; oldest_s: age of the oldest event that is queued."""

    is_up: bool
    problem: str
    joins: int
    oldest_s: float
    batches: int
    bytes: int
    unseen: int
    totals: Totals


class Feed:
    """Toward `peer`. State is guarded by the channel's lock."""

    def __init__(self, lock: threading.Lock, peer: str, size: int = STORE_EVENTS) -> None:
        self.peer = peer
        self.account = Account()
        self.unseen = 0
        self.is_ended = False
        self._lock = lock
        self._changed = threading.Condition(lock)
        self._queue = EventQueue(QueuePolicy(size))
        self._flight: deque[_Batch] = deque()
        self._unsent = 0
        self._in_hand = 0
        self._next = 1
        self.session = ""
        self._port: GatewayPort | None = None
        self._heard_at = 0.0
        self._problem = "not joined yet"
        self._joins = self._batches = self._bytes = 0
        self._busy = False
        self._thread: threading.Thread | None = None

    # ---- called with the lock ----

    @property
    def is_up(self) -> bool:
        return self._port is not None and not self._problem and time.monotonic() - self._heard_at < LEASE_S

    def offer(self, run: Run, fit: Fit, now: float) -> bool:
        """Take in events for the peer, unless they came from it; True where the caller has claimed them and must call
        `deliver`."""
        if run.via == self.peer:
            return False
        self.account.received += len(run)
        if (
            not self._busy
            and not self._queue
            and self._unsent == len(self._flight) < INLINE_WINDOW
            and len(run) <= BATCH_EVENTS
            and self.is_up
        ):
            self._busy, self._in_hand = True, len(run)
            return True
        self.account.discarded += self._queue.put(run)
        self._changed.notify()
        return False

    def join(self, port: GatewayPort) -> tuple[str, int]:
        """A new session with the peer's gateway; earlier ones are over. Its name, and the position of its first batch.

        What was on its way goes first once more: the gateway recognises what it has."""
        self.session, self._port = uuid.uuid4().hex, port
        # Nothing goes out before the gateway has the answer to this call, and says so by its first `renew`.
        self._heard_at, self._problem = time.monotonic(), "joining"
        self._joins += 1
        self._return_flight()
        self._next = 1
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"feed of {self.peer}", daemon=True)
            self._thread.start()
        self._changed.notify()
        return self.session, self._next

    def acknowledge(self, session: str, position: int) -> None:
        """The gateway has every batch before `position`. Raises SessionOver."""
        if session != self.session or self.is_ended:
            raise SessionOver(f"this is not the present session of {self.peer}")
        self._heard_at = time.monotonic()
        while self._flight and self._flight[0].position < position:
            self.account.delivered += self._flight.popleft().count
            self._unsent = max(0, self._unsent - 1)
        self._changed.notify()

    def renew(self, session: str, position: int) -> None:
        """The gateway is there and waits for `position`: what was lost is sent again. Raises SessionOver."""
        self.acknowledge(session, position)
        self._problem = ""
        if self._flight and self._unsent and self._flight[0].sent_at < time.monotonic() - LOST_S:
            self._unsent = 0

    def end(self) -> None:
        """The peer was removed; what is queued counts as discarded."""
        self.is_ended = True
        self._return_flight()
        self.account.discarded += self._queue.clear()
        self._port, self._problem = None, "removed"
        self._changed.notify_all()

    def state(self) -> FeedState:
        queued = len(self._queue) + self._in_hand + sum(batch.count for batch in self._flight)
        oldest = self._flight[0].runs[0].times[0] if self._flight else self._queue.oldest_time()
        problem = self._problem or ("" if self.is_up else f"nothing heard for {LEASE_S:g} s")
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

    # ---- called without it ----

    def deliver(self, run: Run) -> bool:
        """Send what was claimed. False where that took long."""
        with self._lock:
            self._in_hand = 0
            if self.is_ended:
                self._busy = False
                self.account.discarded += len(run)
                return True
            is_next = self._unsent == len(self._flight)
            batch = self._append([run])
            if not is_next:  # older ones have to be sent again first
                self._busy = False
                self._changed.notify()
                return True
            self._unsent += 1
        return self._send(batch, INLINE_LIMIT_S)

    def hand_over(self, run: Run) -> None:
        """Leave what was claimed to the feed's thread."""
        with self._lock:
            self._busy, self._in_hand = False, 0
            if self.is_ended:
                self.account.discarded += len(run)
            else:
                self.account.discarded += self._queue.put_back([run])
                self._changed.notify()

    # ---- sending ----

    def _append(self, runs: list[Run]) -> _Batch:
        batch = _Batch(self._next, runs, sum(map(len, runs)))
        self._next += 1
        self._flight.append(batch)
        return batch

    def _send(self, batch: _Batch, limit_s: float) -> bool:
        """Send one batch; the sender is busy until it has returned."""
        session, port = self.session, self._port
        began = batch.sent_at = time.monotonic()
        problem = "" if port else "not joined"
        try:
            if port:
                port.forward(session, batch.position, batch.runs, limit_s)
        except NotDelivered as error:
            problem = str(error)
        took = time.monotonic() - began
        with self._lock:
            self._busy = False
            self._batches += 1
            self._bytes += sum(run.size for run in batch.runs)
            if problem and session == self.session and not self.is_ended:
                self._problem = problem
                _log.info("the link to %s is down (%s)", self.peer, problem)
            if self._queue or self._unsent < len(self._flight):
                self._changed.notify()
        return not problem and took < 0.005

    def _run(self) -> None:
        while (batch := self._next_batch()) is not None:
            self._send(batch, SEND_LIMIT_S)

    def _next_batch(self) -> _Batch | None:
        """Wait for a batch to send, an old one first; None at the feed's end."""
        with self._lock:
            while not self.is_ended:
                if not self._busy and self.is_up:
                    if self._unsent < len(self._flight):
                        batch = self._flight[self._unsent]
                        self._unsent += 1
                        self._busy = True
                        return batch
                    if self._queue and len(self._flight) < WINDOW:
                        items, expired = self._queue.take(BATCH_EVENTS, time.time(), BATCH_BYTES)
                        self.account.expired += expired
                        runs = merged(item for item in items if isinstance(item, Run))
                        if runs:
                            self._append(runs)
                        continue
                self._changed.wait(LOOK_S)
            self._thread = None
            return None

    def _return_flight(self) -> None:
        """Put what was not acknowledged before all that waits."""
        runs = [run for batch in self._flight for run in batch.runs]
        self._flight.clear()
        self._unsent = 0
        self.account.discarded += self._queue.put_back([*runs])
