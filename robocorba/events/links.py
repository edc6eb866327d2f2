"""The links of a channel with its peers: for each peer a feed that supplies its gateway, and a gateway of its own.

A link has both directions and is permanent: whichever end adds it, both ends keep it in their stores and restore it
at start.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer, SessionOver, UnknownPeer
from robocorba.errors.services import ServiceError
from robocorba.events.channel import Channel
from robocorba.events.event import EventRun
from robocorba.events.federation import MAX_CHANNELS, Advertisement, check_name
from robocorba.events.feed import Feed, FeedState, GatewayPort
from robocorba.events.foreign import Attach, ForeignLink
from robocorba.events.gateway import FeedPort, Gateway, GatewayState
from robocorba.events.outlet import Outlet
from robocorba.events.store import ChannelStore, PeerRecord
from robocorba.events.subscription import Pattern, is_covered, patterns_of

_log = logging.getLogger(__name__)

#: Begins a session with the feed of a peer. Also returns the stringified reference of the peer's channel, which later
#: attempts try first. Raises NotReachable, InvalidPeer.
Join = Callable[[PeerRecord], tuple[FeedPort, str]]


class LinkStates(NamedTuple):
    """Snapshot of both directions of a link. wanted_there, wanted_here: the interest in force of the consuming end."""

    peer: str
    feed: FeedState
    wanted_there: tuple[Pattern, ...]
    gateway: GatewayState
    wanted_here: tuple[Pattern, ...]


@dataclass(slots=True, eq=False)
class _Link:
    record: PeerRecord
    feed: Feed
    gateway: Gateway
    #: Versions of the advertisements that the peer has received or sent in the current session of the feed.
    known_versions: dict[str, int]


class Links:
    """All links of `channel`, kept in `store`."""

    def __init__(
        self, channel: Channel, store: ChannelStore, join: Join, attach: Callable[[PeerRecord], Attach]
    ) -> None:
        self._channel, self._store, self._join, self._attach = channel, store, join, attach
        self._links: dict[str, _Link] = {}
        self._foreign: dict[str, tuple[PeerRecord, ForeignLink]] = {}
        self._removed: set[str] = set()
        self._lock = threading.RLock()  # guards the set of links

    def restore(self) -> None:
        """Restore the links that the store holds."""
        for record in self._store.peers():
            if record.removed:
                self._removed.add(record.name)
            elif record.foreign:
                self._link_foreign(record)
            else:
                self._link(record)

    @property
    def peers(self) -> list[PeerRecord]:
        foreign = [record for record, _ in list(self._foreign.values())]
        return [link.record for link in list(self._links.values())] + foreign

    @property
    def foreign(self) -> list[ForeignLink]:
        return [link for _, link in list(self._foreign.values())]

    def add(self, record: PeerRecord) -> None:
        """Link with a peer, or change the address of a linked one. Raises InvalidPeer."""
        self._check(record.name, "name")
        with self._lock:
            before = self._links.get(record.name)
            if before and not record.foreign and (before.record.address == record.address or not record.address):
                return
            if record.foreign:
                self._add_foreign(record)
                self.interest_changed()
                return
            if record.name in self._foreign:
                raise InvalidPeer("name", f"{record.name} is linked as a foreign channel; remove it first")
            self._removed.discard(record.name)
            self._store.save_peer(record)
            if before:
                before.gateway.end()
            self._link(record, before.feed if before else None)
        self.interest_changed()

    def remove(self, name: str, by_peer: bool = False) -> None:
        """Remove a link at both ends. by_peer: the peer has removed it already. Raises UnknownPeer."""
        with self._lock:
            if name in self._foreign and not by_peer:
                self._remove_foreign(name)
                self.interest_changed()
                return
            link = self._links.pop(name, None)
            if link is None:
                raise UnknownPeer(name, sorted(self._links))
            if by_peer:  # the peer may add this channel again
                self._store.forget_peer(name)
            else:
                self._store.save_peer(_removed(link.record))
                self._removed.add(name)
            with self._channel.lock:
                self._channel.feeds.pop(name, None)
                link.feed.end()
                self._channel.changed()
        link.gateway.end(leave=not by_peer)
        self.interest_changed()

    def close(self) -> None:
        """End all threads of links; the links stay in the store, and peers wait for the next process."""
        for foreign in self.foreign:
            foreign.end()
        with self._lock:
            for link in self._links.values():
                link.gateway.end()
                with self._channel.lock:
                    link.feed.end()

    def interest_changed(self) -> None:
        """Save the advertisements, and send the new ones to the peers."""
        self._save_advertisements()
        with self._lock:
            gateways = [link.gateway for link in self._links.values()]
        for gateway in gateways:
            gateway.wake()

    def is_in_force(self, outlet: Outlet, peer: str) -> bool:
        """Whether `peer` has received an interest that covers an outlet's subscription. Raises UnknownPeer."""
        in_force = self._get(peer).gateway.in_force
        return all(is_covered(pattern, in_force) for pattern in patterns_of(outlet.subscription))

    def states(self) -> list[LinkStates]:
        with self._lock:
            links = list(self._links.values())
        result = []
        for link in links:
            name = link.record.name
            with self._channel.lock:
                feed = link.feed.state()
                wanted_there = self._channel.federation.interest_of(name)
            result.append(LinkStates(name, feed, wanted_there, link.gateway.state(), link.gateway.in_force))
        return result

    # ---- what peers call ----

    def join(self, consuming: str, reference: str, port: GatewayPort) -> tuple[str, int]:
        """Begin a session for the gateway of channel `consuming`, which has this reference, and link back to it.

        Returns the session and the position of its first batch. Raises InvalidPeer."""
        self._check(consuming, "consuming")
        with self._lock:
            if consuming in self._removed:
                raise InvalidPeer("consuming", f"{self._channel.name} has removed {consuming}; add it there again")
            if consuming not in self._links:
                self.add(PeerRecord(consuming, reference=reference))
            link = self._links[consuming]
            self._note_reference(link.record, reference)
            with self._channel.lock:
                terms = link.feed.join(port)
                link.known_versions = {}
        link.gateway.wake()  # the peer is reachable: join it without waiting for the backoff
        return terms

    def renew(self, session: str, position: int, advertisements: list[Advertisement]) -> list[Advertisement]:
        """Learn a peer's advertisements; returns those that are new to the peer. Raises SessionOver."""
        link = self._link_of(session)
        with self._channel.lock:
            link.feed.renew(session, position)
            known = link.known_versions  # of this session; a later session starts with an empty dict
        known.update((entry.name, entry.version) for entry in advertisements)
        if advertisements:
            self.learn(advertisements)
        with self._channel.lock:
            answer = [n for n in self._channel.federation.advertisements if known.get(n.name, 0) < n.version]
        known.update((entry.name, entry.version) for entry in answer)
        return answer

    def acknowledge(self, session: str, position: int) -> None:
        """A peer has received all batches before `position`. Raises SessionOver."""
        link = self._link_of(session)
        with self._channel.lock:
            link.feed.acknowledge(session, position)

    def leave(self, session: str) -> None:
        """A peer has removed this channel. Raises SessionOver."""
        with contextlib.suppress(UnknownPeer):
            self.remove(self._link_of(session).record.name, by_peer=True)

    def forward(self, session: str, position: int, runs: list[EventRun]) -> None:
        """Accept a batch from the feed of a peer; a batch of an ended session is ignored."""
        for link in list(self._links.values()):
            if link.gateway.session == session:
                link.gateway.forward(session, position, runs)

    def learn(self, advertisements: list[Advertisement]) -> None:
        """Merge advertisements, and pass new ones on to the peers."""
        with self._channel.lock:
            changed = self._channel.federation.learn(advertisements)
            if changed:
                self._channel.changed()
        if changed:
            self.interest_changed()

    # ---- inside ----

    def _link(self, record: PeerRecord, feed: Feed | None = None) -> None:
        feed = feed or Feed(self._channel.lock, record.name)
        gateway = Gateway(record.name, self._channel, lambda: self._begin(record), self.learn)
        self._links[record.name] = _Link(record, feed, gateway, {})
        with self._channel.lock:
            self._channel.feeds[record.name] = feed
            self._channel.changed()
        gateway.start()

    def _begin(self, record: PeerRecord) -> FeedPort:
        port, reference = self._join(record)
        with self._lock:
            self._note_reference(record, reference)
        return port

    def _note_reference(self, record: PeerRecord, reference: str) -> None:
        """Save the current reference of a peer, which is tried first, also after a restart."""
        link = self._links.get(record.name)
        if reference != record.reference and link and link.record is record:
            record.reference = reference
            try:
                self._store.save_peer(record)
            except ServiceError as error:  # after a restart the peer is found by its address or name
                _log.error("%s", error)

    def _link_foreign(self, record: PeerRecord) -> None:
        link = ForeignLink(record.name, self._channel, self._attach(record))
        self._foreign[record.name] = (record, link)
        link.start()

    def _add_foreign(self, record: PeerRecord) -> None:
        if record.name in self._links:
            raise InvalidPeer("name", f"{record.name} is linked as an ordinary peer; remove it first")
        if not record.address:
            raise InvalidPeer("address", "a foreign channel needs an address")
        if record.name in self._foreign:
            if self._foreign[record.name][0].address == record.address:
                return
            self._remove_foreign(record.name)
        self._store.save_peer(record)
        self._link_foreign(record)

    def _remove_foreign(self, name: str) -> None:
        _, link = self._foreign.pop(name)
        self._store.forget_peer(name)
        link.end()

    def _check(self, name: str, field: str) -> None:
        check_name(name, field)
        if name == self._channel.name:
            raise InvalidPeer(field, "a channel cannot be a peer of itself")
        if name not in self._links and len(self._links) >= MAX_CHANNELS - 1:
            raise InvalidPeer(field, f"the channel has {MAX_CHANNELS - 1} peers, the maximum")

    def _get(self, name: str) -> _Link:
        link = self._links.get(name)
        if link is None:
            raise UnknownPeer(name, sorted(self._links))
        return link

    def _link_of(self, session: str) -> _Link:
        for link in list(self._links.values()):
            if link.feed.session == session:
                return link
        raise SessionOver("this session has ended")

    def _save_advertisements(self) -> None:
        with self._channel.lock:
            advertisements = self._channel.federation.advertisements
        try:
            self._store.save_advertisements(advertisements)
        except ServiceError as error:  # after a restart the peers send the advertisements again
            _log.error("%s", error)


def _removed(record: PeerRecord) -> PeerRecord:
    return PeerRecord(record.name, removed=True)
