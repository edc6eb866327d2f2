"""The supplying end of a link: stores events, and forwards them to the gateway of one peer.

Events for the peer wait in a bounded queue, also while the link is down. The feed sends them in packets, numbered by
position, and keeps each packet until the gateway has acknowledged it; few packets are in flight. On an idle link the
supplier's own thread sends; otherwise the feed's thread sends all waiting events in one packet, so that under
load the packets grow instead of the delay. When another way becomes the shorter one, also because the link is down, the
channel moves what waits there.

The two directions of a link are connections of their own, and either may fail alone, such as at a firewall. So calls of
the gateway do not show that events get there: the link is up only while the gateway acknowledges what is sent to it. A
session begins with an empty packet. Later the calls of the gateway at this end, which renew its own session with the
peer, show that the peer can be called; when none of them is answered, the feed sends another empty packet.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.events.account import Account, LinkEnd
from robocorba.events.event import EventBatch, merged
from robocorba.events.policies import LinkPolicy
from robocorba.events.queue import EventQueue, QueueItem, QueuePolicy
from robocorba.events.subscription import Pattern
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


#: Sends a packet, by session and position, to the peer's gateway, without waiting for an answer, within a limit [s].
#: Returns the batches that cannot be sent, and were left out. Raises NotDelivered if the packet was certainly not sent
#: completely.
Forward = Callable[[str, int, list[EventBatch], float], list[EventBatch]]


class _FeedQueue(EventQueue):
    """What waits for a peer. The number before a batch (see `EventBatch.targets`) never names events that were lost
    here: their channels would wait for them."""

    def __init__(self, policy: QueuePolicy, account: Account) -> None:
        super().__init__(policy, account)
        #: By origin, target and number of the last one of lost events: the number before the first one of them.
        self._gaps: dict[tuple[str, str, int], int] = {}

    def note_loss(self, item: QueueItem, kept: QueueItem | None) -> None:
        assert isinstance(item, EventBatch)
        if not isinstance(kept, EventBatch):
            self.close_gaps(item)
            for target, before in (item.targets or {}).items():
                self._gaps[item.header.origin, target, item.last] = before
        else:
            kept.targets = item.targets  # the first ones may be lost
            if kept.last != item.last:
                for target in item.targets or ():
                    self._gaps[item.header.origin, target, item.last] = kept.last
        if len(self._gaps) > self.policy.size:
            self._gaps.clear()

    def close_gaps(self, batch: EventBatch) -> None:
        """Correct the numbers before a batch that leaves the queue."""
        if self._gaps and batch.targets:
            origin = batch.header.origin
            for target, number in list(batch.targets.items()):
                while (before := self._gaps.pop((origin, target, number), None)) is not None:
                    batch.targets[target] = number = before


@dataclass(slots=True, eq=False)
class _Packet:
    """count: number of its events. first_sent_at, sent_at: times of the first and the last transmission
    [s, time.monotonic]."""

    position: int
    batches: list[EventBatch]
    count: int
    first_sent_at: float = 0.0
    sent_at: float = 0.0


class Feed:
    """Sends events to `peer`; a sink of the channel. Its state is guarded by the channel's lock."""

    def __init__(self, lock: threading.Lock, peer: str, policy: LinkPolicy) -> None:
        self.peer = peer
        self.account = Account()
        #: Number of events that the peer did not want; the channel counts them.
        self.unseen = 0
        self.is_ended = False
        self._lock = lock
        self._changed = threading.Condition(lock)
        self._policy = policy
        self._queue = _FeedQueue(QueuePolicy(policy.max_queued), self.account)
        #: Packets in the order of their positions; the first `_sent` of them are in flight.
        self._unacknowledged: deque[_Packet] = deque()
        self._sent = 0
        #: The batch that a supplier's thread has claimed, and neither sent nor deferred yet.
        self._claimed: EventBatch | None = None
        self._next_position = 1
        self.session = ""
        self._forward: Forward | None = None
        #: Last call of the gateway, and last acknowledgement of a packet [s, time.monotonic].
        self._contact_at = self._progress_at = 0.0
        #: Last transmission or answered call to the peer, and last transmission that failed in this session
        #: [s, time.monotonic].
        self._reached_at = self._failed_at = 0.0
        #: Whether packets may be sent: from each renewal until a transmission fails.
        self._is_ready = False
        #: Why events do not get there. Only the acknowledgement of a packet that was sent later disproves it.
        self._problem = "not joined yet"
        #: Why nothing may be sent although the peer answers.
        self.conflict = ""
        self._joins = self._packets = self._bytes = 0
        #: Number of events that the gateway has refused in this session, as it has reported.
        self._refused = 0
        self._busy = False
        self._thread: Background | None = None

    # ---- called with the lock ----

    @property
    def is_up(self) -> bool:
        return not self.problem

    @property
    def problem(self) -> str:
        """Why the link is down, empty while it is up: while the gateway calls and acknowledges what is sent to it."""
        if self._problem or self.conflict:
            return self._problem or self.conflict
        now, policy = time.monotonic(), self._policy
        if now - self._contact_at >= policy.lease_s:
            return f"the peer has not called for {policy.lease_s:g} s"
        if self._sent and now - max(self._unacknowledged[0].first_sent_at, self._progress_at) >= policy.silence_s:
            return f"the peer calls, but has acknowledged nothing for {policy.silence_s:g} s: nothing arrives there"
        return ""

    @property
    def is_in_contact(self) -> bool:
        """Whether the gateway of the current session calls, and no send has failed since its last call. Only then are
        packets sent; whether they arrive is another matter."""
        return self._is_ready and time.monotonic() - self._contact_at < self._policy.lease_s

    def accept(self, batch: EventBatch) -> bool:
        """Queue events for the peer, or let the caller claim them: see channel.Claims."""
        count, policy = len(batch.payloads), self._policy
        if not count:
            return False
        is_small = count == 1 or (count <= policy.packet_events and batch.size <= policy.packet_bytes)
        if (
            not self._busy
            and not self._queue.length
            and self._sent == len(self._unacknowledged) < policy.inline_window
            and is_small
            and self.is_up
        ):
            self.account.received += count
            self._busy, self._claimed = True, batch
            return True
        self.store(batch, is_small)
        return False

    def withdraw(self, next_peers: Mapping[str, str]) -> list[EventBatch]:
        """Give up the events for channels that are reached by another peer now, and return them.

        next_peers: by channel. While the link is up, what is in flight stays. While it is down nobody knows whether it
        has arrived: it is sent again, but for those channels only that are reached by this peer, or for none."""
        moved: list[EventBatch] = []
        if not self.is_up:
            for packet in self._unacknowledged:
                packet.batches = [self._split(batch, next_peers, moved) or batch.toward({}) for batch in packet.batches]
        items = [item for item in self._queue.items() if isinstance(item, EventBatch)]
        targets = {target for batch in items for target in batch.targets or ()}
        if any(next_peers.get(target, self.peer) != self.peer for target in targets):
            before = self._queue.length
            self._queue.clear()
            for batch in items:
                self._queue.close_gaps(batch)
                if kept := self._split(batch, next_peers, moved):
                    self._queue.put(kept)
            self.account.received -= before - self._queue.length
        return moved

    def _split(self, batch: EventBatch, next_peers: Mapping[str, str], moved: list[EventBatch]) -> EventBatch | None:
        """What stays of a batch; the rest is appended to `moved`."""
        targets = batch.targets or {}
        kept = {target: before for target, before in targets.items() if next_peers.get(target, self.peer) == self.peer}
        if len(kept) == len(targets):
            return batch
        moved.append(batch.toward({target: targets[target] for target in targets.keys() - kept}) if kept else batch)
        return batch.toward(kept) if kept else None

    def store(self, batch: EventBatch, is_small: bool = False) -> None:
        """Queue events for the peer. is_small: they fit into a packet."""
        self.account.received += len(batch.payloads)
        for piece in (batch,) if is_small else self._pieces(batch):
            self._queue.put(piece)
        self._changed.notify()

    def join(self, forward: Forward) -> tuple[str, int]:
        """Begin a session with the peer's gateway, and end the earlier one.

        Returns the name of the session and the position of its first packet.
        Packets in flight are sent again first; the gateway drops duplicates."""
        self._requeue_claimed()
        self.session, self._forward = uuid.uuid4().hex, forward
        # Nothing is sent before the first `renew`, which proves that the gateway has the answer to this call.
        self._contact_at, self._failed_at, self._is_ready = time.monotonic(), 0.0, False
        self._problem = "the peer has joined, and has not acknowledged the first packet yet"
        self._joins += 1
        self._next_position = 1
        self._refused = 0
        in_flight, self._unacknowledged, self._sent = self._unacknowledged, deque(), 0
        self._append([])
        for packet in in_flight:
            if packet.batches:
                self._append(packet.batches)
        if self._thread is None:
            self._thread = Background(f"feed of {self.peer}", self._run, self._thread_failed)
            self._thread.start()
        self._changed.notify()
        return self.session, 1

    def acknowledge(self, session: str, position: int) -> None:
        """The gateway has received every packet before `position`. Raises SessionOver."""
        if session != self.session or self.is_ended:
            raise SessionOver(f"the session is not the current one of {self.peer}")
        self._contact_at = time.monotonic()
        while self._unacknowledged and self._unacknowledged[0].position < position:
            packet = self._unacknowledged.popleft()
            self.account.delivered += packet.count
            self._packets += packet.count > 0
            self._bytes += sum(batch.size for batch in packet.batches)
            self._sent = max(0, self._sent - 1)
            self._progress_at = self._contact_at
            if packet.sent_at > self._failed_at and self._problem:
                _log.info("the link to %s is up", self.peer)
                self._problem = ""
        self._wake()

    def renew(self, session: str, position: int, refused: int) -> None:
        """The gateway is alive and expects `position`: retransmit lost packets. refused: number of events of this
        session that it has received and refused so far. Raises SessionOver."""
        self.acknowledge(session, position)
        self._is_ready = True
        if refused > self._refused:
            _log.warning("%s has refused %d events", self.peer, refused - self._refused)
            self.account.delivered -= refused - self._refused
            self.account.discarded += refused - self._refused
            self._refused = refused
        overdue = self._contact_at - self._policy.retransmit_s
        if self._sent and max(self._unacknowledged[0].sent_at, self._progress_at) < overdue:
            self._sent = 0
        self._wake()

    def note_reached(self) -> None:
        """The peer has answered a call of this channel."""
        self._reached_at = time.monotonic()

    def _wake(self) -> None:
        if self._queue.length or self._sent < len(self._unacknowledged):
            self._changed.notify()

    def set_conflict(self, reason: str) -> None:
        """Hold the events back while there is a reason, and send them when there is none."""
        if reason != self.conflict:
            if reason:
                _log.warning("the link to %s is down (%s)", self.peer, reason)
            self.conflict = reason
            self._changed.notify()

    def end(self, next_peers: Mapping[str, str] | None = None) -> list[EventBatch]:
        """End the feed of a removed peer. Returns what waits for channels that are reached by another peer, see
        `withdraw`; the rest counts as discarded."""
        self.is_ended = True
        self._requeue_claimed()
        in_flight = [batch for packet in self._unacknowledged for batch in packet.batches]
        self._unacknowledged.clear()
        self._sent = 0
        self._queue.put_back(in_flight)
        self._forward, self._is_ready, self._problem = None, False, "removed"
        moved = self.withdraw(next_peers or {})
        self._queue.discard_all()
        self._changed.notify_all()
        return moved

    def snapshot(self, interest: tuple[Pattern, ...] = ()) -> LinkEnd:
        """interest: that of the peer."""
        first = next((batch for packet in self._unacknowledged for batch in packet.batches), self._claimed)
        oldest = first.since if first else self._queue.oldest_time()
        oldest_s = max(0.0, time.monotonic() - oldest) if oldest is not None else 0.0
        queued = self._queue.length + sum(packet.count for packet in self._unacknowledged) + len(self._claimed or ())
        account = self.account.snapshot(queued)
        return LinkEnd(self.problem, self._joins, account, interest, oldest_s, self._packets, self._bytes, self.unseen)

    # ---- called without the lock ----

    def deliver(self, batch: EventBatch) -> bool:
        """Send a claimed batch. False if the call was slow or failed."""
        with self._lock:
            if self._claimed is not batch:  # requeued or discarded meanwhile
                return True
            self._claimed = None
            self._queue.close_gaps(batch)
            self._append([batch])
            if self._sent < len(self._unacknowledged) - 1:  # older packets must be retransmitted first
                self._busy = False
                self._changed.notify()
                return True
            session, forward, packet = self._next_transmission()
        return self._send(session, forward, packet, is_inline=True)

    def defer(self, batch: EventBatch) -> None:
        """Leave a claimed batch to the feed's thread."""
        with self._lock:
            if self._claimed is batch:
                self._requeue_claimed()
                self._changed.notify()

    # ---- sending ----

    def _append(self, batches: list[EventBatch]) -> None:
        """Append a packet of these batches."""
        self._unacknowledged.append(_Packet(self._next_position, batches, sum(map(len, batches))))
        self._next_position += 1

    def _next_transmission(self) -> tuple[str, Forward | None, _Packet]:
        """The oldest unsent packet, with the session and the port to send it by; the feed is busy until the caller has
        sent it."""
        packet = self._unacknowledged[self._sent]
        packet.sent_at = self._reached_at = time.monotonic()
        packet.first_sent_at = packet.first_sent_at or packet.sent_at
        self._sent += 1
        self._busy = True
        return self.session, self._forward, packet

    def _send(self, session: str, forward: Forward | None, packet: _Packet, is_inline: bool) -> bool:
        """Send one packet. False if the call was slow or failed.

        is_inline: a supplier's thread sends. If it fails, the feed's thread tries again with more time: on a busy
        machine a thread may wait for a processor until its limit. If that fails, the link is down, and the packet is
        sent again when the gateway calls."""
        began = time.monotonic()
        problem = "" if forward else "not joined"
        unsendable: list[EventBatch] = []
        try:
            if forward:
                limit_s = self._policy.inline_timeout_s if is_inline else self._policy.send_timeout_s
                unsendable = forward(session, packet.position, packet.batches, limit_s)
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
                    self._discard(unsendable, packet)
                if problem and packet in self._unacknowledged:
                    self._sent = min(self._sent, self._unacknowledged.index(packet))
                    if is_inline:
                        _log.info("a packet to %s is sent again (%s)", self.peer, problem)
                    else:
                        if problem != self._problem:
                            _log.info("the link to %s is down (%s)", self.peer, problem)
                        self._problem, self._failed_at, self._is_ready = problem, time.monotonic(), False
            self._wake()
        return not problem and took < self._policy.fast_send_s

    def _discard(self, unsendable: list[EventBatch], packet: _Packet) -> None:
        count = sum(map(len, unsendable))
        self.account.discarded += count
        for batch in unsendable:
            self._queue.note_loss(batch, None)
        if packet in self._unacknowledged:
            lost = {(batch.header, batch.first) for batch in unsendable}
            packet.batches = [batch for batch in packet.batches if (batch.header, batch.first) not in lost]
            packet.count -= count
        else:  # the gateway has already acknowledged the rest of the packet
            self.account.delivered -= count
        _log.warning("discarded %d events that cannot be sent to %s", count, self.peer)

    def _run(self) -> None:
        while (transmission := self._wait_for_transmission()) is not None:
            self._send(*transmission, is_inline=False)

    def _thread_failed(self, reason: str) -> None:
        """The feed's thread has ended, and the session with it: the next join starts another."""
        with self._lock:
            self._thread, self._busy, self._is_ready = None, False, False
            self._problem, self._failed_at = reason, time.monotonic()
            self.session = uuid.uuid4().hex

    def _wait_for_transmission(self) -> tuple[str, Forward | None, _Packet] | None:
        """The next packet to send, retransmissions first; None at the end of the feed."""
        with self._lock:
            while not self.is_ended:
                if not self._busy and self.is_in_contact:
                    if self._sent < len(self._unacknowledged):
                        return self._next_transmission()
                    if self._queue.length and not self.conflict and len(self._unacknowledged) < self._policy.window:
                        self._pack()
                        continue
                    if not self._unacknowledged:
                        left_s = self._reached_at + self._policy.probe_interval_s - time.monotonic()
                        if left_s > 0.0:
                            self._changed.wait(min(left_s, self._policy.recheck_s))
                        else:
                            self._append([])
                        continue
                self._changed.wait(self._policy.recheck_s)
            return None

    def _pack(self) -> None:
        """Take the next packet from the queue."""
        items = self._queue.take(self._policy.packet_events, time.monotonic(), self._policy.packet_bytes)
        batches = [item for item in items if isinstance(item, EventBatch)]
        for batch in batches:
            self._queue.close_gaps(batch)
        if batches:
            self._append(merged(batches))

    def _requeue_claimed(self) -> None:
        if self._claimed is not None:
            self._queue.put_back([self._claimed])
            self._busy, self._claimed = False, None

    def _pieces(self, batch: EventBatch) -> list[EventBatch]:
        """Split a batch into parts that fit into a packet; a single event that is larger is a part of its own."""
        policy, pieces, start, size = self._policy, [], 0, 0
        for index, payload in enumerate(batch.payloads):
            is_full = index - start >= policy.packet_events or size + len(payload) > policy.packet_bytes
            if index > start and is_full:
                pieces.append(batch.part(start, index))
                start, size = index, 0
            size += len(payload)
        return [*pieces, batch.part(start)]
