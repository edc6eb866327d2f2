"""The event channel: passes each event on to every outlet and every peer that wants it.

One lock guards all state of a channel, its outlets and its feeds. A supplier's thread takes the lock once for each
run of events, numbers the events, and queues them or claims consumers that it can call itself. It calls clients without
the lock, so that a client that hangs blocks only the thread that calls it.
"""

from __future__ import annotations

import threading
import time
from typing import NamedTuple, Protocol

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.event import EventHeader, EventRun
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.outlet import Outlet
from robocorba.events.subscription import Pattern, SubscriptionMatch, match_subscription, patterns_of, union
from robocorba.events.watermarks import Watermarks

#: Maximum number of cached routes, one for each event header. The cache is cleared when it is full.
MAX_ROUTES = 4096


class Sink(Protocol):
    """Destination of events: an outlet, or the feed of a peer."""

    def offer(self, run: EventRun, match: SubscriptionMatch, now: float) -> bool:
        """Accept a run. True if the caller has claimed it and must call `deliver` or `defer` without the lock."""

    def deliver(self, run: EventRun) -> bool:
        """Deliver a claimed run; called without the lock. False if the call was slow or failed."""

    def defer(self, run: EventRun) -> None:
        """Return a claimed run to the sink, whose own thread delivers it later; called without the lock."""


class _Route(NamedTuple):
    """Where the channel sends events with one header."""

    #: Header of the events, with their origin.
    header: EventHeader
    sinks: list[tuple[Sink, SubscriptionMatch]]
    #: Feeds of peers that do not want the events; they count them as unseen.
    uninterested: list[Feed]
    #: Outlets whose policy blocks suppliers while their queue is full.
    blocking: list[Outlet]
    #: Size of the smallest queue among them [events], 0 if there are none.
    blocking_size: int


_UNFILTERED = SubscriptionMatch(True, ())


class Channel:
    """Channel `federation.name`. first_number: number of its next event, higher than all numbers used before."""

    def __init__(self, federation: Federation, watermarks: Watermarks, first_number: int) -> None:
        self.lock = threading.Lock()
        self.federation = federation
        self.outlets: dict[str, Outlet] = {}
        self.feeds: dict[str, Feed] = {}
        self.is_destroyed = False
        self._watermarks = watermarks
        self._number = first_number - 1
        #: By header. A header without origin belongs to a supplier of this channel.
        self._routes: dict[EventHeader, _Route] = {}

    @property
    def name(self) -> str:
        return self.federation.name

    @property
    def last_number(self) -> int:
        return self._number

    # ---- events ----

    def publish(self, run: EventRun, account: Account) -> None:
        """Publish events of a supplier of this channel, and count them in the supplier's account.

        Blocks while the queue of a consumer with policy BLOCK_SUPPLIER is full. Raises ProxyGone."""
        now = time.time()
        if 0.0 in run.times:
            run.times = [moment or now for moment in run.times]
        count = len(run.payloads)
        with self.lock:
            if self.is_destroyed:
                raise ProxyGone(f"channel {self.name} was destroyed")
            account.received += count
            if run.header.expiry:
                alive = run.unexpired(now)
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
                claims = [sink for sink, match in route.sinks if sink.offer(run, match, now)]
                for feed in route.uninterested:
                    feed.unseen += count
        if route.blocking_size:
            self._publish_blocking(run, route.blocking_size)
        elif len(claims) == 1:
            claims[0].deliver(run)
        else:
            _deliver(run, claims)

    def _publish_blocking(self, run: EventRun, max_events: int) -> None:
        """Publish pieces of at most `max_events`, each when the queues have room or their time limit has passed."""
        header = run.header
        for start in range(0, len(run), max_events):
            piece = run.part(start, start + max_events)
            with self.lock:
                for outlet in self._find_route(header).blocking:
                    if outlet.lacks_room(len(piece)):
                        outlet.wait_for_room(len(piece), outlet.policy.block_limit)
                route = self._find_route(header)  # it may have changed during the wait
                piece.header = route.header
                piece.first = self._number + 1
                self._number += len(piece)
                claims = self._offer(piece, route, time.time())
            _deliver(piece, claims)

    def forward(self, runs: list[EventRun]) -> tuple[list[tuple[EventRun, list[Sink]]], int]:
        """Accept events from a peer, in their order. Returns what the caller must pass to `deliver`, and the number of
        duplicates. Never waits for room in a queue: that would block the link."""
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
                alive = run.unexpired(now)
                if alive and not self.is_destroyed:
                    result.append((alive, self._offer(alive, self._find_route(alive.header), now)))
        return result, repeated

    @staticmethod
    def deliver(claimed: list[tuple[EventRun, list[Sink]]]) -> None:
        """Deliver the runs that `forward` claimed; called without the lock."""
        for run, claims in claimed:
            _deliver(run, claims)

    @staticmethod
    def _offer(run: EventRun, route: _Route, now: float) -> list[Sink]:
        for feed in route.uninterested:
            feed.unseen += len(run)
        return [sink for sink, match in route.sinks if sink.offer(run, match, now)]

    def _find_route(self, header: EventHeader) -> _Route:
        route = self._routes.get(header)
        if route is None:
            if len(self._routes) >= MAX_ROUTES:
                self._routes.clear()
            route = self._routes[header] = self._new_route(header._replace(origin=header.origin or self.name))
        return route

    def _new_route(self, header: EventHeader) -> _Route:
        type, source, origin = header.type, header.source, header.origin
        feeds, uninterested = [], []
        for peer, feed in self.feeds.items():
            if self.federation.is_wanted(peer, type, source, origin):
                feeds.append(feed)
            elif peer != origin:
                uninterested.append(feed)
        # Peers first: sending to them does not wait for an answer, and takes the longest to arrive.
        sinks: list[tuple[Sink, SubscriptionMatch]] = [(feed, _UNFILTERED) for feed in feeds]
        for outlet in self.outlets.values():
            match = match_subscription(outlet.subscription, type, source) if outlet.is_selecting else None
            if match:
                sinks.append((outlet, match))
        blocking = [outlet for outlet, _ in sinks if isinstance(outlet, Outlet) and outlet.is_blocking]
        return _Route(header, sinks, uninterested, blocking, min((o.policy.size for o in blocking), default=0))

    # ---- interest; called with the lock ----

    def interest(self) -> tuple[Pattern, ...]:
        """The union of the subscriptions of this channel's own consumers; peers do not count."""
        return union(
            pattern
            for outlet in self.outlets.values()
            if outlet.is_selecting
            for pattern in patterns_of(outlet.subscription)
        )

    def changed(self) -> bool:
        """Drop all cached routes: consumers, subscriptions, peers or advertisements have changed.

        Returns whether this channel's own advertisement changed, so that the peers need it."""
        self._routes.clear()
        return self.federation.advertise(self.feeds, self.interest())


def _deliver(run: EventRun, claims: list[Sink]) -> None:
    """Call the claimed sinks. After a slow call, leave the remaining ones to their own threads."""
    is_quick = True
    for sink in claims:
        if is_quick:
            is_quick = sink.deliver(run)
        else:
            sink.defer(run)
