"""The links of a channel with its peers: for each peer a feed that supplies its gateway, and a gateway of its own.

A link has both directions and is permanent: whichever end adds it, both ends keep it in their stores and restore it
at start.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer, SessionOver, UnknownPeer
from robocorba.errors.services import ServiceError
from robocorba.events.account import LinkEnd
from robocorba.events.channel import Channel
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.event import EventBatch
from robocorba.events.federation import MAX_CHANNELS, Advertisement, KnownAdvertisements, check_name
from robocorba.events.feed import Feed, Forward
from robocorba.events.foreign import Attach, ForeignLink
from robocorba.events.gateway import FeedPort, Gateway
from robocorba.events.policies import LinkPolicy
from robocorba.events.proxy import ProxyCondition
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.subscription import is_covered, patterns_of
from robocorba.events.traffic import ChannelTraffic

_log = logging.getLogger(__name__)

#: Begins a session with the feed of a peer. Also returns the stringified reference of the peer's channel, which later
#: attempts try first. Raises NotReachable, InvalidPeer.
Join = Callable[[Peer], tuple[FeedPort, str]]


class LinkSnapshot(NamedTuple):
    """Both directions of a link at one moment; with a foreign channel there are proxies at their ends."""

    peer: str
    feed: LinkEnd
    gateway: LinkEnd


@dataclass(slots=True, eq=False)
class _Link:
    peer: Peer
    feed: Feed
    gateway: Gateway
    #: Of the current session of the feed; a later session begins with another object.
    known: KnownAdvertisements
    #: The reference of the channel that has joined the feed; empty before.
    consumer: str = ""


class Links:
    """All links of `channel`, kept in `store`. attach: returns a function that connects with a foreign channel."""

    def __init__(
        self, channel: Channel, store: ChannelStore, join: Join, attach: Callable[[Peer], Attach], policy: LinkPolicy
    ) -> None:
        self._channel, self._store, self._join, self._attach = channel, store, join, attach
        self._policy = policy
        self._links: dict[str, _Link] = {}
        self._foreign: dict[str, ForeignLink] = {}
        self._removed: set[str] = set()
        self._has_conflicts = self._has_excess = False
        self._lock = threading.RLock()  # guards the set of links
        self._saving = threading.Lock()  # older advertisements never replace newer ones in the store

    def restore(self) -> None:
        """Restore the links that the store holds."""
        for peer in self._store.peers():
            if peer.removed:
                self._removed.add(peer.name)
            elif peer.foreign:
                self._link_foreign(peer)
            else:
                self._link(peer)

    @property
    def peers(self) -> list[Peer]:
        return [link.peer for link in list(self._links.values())] + [each.peer for each in list(self._foreign.values())]

    def add(self, peer: Peer) -> None:
        """Link with a peer, or change the address of a linked one. Raises InvalidPeer."""
        self._check(peer.name, "name")
        with self._lock:
            before = self._links.get(peer.name)
            if before and not peer.foreign and (before.peer.address == peer.address or not peer.address):
                return
            if peer.foreign:
                self._add_foreign(peer)
                self.send_advertisements()
                return
            if peer.name in self._foreign:
                raise InvalidPeer("name", f"{peer.name} is linked as a foreign channel; remove it first")
            self._removed.discard(peer.name)
            self._store.save_peer(peer)
            if before:
                before.gateway.end()
            self._link(peer, before.feed if before else None)
        self.send_advertisements()

    def remove(self, name: str, by_peer: bool = False) -> None:
        """Remove a link at both ends. by_peer: the peer has removed it already. Raises UnknownPeer."""
        with self._lock:
            if name in self._foreign and not by_peer:
                self._remove_foreign(name)
                self.send_advertisements()
                return
            link = self._links.pop(name, None)
            if link is None:
                raise UnknownPeer(name, sorted(self._links))
            if by_peer:  # the peer may add this channel again
                self._store.forget_peer(name)
            else:
                self._store.save_peer(Peer(name, removed=True))
                self._removed.add(name)
            with self._channel.lock:
                self._channel.remove_feed(name)
            is_last = not self._links
        link.gateway.end(leave=not by_peer)
        self._channel.release_overdue(is_over=is_last)
        self.send_advertisements()

    def close(self) -> None:
        """End all threads of links; the links stay in the store, and peers wait for the next process."""
        for foreign in list(self._foreign.values()):
            foreign.end()
        with self._lock:
            for link in self._links.values():
                link.gateway.end()
                with self._channel.lock:
                    link.feed.end()

    def send_advertisements(self, learned: Sequence[Advertisement] = ()) -> None:
        """Save the advertisements, and send the new ones to the peers. learned: those that have changed, if the own one
        has not. Their channels send them to their own peers, who get them from here with the next renewals only: in a
        full mesh each change would otherwise cost a call of every channel to every other one."""
        with self._saving:
            with self._channel.lock:
                advertisements = self._channel.federation.advertisements
            try:
                self._store.save_advertisements(advertisements)
            except ServiceError as error:  # after a restart the peers send the advertisements again
                _log.error("%s", error)
        with self._lock:
            links = list(self._links.values())
        for link in links:
            if not learned or any(not entry.reaches(link.peer.name) for entry in learned):
                link.gateway.send_news()

    def is_in_force(self, proxy: ProxySupplier, peer: str) -> bool:
        """Whether `peer` has received an interest that covers the subscription of a proxy. Raises UnknownPeer."""
        link = self._links.get(peer)
        if link is None:
            raise UnknownPeer(peer, sorted(self._links))
        in_force = link.gateway.in_force
        return all(is_covered(pattern, in_force) for pattern in patterns_of(proxy.subscription))

    def snapshots(self) -> list[LinkSnapshot]:
        with self._lock:
            links = list(self._links.values())
        result = []
        for link in links:
            name = link.peer.name
            with self._channel.lock:
                feed, conflict = link.feed.snapshot(self._channel.federation.interest_of(name)), link.feed.conflict
                excess = self._channel.federation.excess(name)
            gateway = link.gateway.snapshot()
            if conflict and gateway.is_up:
                gateway = gateway._replace(problem=conflict)
            result.append(LinkSnapshot(name, feed._replace(warning=excess), gateway._replace(warning=excess)))
        return result + [LinkSnapshot(foreign.name, *foreign.snapshot()) for foreign in list(self._foreign.values())]

    def traffic(self) -> ChannelTraffic:
        """What the channel has counted and measured until now."""
        ends = ((link.peer, link.gateway) for link in self.snapshots())
        round_trips_s = {peer: end.round_trip_s for peer, end in ends if end.is_up and end.round_trip_s}
        with self._channel.lock:
            proxies = self._channel.proxy_suppliers.values()
            calls_s = [(p.mean_s, p.fastest_s) for p in proxies if p.condition is ProxyCondition.CONNECTED]
            return self._channel.traffic.read(calls_s, round_trips_s)

    # ---- called for peers ----

    def join(self, consuming: str, reference: str, forward: Forward) -> tuple[str, int]:
        """Begin a session for the gateway of channel `consuming`, which has this reference, and link back to it.

        Returns the session and the position of its first packet. While a channel is linked, another one of the same
        name, such as that of a system whose state was copied, takes nothing from it. Raises InvalidPeer."""
        self._check(consuming, "consuming")
        with self._lock:
            if consuming in self._removed:
                raise InvalidPeer("consuming", f"{self._channel.name} has removed {consuming}; add it there again")
            if consuming not in self._links:
                self.add(Peer(consuming, reference=reference))
            link = self._links[consuming]
            with self._channel.lock:
                if link.feed.is_in_contact and link.consumer != reference:
                    reason = f"another {consuming} is linked with {self._channel.name}; does one run on a copied state?"
                    raise InvalidPeer("consuming", reason)
            self._note_reference(link.peer, reference)
            link.consumer = reference
            with self._channel.lock:
                terms = link.feed.join(forward)
                link.known = KnownAdvertisements()
        link.gateway.wake()  # the peer is reachable: join it without waiting for the backoff
        return terms

    def renew(
        self, session: str, position: int, refused: int, advertisements: list[Advertisement]
    ) -> list[Advertisement]:
        """Learn a peer's advertisements; returns those that are new to the peer. refused: see Feed. Raises
        SessionOver."""
        link = self._link_of(session)
        if advertisements:  # before anything is sent by routes that the peer uses no more
            self.learn(advertisements)
        with self._channel.lock:
            link.feed.renew(session, position, refused)
            link.gateway.note_arrival()
            known = link.known
            known.add(advertisements)
            answer = known.missing(self._channel.federation.advertisements)
        known.add(answer)
        return answer

    def acknowledge(self, session: str, position: int) -> None:
        """A peer has received all packets before `position`. Raises SessionOver."""
        link = self._link_of(session)
        with self._channel.lock:
            link.feed.acknowledge(session, position)

    def leave(self, session: str) -> None:
        """A peer has removed this channel. Raises SessionOver."""
        with contextlib.suppress(UnknownPeer):
            self.remove(self._link_of(session).peer.name, by_peer=True)

    def forward(self, session: str, position: int, batches: list[EventBatch], invalid: int = 0) -> None:
        """Accept a packet from the feed of a peer; a packet of an ended session is ignored. invalid: number of events
        that were left out."""
        for link in list(self._links.values()):
            if link.gateway.session == session:
                link.gateway.forward(session, position, batches, invalid)

    def learn(self, advertisements: list[Advertisement]) -> None:
        """Merge advertisements, and pass new ones on to the peers. Gateways call it at each renewal."""
        with self._channel.lock:
            federation = self._channel.federation
            before = federation.advertisements
            changed = federation.learn(advertisements)
            self._note_conflicts()
            if changed or self._channel.unreached_peers() != federation.own.down:
                changed |= self._channel.update_routes()
            news = [entry for entry in federation.advertisements if entry not in before] if changed else []
        if changed:
            self.send_advertisements(() if federation.own in news else news)

    # ---- private ----

    def _note_conflicts(self) -> None:
        """Hold back the events for channels whose name another one has, and all if this channel is one of them; log
        when channels become too many."""
        federation = self._channel.federation
        if not self._has_excess:
            for peer in sorted(set(federation.left_out.values())):
                _log.warning("the federation is too large, by %s: %s", peer, federation.excess(peer))
        self._has_excess = bool(federation.left_out)
        conflicts = federation.conflicts()
        if conflicts or self._has_conflicts:
            for peer, feed in self._channel.feeds.items():
                feed.set_conflict(conflicts.get(self._channel.name) or conflicts.get(peer, ""))
        self._has_conflicts = bool(conflicts)

    def _link(self, peer: Peer, feed: Feed | None = None) -> None:
        feed = feed or Feed(self._channel.lock, peer.name, self._policy)
        gateway = Gateway(peer.name, self._channel, lambda: self._join_feed(peer), self.learn, self._policy)
        self._links[peer.name] = _Link(peer, feed, gateway, KnownAdvertisements())
        with self._channel.lock:
            self._channel.feeds[peer.name] = feed
            self._channel.update_routes()
        gateway.start()

    def _join_feed(self, peer: Peer) -> FeedPort:
        port, reference = self._join(peer)
        with self._lock:
            self._note_reference(peer, reference)
        return port

    def _note_reference(self, peer: Peer, reference: str) -> None:
        """Save the current reference of a peer, which is tried first, also after a restart."""
        link = self._links.get(peer.name)
        if reference != peer.reference and link and link.peer is peer:
            peer.reference = reference
            try:
                self._store.save_peer(peer)
            except ServiceError as error:  # after a restart the peer is found by its address or name
                _log.error("%s", error)

    def _link_foreign(self, peer: Peer) -> None:
        link = ForeignLink(peer, self._channel, self._attach(peer), self._policy)
        self._foreign[peer.name] = link
        link.start()

    def _add_foreign(self, peer: Peer) -> None:
        if peer.name in self._links:
            raise InvalidPeer("name", f"{peer.name} is linked as an ordinary peer; remove it first")
        if not peer.address:
            raise InvalidPeer("address", "a foreign channel needs an address")
        if peer.name in self._foreign:
            if self._foreign[peer.name].peer.address == peer.address:
                return
            self._remove_foreign(peer.name)
        self._store.save_peer(peer)
        self._link_foreign(peer)

    def _remove_foreign(self, name: str) -> None:
        link = self._foreign.pop(name)
        self._store.forget_peer(name)
        link.end()

    def _check(self, name: str, field: str) -> None:
        check_name(name, field)
        if name == self._channel.name:
            raise InvalidPeer(field, "a channel cannot be a peer of itself")
        with self._channel.lock:
            known = {entry.name for entry in self._channel.federation.advertisements} | self._links.keys()
        if name not in known and len(known) >= MAX_CHANNELS:
            raise InvalidPeer(field, f"the federation of {self._channel.name} has {MAX_CHANNELS} channels, the maximum")

    def _link_of(self, session: str) -> _Link:
        for link in list(self._links.values()):
            if link.feed.session == session:
                return link
        raise SessionOver("this session has ended")
