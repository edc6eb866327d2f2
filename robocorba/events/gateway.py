"""The consuming end of a link: the paper's gateway, a consumer of one channel that supplies another.

It runs in the process of the channel that it supplies. It joins the feed of its peer and maintains the link: it sends
new advertisements, acknowledges packets, and joins again with exponential backoff when the peer does not answer. The
link is up while the feed answers and its packets, which may be empty, arrive.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

from robocorba.errors.events import InvalidPeer, SessionOver
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account, LinkEnd
from robocorba.events.channel import Channel, Claims
from robocorba.events.event import EventBatch
from robocorba.events.federation import Advertisement, KnownAdvertisements
from robocorba.events.peer_clock import Exchange, PeerClock
from robocorba.events.policies import LinkPolicy
from robocorba.events.subscription import Pattern
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


class FeedPort(Protocol):
    """A session with the peer's feed; the CORBA layer implements it."""

    session: str
    position: int
    #: The call that began the session.
    joining: Exchange

    def renew(
        self, position: int, refused: int, advertisements: list[Advertisement]
    ) -> tuple[list[Advertisement], Exchange]:
        """Renew the session; the advertisements that are new to this side, and this call. refused: number of events
        that were received in this session and refused. Raises SessionOver, NotReachable."""

    def acknowledge(self, position: int) -> None:
        """Acknowledge all packets before `position`, without waiting for an answer. Raises nothing."""

    def leave(self) -> None:
        """Notify the peer that the link was removed. Raises nothing: the peer may be dead."""


class Gateway:
    """Supplies `channel` with the events that `peer` forwards.

    join: begins a session with the peer's feed; raises NotReachable, InvalidPeer.
    on_advertisements: called, without a lock, with the advertisements that the peer sends, and with none before each
    attempt to join it."""

    def __init__(
        self,
        peer: str,
        channel: Channel,
        join: Callable[[], FeedPort],
        on_advertisements: Callable[[list[Advertisement]], None],
        policy: LinkPolicy,
    ) -> None:
        self.peer = peer
        self._channel = channel
        self._join = join
        self._on_advertisements = on_advertisements
        self._policy = policy
        self._lock = threading.Lock()
        self._woken = threading.Event()
        self._is_ended = self._leaves = self._is_joined = False
        self._port: FeedPort | None = None
        self.session = ""
        #: Position of the next packet.
        self._expected = 1
        #: Packets that arrived before an earlier one, by position, and how many events were left out of each.
        self._early: dict[int, tuple[list[EventBatch], int]] = {}
        self._known = KnownAdvertisements()
        self._in_force: tuple[Pattern, ...] = ()
        self._acknowledged, self._acknowledged_at = 1, 0.0
        self._problem = self._logged_problem = "not joined yet"
        #: When the last packet of this session, or a later call of the peer, arrived [s, time.monotonic].
        self._arrived_at: float | None = None
        self._account = Account()
        self._joins = self._packets = self._bytes = 0
        #: Number of events that had been refused when this session began.
        self._refused_before = 0
        self._lag_s = 0.0
        #: The clock to which the epochs of the peer's batches refer.
        self._clock = PeerClock()
        self._thread = Background(f"gateway of {peer}", self._maintain_link, self._set_problem)

    def start(self) -> None:
        self._thread.start()

    def end(self, leave: bool = False) -> None:
        """Stop; `leave` notifies the peer that the link was removed."""
        with self._lock:
            self._is_ended, self._leaves = True, leave
            port = self._port
        self._woken.set()
        if leave and port:
            port.leave()

    def wake(self) -> None:
        """Join immediately: the peer is back."""
        self._woken.set()

    def send_news(self) -> None:
        """Renew soon: there are new advertisements. A gateway that has not joined sends them when it does."""
        if self._is_joined:
            self._woken.set()

    @property
    def in_force(self) -> tuple[Pattern, ...]:
        """The interest of this channel that the peer has received; empty while the link is down."""
        return self._in_force if not self.problem else ()

    @property
    def problem(self) -> str:
        """Why the link is down, empty while it is up."""
        if self._problem:
            return self._problem
        if self._arrived_at is None:
            return "joined, but nothing that it sends has arrived yet: can it connect to this channel?"
        if time.monotonic() - self._arrived_at >= self._policy.silence_s:
            return f"it answers, but nothing that it sends has arrived for {self._policy.silence_s:g} s"
        return ""

    def note_arrival(self) -> None:
        """A call of the peer to the feed has arrived: its packets take the same way."""
        if self._arrived_at is not None:
            self._arrived_at = time.monotonic()

    def forward(self, session: str, position: int, batches: list[EventBatch], invalid: int = 0) -> None:
        """Accept a packet from the peer, of which `invalid` events were left out. Early packets wait for the missing
        ones; duplicates are ignored."""
        with self._lock:
            if session != self.session or self._is_ended:
                return
            self._arrived_at = time.monotonic()
            if position >= self._expected:
                self._early.setdefault(position, (batches, invalid))
            claims: Claims = []
            while (packet := self._early.pop(self._expected, None)) is not None:
                self._expected += 1
                claims += self._accept(*packet)
            if len(self._early) > self._policy.max_early:  # the peer retransmits it
                del self._early[max(self._early)]
            position, port = self._expected, self._port
            new, now, policy = position - self._acknowledged, time.monotonic(), self._policy
            is_late = now - self._acknowledged_at > policy.acknowledge_s
            due = new > 0 and (new >= policy.acknowledge_packets or is_late)
            if due:
                self._acknowledged, self._acknowledged_at = position, now
        self._channel.deliver(claims)
        if due and port:
            port.acknowledge(position)

    def _accept(self, packet: list[EventBatch], invalid: int) -> Claims:
        account = self._account
        for batch in packet:
            if batch.epoch:
                batch.epoch -= self._clock.behind_s
        self._packets += bool(packet)
        self._bytes += sum(batch.size for batch in packet)
        refused, delivered = account.refused, account.delivered
        claims = self._channel.forward(packet, account)
        if account.refused > refused:
            reason = "they came so late that they may have come before"
            _log.warning("refused %d events from %s: %s", account.refused - refused, self.peer, reason)
        with self._channel.lock:
            account.received += invalid
            account.discarded += invalid
            account.refused += invalid
        if account.delivered > delivered:
            self._lag_s = max(0.0, time.monotonic() + packet[-1].epoch - packet[-1].times[-1])
        return claims

    def snapshot(self) -> LinkEnd:
        problem = self.problem
        with self._channel.lock:
            account = self._account.snapshot()
        with self._lock:
            round_trip_s = self._clock.round_trip_s
        counts = (self._packets, self._bytes)
        return LinkEnd(problem, self._joins, account, self.in_force, self._lag_s, *counts, round_trip_s=round_trip_s)

    # ---- link maintenance ----

    def _maintain_link(self) -> None:
        policy, failures = self._policy, 0
        while not self._is_ended:
            backoff = policy.backoff
            try:
                self._on_advertisements([])  # the link may be down
                self._channel.release_overdue()
                self._begin(self._join())
                failures = 0
                while not self._is_ended:
                    self._renew()
                    self._channel.release_overdue()
                    self._pause()
            except (SessionOver, NotReachable) as error:
                self._set_problem(str(error))
            except InvalidPeer as error:
                self._set_problem(f"refused: {error}")
                backoff = policy.refused_backoff
            except Exception:  # a defect must not end the link permanently
                _log.exception("gateway of %s", self.peer)
                self._set_problem("internal fault, see the log")
            if self._is_ended:
                return
            failures += 1
            least_s = policy.news_pause_s(len(self._channel.feeds))  # a join carries all advertisements
            if self._woken.wait(max(backoff.pause_s(failures), least_s)):
                failures = 0
            self._woken.clear()

    def _pause(self) -> None:
        """Until the next renewal. News that comes meanwhile is sent together, the later the more peers there are: each
        change would else cost a call for each of them."""
        peers, began = len(self._channel.feeds), time.monotonic()
        if self._woken.wait(self._policy.renewal_pause_s(peers)) and not self._is_ended:
            time.sleep(max(0.0, began + self._policy.news_pause_s(peers) - time.monotonic()))
        self._woken.clear()

    def _begin(self, port: FeedPort) -> None:
        with self._lock:
            self._port, self.session = port, port.session
            self._expected = self._acknowledged = port.position
            self._arrived_at = None
            self._early.clear()
            self._known = KnownAdvertisements()
            self._clock.reset()
            self._clock.measure(port.joining)
            self._refused_before = self._account.refused
            self._joins += 1
            self._is_joined = True
            is_too_late = self._leaves
        if is_too_late:
            port.leave()

    def _renew(self) -> None:
        self._log_changes()
        port = self._port
        assert port is not None
        with self._channel.lock:
            federation = self._channel.federation
            changed = self._known.missing(federation.advertisements)
            interest = federation.own.interest
        with self._lock:
            position, refused = self._expected, self._account.refused - self._refused_before
            self._acknowledged = position
        answer, exchange = port.renew(position, refused, changed)
        with self._lock:
            self._clock.measure(exchange)
        self._known.add((*changed, *answer))
        with self._channel.lock:
            if feed := self._channel.feeds.get(self.peer):
                feed.note_reached()
        self._in_force = interest
        self._problem = ""
        if not self._is_ended:  # then the channel's store may be closed
            self._on_advertisements(answer)

    def _set_problem(self, problem: str) -> None:
        self._problem, self._is_joined = problem, False
        self._log_changes()

    def _log_changes(self) -> None:
        problem = self.problem
        if problem != self._logged_problem:
            _log.info("the link from %s is %s", self.peer, f"down ({problem})" if problem else "up")
        self._logged_problem = problem
