"""The event channel: what comes in goes to every outlet and every peer that wants it.

One lock guards all state of a channel, its outlets and its feeds. A supplier's thread takes it once for each run of
events: numbers them, and puts them into queues or claims consumers that it can call itself. Clients
are called without the lock, so that one that hangs holds up nobody but the thread that calls it.
"""

from __future__ import annotations

import threading
import time
from functools import lru_cache
from typing import NamedTuple

from robocorba.errors import ProxyGone
from robocorba.events.event import Header, Run
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.outlet import Outlet
from robocorba.events.subscription import Fit, Pattern, fit, patterns_of, union
from robocorba.events.watermarks import Watermarks

#: Kinds of events (type, source and origin) whose ways are remembered.
MAX_ROUTES = 4096


class _Route(NamedTuple):
    """Where events of one kind go."""

    outlets: list[tuple[Outlet, Fit]]
    feeds: list[Feed]
    #: Peers that don't get them, but could.
    passed_over: list[Feed]
    #: Whether a supplier may have to wait for one of the outlets.
    blocks: bool


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
        self._routes: dict[tuple[str, str, str], _Route] = {}

    @property
    def name(self) -> str:
        return self.federation.name

    @property
    def last_number(self) -> int:
        return self._number

    # ---- events ----

    def publish(self, run: Run) -> int:
        """Take in events of a supplier of this channel; how many of them had expired already.

        Waits where a consumer's queue is full and its policy is to block suppliers. Raises ProxyGone."""
        header = _stamped(run.header, self.name)
        now = time.time()
        if 0.0 in run.times:
            run.times = [moment or now for moment in run.times]
        expired = 0
        if header.expiry:
            alive = run.fresh(now)
            expired = len(run) - (len(alive) if alive else 0)
            if alive is None:
                return expired
            run = alive
        run.header = header
        for piece in self._pieces(run):
            with self.lock:
                if self.is_destroyed:
                    raise ProxyGone(f"channel {self.name} was destroyed")
                route = self._route(header)
                if route.blocks and self._wait_for_room(header, len(piece)):
                    route = self._route(header)
                piece.first = self._number + 1
                self._number += len(piece)
                claims = self._offer(piece, route, now)
            if claims:
                _deliver(piece, claims)
        return expired

    def forward(self, runs: list[Run]) -> tuple[list[tuple[Run, list[Outlet | Feed]]], int]:
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
                    result.append((alive, self._offer(alive, self._route(alive.header), now)))
        return result, repeated

    @staticmethod
    def deliver(claimed: list[tuple[Run, list[Outlet | Feed]]]) -> None:
        """Make the calls that `forward` has left to its caller, who holds no lock."""
        for run, claims in claimed:
            _deliver(run, claims)

    def _offer(self, run: Run, route: _Route, now: float) -> list[Outlet | Feed]:
        claims: list[Outlet | Feed] = [outlet for outlet, fits in route.outlets if outlet.offer(run, fits, now)]
        for feed in route.feeds:
            if feed.peer != run.via and feed.offer(run):
                claims.append(feed)
        for feed in route.passed_over:
            feed.unseen += len(run)
        return claims

    def _pieces(self, run: Run) -> list[Run]:
        """The run, in pieces that the queues of blocking consumers can hold."""
        if len(run) == 1:
            return [run]
        with self.lock:
            route = self._route(run.header)
            if not route.blocks:
                return [run]
            most = min(outlet.policy.size for outlet, _ in route.outlets if outlet.is_blocking)
        return [run.part(start, start + most) for start in range(0, len(run), most)] if len(run) > most else [run]

    def _wait_for_room(self, header: Header, count: int) -> bool:
        """Let a supplier wait; whether it had to, and everything may have changed meanwhile."""
        waited = False
        for outlet, _ in self._route(header).outlets:
            if outlet.lacks_room(count):
                outlet.wait_for_room(count, outlet.policy.block_limit)
                waited = True
        return waited

    def _route(self, header: Header) -> _Route:
        key = (header.type, header.source, header.origin)
        route = self._routes.get(key)
        if route is None:
            if len(self._routes) >= MAX_ROUTES:
                self._routes.clear()
            route = self._routes[key] = self._find_route(*key)
        return route

    def _find_route(self, type: str, source: str, origin: str) -> _Route:
        outlets = []
        for outlet in self.outlets.values():
            fits = fit(outlet.subscription, type, source) if outlet.is_selecting else None
            if fits:
                outlets.append((outlet, fits))
        wanted = {peer: self.federation.is_wanted(peer, type, source, origin) for peer in self.feeds}
        return _Route(
            outlets,
            [feed for peer, feed in self.feeds.items() if wanted[peer]],
            [feed for peer, feed in self.feeds.items() if not wanted[peer] and peer != origin],
            any(outlet.is_blocking for outlet, _ in outlets),
        )

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


def _deliver(run: Run, claims: list[Outlet | Feed]) -> None:
    """Call whom this thread has claimed; where one takes long, leave the others to their own threads."""
    is_quick = True
    for sink in claims:
        if is_quick:
            is_quick = sink.deliver(run)
        else:
            sink.hand_over(run)


@lru_cache(4096)
def _stamped(header: Header, origin: str) -> Header:
    return header._replace(origin=origin)
