"""The event channel: passes each event on to every proxy supplier and every peer that wants it.

One lock guards all state of a channel, its proxy suppliers and its feeds. A supplier's thread takes the lock once for
each batch of events, numbers the events, and queues them or claims consumers that it can call directly. It calls
clients without the lock, so that a client that hangs blocks only the thread that calls it.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Iterable
from typing import NamedTuple

from robocorba.errors.events import ProxyGone
from robocorba.events.account import Account
from robocorba.events.arrival_clock import ArrivalClock
from robocorba.events.blocking_budget import BlockingBudget
from robocorba.events.event import EventBatch, EventHeader, merged
from robocorba.events.event_numbers import life_of
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.policies import ChannelPolicy
from robocorba.events.proxy_consumer import ORDERS
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.resequencer import Arrival, Resequencer
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import Interest, Pattern, SubscriptionMatch, match_subscription
from robocorba.events.traffic import OriginTraffic, TrafficCounter

_DEFAULTS = ChannelPolicy()
_log = logging.getLogger(__name__)


def is_urgent(type: str) -> bool:
    """Whether events of this type wait for no consumer: missions would end if one could hold their events up."""
    return type in ORDERS or type.startswith("mission.")


#: Claimed batches. `accept` of a proxy supplier or a feed queues a batch, or lets the calling thread claim it: then it
#: returns True, and that thread must `deliver` or `defer` the batch, without the lock.
Claims = list[tuple[ProxySupplier | Feed, EventBatch]]


class _Route(NamedTuple):
    """Where the channel sends events with one header."""

    #: Header of the events, with their origin.
    header: EventHeader
    traffic: OriginTraffic
    proxies: list[tuple[ProxySupplier, SubscriptionMatch]]
    #: The other channels that want the events, by the feed of the peer that is next on the way to them.
    ways: list[tuple[Feed, list[str]]]
    #: Feeds of peers that no channel needs for it; they count the events as unseen.
    uninterested: list[Feed]
    #: Proxies whose policy blocks suppliers while their queue is full.
    blocking: list[ProxySupplier]
    #: Size of the smallest queue among them [events], 0 if there are none.
    blocking_size: int

    def supply(self, batch: EventBatch, now: float, claims: Claims) -> None:
        """Pass a batch to the consumers of this channel; called with the lock."""
        claims += [(proxy, batch) for proxy, match in self.proxies if proxy.accept(batch, match, now)]
        self.traffic.events += len(batch)
        self.traffic.deliveries += len(batch) * len(self.proxies)
        for feed in self.uninterested:
            feed.unseen += len(batch)


class Channel:
    """Channel `federation.name`. first_number: number of its next event, the first one of a life. clock: by which its
    suppliers stamp their events."""

    def __init__(
        self,
        federation: Federation,
        seen: SeenEvents,
        first_number: int,
        clock: ArrivalClock | None = None,
        policy: ChannelPolicy = _DEFAULTS,
    ) -> None:
        self.lock = threading.Lock()
        self.federation = federation
        self.proxy_suppliers: dict[str, ProxySupplier] = {}
        self.feeds: dict[str, Feed] = {}
        self.is_destroyed = False
        self.traffic = TrafficCounter()
        self._interest = Interest()
        self._seen, self._policy = seen, policy
        self._blocking_budget = BlockingBudget()
        self._number = first_number - 1
        self._clock = clock or ArrivalClock()
        #: Events of peers that came before an earlier one.
        self._resequencer = Resequencer(seen.has_seen, policy)
        #: Number of the last event that was sent to each channel.
        self._last_for: dict[str, int] = {}
        #: Of the federation, when the routes were updated.
        self._next_peers = federation.next_peers
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
        began, now = time.perf_counter(), self._clock.now()
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
                claims = self._send(batch, route, now - epoch)
                self.traffic.note_service(time.perf_counter() - began)
        if is_to_wait:
            self._publish_blocking(batch, route.blocking_size)
        else:
            self.deliver(claims)

    def _publish_blocking(self, batch: EventBatch, max_events: int) -> None:
        """Publish pieces of at most `max_events`, each when the queues have room or their time limit has passed.

        The waits of all pieces for all queues together last at most `max_blocked_s`."""
        header = batch.header
        deadline = time.monotonic() + self._policy.max_blocked_s
        for start in range(0, len(batch), max_events):
            piece = batch.part(start, start + max_events)
            with self.lock:
                for proxy in self._find_route(header).blocking:
                    proxy.wait_for_room(len(piece), deadline - time.monotonic(), self._blocking_budget)
                route = self._find_route(header)  # it may have changed during the wait
                claims = self._send(piece, route, time.monotonic())
            self.deliver(claims)

    def _send(self, batch: EventBatch, route: _Route, now: float) -> Claims:
        """Number a batch and pass it to the peers and the consumers; called with the lock."""
        batch.header, batch.first = route.header, self._number + 1
        self._number += len(batch.payloads)
        claims: Claims = []
        # Peers first: sending to them does not wait for an answer, and takes the longest to arrive.
        for feed, names in route.ways:
            targets = {name: self._last_for.get(name, 0) for name in names}
            for name in names:
                self._last_for[name] = self._number
            copy = batch.toward(targets) if batch.targets else batch
            copy.targets = targets
            if feed.accept(copy):
                claims.append((feed, copy))
        route.supply(batch, now, claims)
        return claims

    def has_had(self, origin: str, number: int) -> bool:
        """Whether this channel has published or forwarded the event with this number of this origin; one of an earlier
        life of this channel counts as published."""
        if origin != self.name:
            return self._seen.has_seen(origin, number)
        return number <= self._number or life_of(number) != life_of(self._number)

    def forward(self, batches: list[EventBatch], account: Account) -> Claims:
        """Accept events from a peer or a foreign channel, and count them in its account. The caller must `deliver` what
        is returned. Never waits for room in a queue: that would block the link.

        A batch without an epoch was stamped by a clock that agrees with this system's."""
        claims: Claims = []
        with self.lock:
            now, epoch = time.monotonic(), self._clock.epoch()
            for batch in batches:
                batch.epoch = batch.epoch or epoch
                if batch.targets is None:
                    self._forward_foreign(batch, account, now, claims)
                    continue
                before = batch.targets.pop(self.name, None)
                count, is_sent = len(batch), False
                if batch.targets:
                    batch.hops += 1
                    is_sent = self._pass_on(batch, claims)
                if before is not None:
                    for arrival in self._resequencer.add(Arrival(batch, before, now, account)):
                        self._accept(arrival.batch, arrival.account, now, claims)
                elif not batch.targets:  # a peer sends it again for its account only
                    account.repeated += count
                else:
                    account.received += count
                    account.delivered += count if is_sent else 0
                    account.discarded += 0 if is_sent else count
        return claims

    def release_overdue(self, is_over: bool = False) -> None:
        """Deliver events that have waited long enough for earlier ones; to be called about once a second while there
        are peers. is_over: no peer is left from which the earlier ones could come."""
        claims: Claims = []
        with self.lock:
            now, count = time.monotonic(), 0
            for arrival in self._resequencer.overdue(math.inf if is_over else now):
                count += len(arrival.batch)
                self._accept(arrival.batch, arrival.account, now, claims)
        if count:
            _log.warning("delivered %d events without some that were sent before them, which are missing", count)
        self.deliver(claims)

    def _accept(self, batch: EventBatch, account: Account, now: float, claims: Claims) -> list[EventBatch]:
        """Pass what is new of a batch to the consumers; returns it."""
        batch.targets = None
        parts: list[tuple[int, int]] = []
        if batch.header.origin == self.name:
            late = 0 if life_of(batch.first) == life_of(self._number) else len(batch)
        else:
            parts, late = self._seen.add(batch.header.origin, batch.first, batch.last)
        new = sum(last - first + 1 for first, last in parts)
        account.repeated += len(batch) - late - new
        account.received += late + new
        account.discarded += late
        account.refused += late
        result = []
        for first, last in parts:
            is_whole = last - first + 1 == len(batch)
            part = batch if is_whole else batch.part(first - batch.first, last - batch.first + 1)
            alive = part.unexpired(now)
            account.expired += len(part) - len(alive or ())
            account.delivered += len(alive or ())
            if alive and not self.is_destroyed:
                self._find_route(alive.header).supply(alive, now, claims)
                result.append(alive)
        return result

    def _pass_on(self, batch: EventBatch, claims: Claims) -> bool:
        """Send a batch on to its targets; False if it cannot get to any of them."""
        ways = self._ways(batch)
        if not ways or batch.hops > self._policy.max_hops:
            _log.info("discarded %s after %d links: no way to %s", batch, batch.hops, [*(batch.targets or ())])
            return False
        for feed, copy in ways:
            if feed.accept(copy):
                claims.append((feed, copy))
        return True

    def _ways(self, batch: EventBatch) -> list[tuple[Feed, EventBatch]]:
        """A copy for each peer that is next on the way to a target of a batch."""
        ways: dict[str, dict[str, int]] = {}
        for target, before in (batch.targets or {}).items():
            ways.setdefault(self.federation.next_peers.get(target, ""), {})[target] = before
        return [(self.feeds[peer], batch.toward(targets)) for peer, targets in ways.items() if peer in self.feeds]

    def _forward_foreign(self, batch: EventBatch, account: Account, now: float, claims: Claims) -> None:
        """Accept events of another channel that have come by a foreign one: nobody has sent them to the channels that
        want them, or these recognise them."""
        for part in self._accept(batch, account, now, claims):
            part.targets = {name: 0 for _, names in self._find_route(part.header).ways for name in names}
            if part.targets:
                self._pass_on(part, claims)

    @staticmethod
    def deliver(claims: Claims) -> None:
        """Deliver what was claimed; called without the lock. After a slow call, leave the rest to the sinks' own
        threads."""
        is_quick = True
        for sink, batch in claims:
            if is_quick:
                is_quick = sink.deliver(batch)
            else:
                sink.defer(batch)

    def _find_route(self, header: EventHeader) -> _Route:
        route = self._routes.get(header)
        if route is None:
            if len(self._routes) >= 4096:  # one for each header; types and sources are any text
                self._routes.clear()
            route = self._routes[header] = self._new_route(header._replace(origin=header.origin or self.name))
        return route

    def _new_route(self, header: EventHeader) -> _Route:
        type, source, origin = header.type, header.source, header.origin
        wanting = self.federation.ways(type, source, origin)
        ways = [(feed, wanting[peer]) for peer, feed in self.feeds.items() if peer in wanting]
        uninterested = [feed for peer, feed in self.feeds.items() if peer not in wanting and peer != origin]
        proxies: list[tuple[ProxySupplier, SubscriptionMatch]] = []
        blocking = []
        for proxy in self.proxy_suppliers.values():
            match = match_subscription(proxy.subscription, type, source) if proxy.is_selecting else None
            if match:
                proxies.append((proxy, match))
                if proxy.is_blocking:
                    blocking.append(proxy)
        blocking_size = min((proxy.policy.size for proxy in blocking), default=0)
        return _Route(header, self.traffic.of(origin), proxies, ways, uninterested, blocking, blocking_size)

    # ---- subscriptions; called with the lock ----

    def interest(self) -> tuple[Pattern, ...]:
        """The union of the subscriptions of this channel's own consumers; peers do not count."""
        return self._interest.patterns()

    def forget_routes(self) -> None:
        """A proxy supplier has ended or has another subscription; to be called before the lock is released. What else
        follows from it may be updated later."""
        self._routes = {}

    def update_routes(self, changed: ProxySupplier | None = None) -> bool:
        """Drop all cached routes: consumers, subscriptions, peers or advertisements have changed. changed: the only
        proxy that may have come, changed or gone; all by default.

        Returns whether this channel's own advertisement changed, so that the peers need it."""
        self._routes = {}
        if changed is None:
            self._interest = Interest()
        for proxy in [changed] if changed else self.proxy_suppliers.values():
            self._interest.set(proxy.id, proxy.subscription if proxy.is_selecting else ())
        is_new = self.federation.advertise(self.feeds, self.interest(), self.unreached_peers())
        if self.federation.next_peers is not self._next_peers:
            self._next_peers = self.federation.next_peers
            self._move(batch for feed in self.feeds.values() for batch in feed.withdraw(self._next_peers))
        return is_new

    def unreached_peers(self) -> tuple[str, ...]:
        """The peers that events do not reach at present."""
        return tuple(sorted(peer for peer, feed in self.feeds.items() if not feed.is_up))

    def remove_feed(self, peer: str) -> None:
        """End a feed. What waits for it goes by another way; without one it is discarded."""
        feed = self.feeds.pop(peer)
        self.update_routes()
        self._move(feed.end(self._next_peers))

    def _move(self, batches: Iterable[EventBatch]) -> None:
        """Send what waited for a peer by another way. An event that two of them have is recognised where it comes
        again."""
        for batch in merged(sorted(batches, key=lambda batch: (batch.header.origin, batch.first))):
            for feed, copy in self._ways(batch):
                feed.store(copy)
