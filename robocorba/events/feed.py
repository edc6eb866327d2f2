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

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.events.account import Account, Totals
from robocorba.events.event import Encoding, Run, merged
from robocorba.events.queue import EventQueue, QueuePolicy
from robocorba.events.subscription import Fit

#: Events that wait for a peer; the oldest are discarded beyond.
STORE_EVENTS = 100_000
#: Batches on their way, and how many of them a supplier's thread may have sent.
WINDOW, INLINE_WINDOW = 64, 16
BATCH_EVENTS, BATCH_BYTES = 1000, 2**20
#: A session without a sign of the gateway for so long is down.
LEASE_S = 3.0
#: A batch that the gateway does not have so long after it was sent, and after any progress, was lost.
LOST_S = 0.3
SEND_LIMIT_S, INLINE_LIMIT_S = 2.0, 0.05
#: What waits is looked at at least so often.
LOOK_S = 1.0
#: A send that took longer leaves a supplier no time for the next one.
QUICK_S = 0.005

_log = logging.getLogger(__name__)


class GatewayPort(Protocol):
    """The peer's gateway, as a translator presents it."""

    def forward(self, session: str, position: int, runs: list[Run], limit_s: float) -> list[Run]:
        """Send without waiting for an answer; those that had to be left out, since they can't be sent at all.

        Raises NotDelivered where the batch surely did not get out whole."""


@dataclass(slots=True, eq=False)
class _Batch:
    position: int
    runs: list[Run]
    count: int
    sent_at: float = 0.0


class _Shipment(NamedTuple):
    """A batch, and where it goes in the session that it is part of."""

    session: str
    port: GatewayPort | None
    batch: _Batch


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
        #: What a supplier's thread has claimed, and neither sent nor given back yet.
        self._claimed: Run | None = None
        self._next = 1
        self.session = ""
        self._port: GatewayPort | None = None
        self._heard_at = self._progress_at = 0.0
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
        count = len(run.payloads)
        if run.via == self.peer or not count:
            return False
        self.account.received += count
        is_small = count == 1 or (count <= BATCH_EVENTS and run.size <= BATCH_BYTES)
        if (
            not self._busy
            and not self._queue.length
            and self._unsent == len(self._flight) < INLINE_WINDOW
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
        """A new session with the peer's gateway; earlier ones are over. Its name, and the position of its first batch.

        What was on its way goes first once more: the gateway recognises what it has."""
        self._take_back()
        self.session, self._port = uuid.uuid4().hex, port
        # Nothing goes out before the gateway has the answer to this call, and says so by its first `renew`.
        self._heard_at, self._problem = time.monotonic(), "joining"
        self._joins += 1
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
            self._progress_at = self._heard_at
        self._changed.notify()

    def renew(self, session: str, position: int) -> None:
        """The gateway is there and waits for `position`: what was lost is sent again. Raises SessionOver."""
        self.acknowledge(session, position)
        self._problem = ""
        if self._unsent and max(self._flight[0].sent_at, self._progress_at) < self._heard_at - LOST_S:
            self._unsent = 0

    def end(self) -> None:
        """The peer was removed; what is queued counts as discarded."""
        self.is_ended = True
        self._take_back()
        self.account.discarded += self._queue.clear()
        self._port, self._problem = None, "removed"
        self._changed.notify_all()

    def state(self) -> FeedState:
        next_one = next((run for batch in self._flight for run in batch.runs), self._claimed)
        oldest = next_one.times[0] if next_one else self._queue.oldest_time()
        queued = len(self._queue) + sum(batch.count for batch in self._flight)
        queued += len(self._claimed) if self._claimed else 0
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
            if self._claimed is not run:  # taken back: it is queued, or was discarded
                return True
            self._claimed = None
            self._append([run])
            if self._unsent < len(self._flight) - 1:  # older ones have to be sent again first
                self._busy = False
                self._changed.notify()
                return True
            shipment = self._next_shipment()
        return self._send(shipment, INLINE_LIMIT_S)

    def hand_over(self, run: Run) -> None:
        """Leave what was claimed to the feed's thread."""
        with self._lock:
            if self._claimed is run:
                self._take_back_claimed()
                self._changed.notify()

    # ---- sending ----

    def _append(self, runs: list[Run]) -> None:
        """Make a batch of them, to be sent after those before it."""
        self._flight.append(_Batch(self._next, runs, sum(map(len, runs))))
        self._next += 1

    def _next_shipment(self) -> _Shipment:
        """The oldest batch that is not sent; the caller is busy until it has sent it."""
        batch = self._flight[self._unsent]
        batch.sent_at = time.monotonic()
        self._unsent += 1
        self._busy = True
        return _Shipment(self.session, self._port, batch)

    def _send(self, shipment: _Shipment, limit_s: float) -> bool:
        """Send one batch. False where that took long, or failed."""
        session, port, batch = shipment
        began = time.monotonic()
        problem = "" if port else "not joined"
        unsendable: list[Run] = []
        try:
            if port:
                unsendable = port.forward(session, batch.position, batch.runs, limit_s)
        except NotDelivered as error:
            problem = str(error)
        except Exception:  # a fault of ours must not end the link for good
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
                if problem and batch in self._flight:
                    self._problem = problem
                    self._unsent = min(self._unsent, self._flight.index(batch))
                    _log.info("the link to %s is down (%s)", self.peer, problem)
            if self._queue.length or self._unsent < len(self._flight):
                self._changed.notify()
        return not problem and took < QUICK_S

    def _discard(self, unsendable: list[Run], batch: _Batch) -> None:
        count = sum(map(len, unsendable))
        self.account.discarded += count
        if batch in self._flight:
            batch.runs = [run for run in batch.runs if run not in unsendable]
            batch.count -= count
        else:  # the gateway was quick to acknowledge what was left of the batch
            self.account.delivered -= count
        _log.warning("%d events can't be sent to %s", count, self.peer)

    def _run(self) -> None:
        while (shipment := self._wait_for_shipment()) is not None:
            self._send(shipment, SEND_LIMIT_S)

    def _wait_for_shipment(self) -> _Shipment | None:
        """A batch that is to be sent, an old one first; None at the feed's end."""
        with self._lock:
            while not self.is_ended:
                if not self._busy and self.is_up:
                    if self._unsent < len(self._flight):
                        return self._next_shipment()
                    if self._queue.length and len(self._flight) < WINDOW:
                        items, expired = self._queue.take(BATCH_EVENTS, time.time(), BATCH_BYTES)
                        self.account.expired += expired
                        runs = merged(item for item in items if isinstance(item, Run))
                        if runs:
                            self._append(runs)
                        continue
                self._changed.wait(LOOK_S)
            return None

    def _take_back(self) -> None:
        """Put what was not acknowledged, and what is claimed, before all that waits."""
        self._take_back_claimed()
        runs = [run for batch in self._flight for run in batch.runs]
        self._flight.clear()
        self._unsent = 0
        self.account.discarded += self._queue.put_back([*runs])

    def _take_back_claimed(self) -> None:
        if self._claimed is not None:
            self.account.discarded += self._queue.put_back([self._claimed])
            self._busy, self._claimed = False, None


def _pieces(run: Run) -> list[Run]:
    """A run in parts that each fit into a batch, as far as its single events do."""
    pieces, start, size = [], 0, 0
    for index, payload in enumerate(run.payloads):
        known = len(payload) if run.header.encoding is not Encoding.NATIVE else 0
        if index > start and (index - start >= BATCH_EVENTS or size + known > BATCH_BYTES):
            pieces.append(run.part(start, index))
            start, size = index, 0
        size += known
    return [*pieces, run.part(start)]
