"""The event channel: passes each event on to every proxy supplier and every peer that wants it.

One lock guards all state of a channel, its proxy suppliers and its feeds. A supplier's thread takes the lock once for
each batch of events, numbers the events, and queues them or claims consumers that it can call directly. It calls
clients without the lock, so that a client that hangs blocks only the thread that calls it.
"""

from __future__ import annotations

import threading
import time
from typing import NamedTuple, Protocol

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.arrival_clock import ArrivalClock
from robocorba.events.blocking_budget import BlockingBudget
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.event_numbers import life_of
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.interest import Interest
from robocorba.events.proxy_consumer import ORDERS
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import Pattern, SubscriptionMatch, match_subscription

#: Maximum number of cached routes, one for each event header. The cache is cleared when it is full.
MAX_ROUTES = 4096

#: Types of events that wait for nobody, besides orders, begin with this: missions would end if a consumer could hold
#: them up.
NEVER_HELD_UP = "mission."

#: Maximum time for which one call of a supplier waits for room in queues [s]. Clients with a call timeout of
#: 5 s get an answer within it; without one they would not know whether their event was received.
MAX_WAIT_S = 4.0

_UNFILTERED = SubscriptionMatch(True, ())


def is_urgent(type: str) -> bool:
    """Whether events of this type wait for no consumer."""
    return type in ORDERS or type.startswith(NEVER_HELD_UP)


class Sink(Protocol):
    """Destination of events: a proxy supplier, or the feed of a peer.

    `accept` queues a batch, or lets the calling thread claim it: that thread must deliver it, without the lock."""

    def accept(self, batch: EventBatch, match: SubscriptionMatch, now: float) -> bool:
        """Accept a batch at `now` [s, time.monotonic]; called with the lock. True if the caller has claimed it and must
        `deliver` or `defer` it."""

    def deliver(self, batch: EventBatch) -> bool:
        """Deliver a claimed batch; called without the lock. False if the call was slow or failed."""

    def defer(self, batch: EventBatch) -> None:
        """Return a claimed batch to the queue of the sink, whose own thread delivers it; called without the lock."""


#: A batch, and the sinks for which the calling thread has claimed it.
Claims = tuple[EventBatch, list[Sink]]


class Forwarded(NamedTuple):
    """What became of forwarded events. claims: the caller must pass them to `deliver`. duplicates: number of those that
    came before. refused: number of those of which the channel cannot tell whether they did."""

    claims: list[Claims]
    duplicates: int
    refused: int


class _Route(NamedTuple):
    """Where the channel sends events with one header."""

    #: Header of the events, with their origin.
    header: EventHeader
    sinks: list[tuple[Sink, SubscriptionMatch]]
    #: The feeds among them.
    feeds: list[Feed]
    #: Feeds of peers that do not want the events; they count them as unseen.
    uninterested: list[Feed]
    #: Proxies whose policy blocks suppliers while their queue is full.
    blocking: list[ProxySupplier]
    #: Size of the smallest queue among them [events], 0 if there are none.
    blocking_size: int

    def accept(self, batch: EventBatch, now: float) -> list[Sink]:
        """Pass a batch to all sinks; returns those for which it is claimed."""
        for feed in self.uninterested:
            feed.unseen += len(batch)
        return [sink for sink, match in self.sinks if sink.accept(batch, match, now)]


class Channel:
    """Channel `federation.name`. first_number: number of its next event, the first one of a life. clock: by which its
    suppliers stamp their events."""

    def __init__(
        self, federation: Federation, seen: SeenEvents, first_number: int, clock: ArrivalClock | None = None
    ) -> None:
        self.lock = threading.Lock()
        self.federation = federation
        self.proxy_suppliers: dict[str, ProxySupplier] = {}
        self.feeds: dict[str, Feed] = {}
        self.is_destroyed = False
        self._interest = Interest()
        self._seen = seen
        self._blocking_budget = BlockingBudget()
        self._number = first_number - 1
        self._clock = clock or ArrivalClock()
        #: Of the federation, when the routes were updated.
        self._topology = federation.topology
        #: By header. A header without origin belongs to a supplier of this channel.
        self._routes: dict[EventHeader, _Route] = {}

    @property
    def name(self) -> str:
        return self.federation.name

    @property
    def last_number(self) -> int:
        return self._number

    # ---- events ----

    def publish(self, batch: EventBatch, account: Account) -> None:
        """Publish events of a supplier of this channel, and count them in the supplier's account.

        Blocks while the queue of a consumer with policy BLOCK_SUPPLIER is full, see BlockingBudget; events of missions
        and emergency stops never wait. Raises ProxyGone."""
        now = self._clock.now()
        if 0.0 in batch.times:
            batch.times = [moment or now for moment in batch.times]
        count = len(batch.payloads)
        with self.lock:
            if self.is_destroyed:
                raise ProxyGone(f"channel {self.name} was destroyed")
            account.received += count
            batch.epoch = epoch = self._clock.epoch()
            if batch.header.expiry:
                alive = batch.unexpired(now - epoch)
                account.expired += count - (len(alive) if alive else 0)
                if alive is None:
                    return
                batch, count = alive, len(alive)
            account.delivered += count
            route = self._routes.get(batch.header) or self._find_route(batch.header)
            is_to_wait = route.blocking_size and not is_urgent(batch.header.type)
            if not is_to_wait:
                batch.header = route.header
                batch.first = self._number + 1
                self._number += count
                for feed in route.uninterested:  # as in `_Route.accept`, without the call
                    feed.unseen += count
                claims = [sink for sink, match in route.sinks if sink.accept(batch, match, now - epoch)]
        if is_to_wait:
            self._publish_blocking(batch, route.blocking_size)
        elif len(claims) == 1:
            claims[0].deliver(batch)
        else:
            _deliver(batch, claims)

    def _publish_blocking(self, batch: EventBatch, max_events: int) -> None:
        """Publish pieces of at most `max_events`, each when the queues have room or their time limit has passed.

        The waits of all pieces for all queues together last at most MAX_WAIT_S."""
        header = batch.header
        deadline = time.monotonic() + MAX_WAIT_S
        for start in range(0, len(batch), max_events):
            piece = batch.part(start, start + max_events)
            with self.lock:
                for proxy in self._find_route(header).blocking:
                    proxy.wait_for_room(len(piece), deadline - time.monotonic(), self._blocking_budget)
                route = self._find_route(header)  # it may have changed during the wait
                piece.header = route.header
                piece.first = self._number + 1
                self._number += len(piece)
                claims = route.accept(piece, time.monotonic())
            _deliver(piece, claims)

    def has_had(self, origin: str, number: int) -> bool:
        """Whether this channel has published or forwarded the event with this number of this origin; one of an earlier
        life of this channel counts as published."""
        if origin != self.name:
            return self._seen.has_seen(origin, number)
        return number <= self._number or life_of(number) != life_of(self._number)

    def forward(self, batches: list[EventBatch]) -> Forwarded:
        """Accept events from a peer, in their order. Never waits for room in a queue: that would block the link.

        A batch without an epoch was stamped by a clock that agrees with this system's."""
        result = []
        duplicates = refused = 0
        with self.lock:
            now, epoch = time.monotonic(), self._clock.epoch()
            for batch in batches:
                origin = batch.header.origin
                if origin == self.name:
                    if life_of(batch.first) == life_of(self._number):
                        duplicates += len(batch)
                    else:
                        refused += len(batch)
                    continue
                batch.epoch = batch.epoch or epoch
                parts, late = self._seen.add(origin, batch.first, batch.last)
                refused += late
                duplicates += len(batch) - late
                for first, last in parts:
                    duplicates -= last - first + 1
                    is_whole = last - first + 1 == len(batch)
                    part = batch if is_whole else batch.part(first - batch.first, last - batch.first + 1)
                    alive = part.unexpired(now)
                    if alive and not self.is_destroyed:
                        result.append((alive, self._find_route(alive.header).accept(alive, now)))
        return Forwarded(result, duplicates, refused)

    @staticmethod
    def deliver(claimed: list[Claims]) -> None:
        """Deliver the batches that `forward` claimed; called without the lock."""
        for batch, claims in claimed:
            _deliver(batch, claims)

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
        blocking = []
        for proxy in self.proxy_suppliers.values():
            match = match_subscription(proxy.subscription, type, source) if proxy.is_selecting else None
            if match:
                sinks.append((proxy, match))
                if proxy.is_blocking:
                    blocking.append(proxy)
        return _Route(
            header, sinks, feeds, uninterested, blocking, min((proxy.policy.size for proxy in blocking), default=0)
        )

    # ---- subscriptions; called with the lock ----

    def interest(self) -> tuple[Pattern, ...]:
        """The union of the subscriptions of this channel's own consumers; peers do not count."""
        return self._interest.patterns()

    def update_routes(self, changed: ProxySupplier | None = None) -> bool:
        """Drop all cached routes: consumers, subscriptions, peers or advertisements have changed. changed: the only
        proxy that may have come, changed or gone; all by default.

        Returns whether this channel's own advertisement changed, so that the peers need it."""
        former, self._routes = self._routes, {}
        if changed is None:
            self._interest = Interest()
        for proxy in [changed] if changed else self.proxy_suppliers.values():
            self._interest.set(proxy.id, proxy.subscription if proxy.is_selecting else ())
        is_new = self.federation.advertise(self.feeds, self.interest())
        if self.federation.topology != self._topology:
            self._topology = self.federation.topology
            self._take_over(former)
        return is_new

    def _take_over(self, former: dict[EventHeader, _Route]) -> None:
        """Send what waits for peers to those, too, that are on a shortest path only now: the others will not forward it
        any more. former: the routes before."""
        held = {feed: {_key(batch): batch for batch in feed.waiting()} for feed in self.feeds.values()}
        waiting = {key: batch for batches in held.values() for key, batch in batches.items()}
        for key in sorted(waiting):
            batch = waiting[key]
            header = batch.header._replace(origin="") if batch.header.origin == self.name else batch.header
            known = former.get(header)
            for feed in self._find_route(header).feeds:
                if key not in held[feed] and not (known and feed in known.feeds):
                    feed.take_over(batch)


def _key(batch: EventBatch) -> tuple[str, int, int]:
    """What tells a batch from others, and orders those of an origin."""
    return batch.header.origin, batch.first, batch.last


def _deliver(batch: EventBatch, claims: list[Sink]) -> None:
    """Call the claimed sinks. After a slow call, leave the remaining ones to their own threads."""
    is_quick = True
    for sink in claims:
        if is_quick:
            is_quick = sink.deliver(batch)
        else:
            sink.defer(batch)
