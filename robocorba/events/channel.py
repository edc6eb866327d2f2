"""The event channel: what comes in goes to every outlet and every peer that wants it.

One lock guards all state of a channel, its outlets and its feeds. A supplier's thread takes it once for each run of
events: numbers them, and puts them into queues or claims consumers that it can call itself. Clients
are called without the lock, so that one that hangs holds up nobody but the thread that calls it.
"""

from __future__ import annotations

import threading
import time
from typing import NamedTuple, Protocol

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.event import Header, Run
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.outlet import Outlet
from robocorba.events.subscription import Fit, Pattern, fit, patterns_of, union
from robocorba.events.watermarks import Watermarks

#: Kinds of events (type, source and origin) whose ways are remembered.
MAX_ROUTES = 4096


class Sink(Protocol):
    """Where events go: an outlet, or the feed of a peer."""

    def offer(self, run: Run, fit: Fit, now: float) -> bool:
        """Take in a run; True where the caller has claimed it and must call `deliver` with it, without the lock."""

    def deliver(self, run: Run) -> bool:
        """Deliver what was claimed, without the lock. False where that took long."""

    def hand_over(self, run: Run) -> None:
        """Give back what was claimed, without the lock: it is delivered later, by somebody else."""


class _Route(NamedTuple):
    """Where events with one header go."""

    #: Theirs, with their origin.
    header: Header
    sinks: list[tuple[Sink, Fit]]
    #: Peers that don't get them, but could.
    passed_over: list[Feed]
    #: Outlets for which suppliers wait, and how many events fit into the smallest queue of those, 0 for none.
    blocking: list[Outlet]
    blocking_size: int


_AS_IT_IS = Fit(True, ())


class Channel:
    """Channel `federation.name`. first_number: that of its next event, higher than any of it so far."""

    def __init__(self, federation: Federation, watermarks: Watermarks, first_number: int) -> None:
        self.lock = threading.Lock()
        self.federation = federation
        self.outlets: dict[str, Outlet] = {}
        self.feeds: dict[str, Feed] = {}
        self.is_destroyed = False
        self._watermarks = watermarks
        self._number = first_number - 1
        #: By header; where it has no origin, this channel is.
        self._routes: dict[Header, _Route] = {}

    @property
    def name(self) -> str:
        return self.federation.name

    @property
    def last_number(self) -> int:
        return self._number

    # ---- events ----

    def publish(self, run: Run, account: Account) -> None:
        """Take in events of a supplier of this channel, whose account is kept.

        Waits where a consumer's queue is full and its policy is to block suppliers. Raises ProxyGone."""
        now = time.time()
        if 0.0 in run.times:
            run.times = [moment or now for moment in run.times]
        count = len(run.payloads)
        with self.lock:
            if self.is_destroyed:
                raise ProxyGone(f"channel {self.name} was destroyed")
            account.received += count
            if run.header.expiry:
                alive = run.fresh(now)
                account.expired += count - (len(alive) if alive else 0)
                if alive is None:
                    return
                run, count = alive, len(alive)
            account.delivered += count
            route = self._routes.get(run.header) or self._find_route(run.header)
            if not route.blocking_size:
                run.header = route.header
                run.first = self._number + 1
                self._number += count
                claims = [sink for sink, fits in route.sinks if sink.offer(run, fits, now)]
                for feed in route.passed_over:
                    feed.unseen += count
        if route.blocking_size:
            self._publish_blocking(run, route.blocking_size)
        elif len(claims) == 1:
            claims[0].deliver(run)
        else:
            _deliver(run, claims)

    def _publish_blocking(self, run: Run, most: int) -> None:
        """Let the supplier wait for room, where it has to; in pieces that the queues can hold."""
        header = run.header
        for start in range(0, len(run), most):
            piece = run.part(start, start + most)
            with self.lock:
                for outlet in self._find_route(header).blocking:
                    if outlet.lacks_room(len(piece)):
                        outlet.wait_for_room(len(piece), outlet.policy.block_limit)
                route = self._find_route(header)  # everything may have changed meanwhile
                piece.header = route.header
                piece.first = self._number + 1
                self._number += len(piece)
                claims = self._offer(piece, route, time.time())
            _deliver(piece, claims)

    def forward(self, runs: list[Run]) -> tuple[list[tuple[Run, list[Sink]]], int]:
        """Take in events that came from a peer, in order; what is to be passed to `deliver` afterwards, and how many of
        the events had been seen already. Never waits for room: that would hold up the link."""
        result = []
        repeated = 0
        now = time.time()
        with self.lock:
            for run in runs:
                origin = run.header.origin
                seen = self._watermarks.last(origin) - run.first + 1
                if origin == self.name or seen >= len(run):
                    repeated += len(run)
                    continue
                self._watermarks.raise_to(origin, run.last)
                if seen > 0:
                    repeated += seen
                    run = run.part(seen)
                alive = run.fresh(now)
                if alive and not self.is_destroyed:
                    result.append((alive, self._offer(alive, self._find_route(alive.header), now)))
        return result, repeated

    @staticmethod
    def deliver(claimed: list[tuple[Run, list[Sink]]]) -> None:
        """Make the calls that `forward` has left to its caller, who holds no lock."""
        for run, claims in claimed:
            _deliver(run, claims)

    @staticmethod
    def _offer(run: Run, route: _Route, now: float) -> list[Sink]:
        for feed in route.passed_over:
            feed.unseen += len(run)
        return [sink for sink, fits in route.sinks if sink.offer(run, fits, now)]

    def _find_route(self, header: Header) -> _Route:
        route = self._routes.get(header)
        if route is None:
            if len(self._routes) >= MAX_ROUTES:
                self._routes.clear()
            route = self._routes[header] = self._new_route(header._replace(origin=header.origin or self.name))
        return route

    def _new_route(self, header: Header) -> _Route:
        type, source, origin = header.type, header.source, header.origin
        feeds, passed_over = [], []
        for peer, feed in self.feeds.items():
            if self.federation.is_wanted(peer, type, source, origin):
                feeds.append(feed)
            elif peer != origin:
                passed_over.append(feed)
        # Peers first: what goes to them waits for no answer, and has the longest way.
        sinks: list[tuple[Sink, Fit]] = [(feed, _AS_IT_IS) for feed in feeds]
        for outlet in self.outlets.values():
            fits = fit(outlet.subscription, type, source) if outlet.is_selecting else None
            if fits:
                sinks.append((outlet, fits))
        blocking = [outlet for outlet, _ in sinks if isinstance(outlet, Outlet) and outlet.is_blocking]
        return _Route(header, sinks, passed_over, blocking, min((o.policy.size for o in blocking), default=0))

    # ---- who wants what; called with the lock ----

    def interest(self) -> tuple[Pattern, ...]:
        """The union of what its own consumers subscribed to. Gateways never count."""
        return union(
            pattern
            for outlet in self.outlets.values()
            if outlet.is_selecting
            for pattern in patterns_of(outlet.subscription)
        )

    def changed(self) -> bool:
        """Consumers, subscriptions, peers or notices have changed: look anew where events go.

        Whether the peers have to be told."""
        self._routes.clear()
        return self.federation.tell(self.feeds, self.interest())


def _deliver(run: Run, claims: list[Sink]) -> None:
    """Call whom this thread has claimed; where one takes long, leave the others to their own threads."""
    is_quick = True
    for sink in claims:
        if is_quick:
            is_quick = sink.deliver(run)
        else:
            sink.hand_over(run)
