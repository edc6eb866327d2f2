"""The links of a channel with its peers: for each one a feed that supplies its gateway, and a gateway of its own.

A link has both directions and is kept for good: whichever end was told to link, both know it from then on,
and find it again in their stores.
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
from robocorba.events.event import Run
from robocorba.events.federation import MAX_CHANNELS, Notice, check_name
from robocorba.events.feed import Feed, FeedState, GatewayPort
from robocorba.events.foreign import Attach, ForeignLink
from robocorba.events.gateway import FeedPort, Gateway, GatewayState
from robocorba.events.outlet import Outlet
from robocorba.events.store import PeerRecord, Store
from robocorba.events.subscription import Pattern, is_covered, patterns_of

_log = logging.getLogger(__name__)

#: Begins a session with the feed of a peer; also tells the reference of its channel, to be tried first from then on.
#: Raises NotReachable, InvalidPeer.
Join = Callable[[PeerRecord], tuple[FeedPort, str]]


class LinkStates(NamedTuple):
    """Both directions of a link at one moment; wanted: the interest in force of whoever consumes."""

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
    #: Versions of the notices that the peer knows, as far as the feed told or heard them in its present session.
    told: dict[str, int]


class Links:
    """All links of `channel`, kept in `store`."""

    def __init__(self, channel: Channel, store: Store, join: Join, attach: Callable[[PeerRecord], Attach]) -> None:
        self._channel, self._store, self._join, self._attach = channel, store, join, attach
        self._links: dict[str, _Link] = {}
        self._foreign: dict[str, tuple[PeerRecord, ForeignLink]] = {}
        self._removed: set[str] = set()
        self._lock = threading.RLock()  # for changes of what there is

    def restore(self) -> None:
        """Link again with the peers that the channel had before it was killed."""
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
        """Link with a peer, or go on with the one of this name at another address. Raises InvalidPeer."""
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
                raise InvalidPeer("name", f"{record.name} is a foreign channel here; remove it first")
            self._removed.discard(record.name)
            self._store.save_peer(record)
            if before:
                before.gateway.end()
            self._link(record, before.feed if before else None)
        self.interest_changed()

    def remove(self, name: str, is_told: bool = False) -> None:
        """End a link at both ends; `is_told` where the peer began it. Raises UnknownPeer."""
        with self._lock:
            if name in self._foreign and not is_told:
                self._remove_foreign(name)
                self.interest_changed()
                return
            link = self._links.pop(name, None)
            if link is None:
                raise UnknownPeer(name, sorted(self._links))
            if is_told:  # whoever has removed this channel may add it again
                self._store.forget_peer(name)
            else:
                self._store.save_peer(_removed(link.record))
                self._removed.add(name)
            with self._channel.lock:
                self._channel.feeds.pop(name, None)
                link.feed.end()
                self._channel.changed()
        link.gateway.end(leave=not is_told)
        self.interest_changed()

    def close(self) -> None:
        """The process ends; peers find out, and wait for the next one."""
        for foreign in self.foreign:
            foreign.end()
        with self._lock:
            for link in self._links.values():
                link.gateway.end()
                with self._channel.lock:
                    link.feed.end()

    def interest_changed(self) -> None:
        """The peers have to be told something new."""
        self._keep_notices()
        with self._lock:
            gateways = [link.gateway for link in self._links.values()]
        for gateway in gateways:
            gateway.wake()

    def is_in_force(self, outlet: Outlet, peer: str) -> bool:
        """Whether `peer` knows all that an outlet is subscribed to. Raises UnknownPeer."""
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
        """A session for the gateway of channel `consuming`, which has this reference; and link back.

        Raises InvalidPeer."""
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
                link.told = {}
        link.gateway.wake()  # it is there: no need to wait for the next attempt
        return terms

    def renew(self, session: str, position: int, news: list[Notice]) -> list[Notice]:
        """Take in what a peer tells; what it does not know yet. Raises SessionOver."""
        link = self._fed_by(session)
        with self._channel.lock:
            link.feed.renew(session, position)
            told = link.told  # of this session: should another one begin meanwhile, the peer does not get this answer
        told.update((notice.name, notice.version) for notice in news)
        if news:
            self.learn(news)
        with self._channel.lock:
            answer = [n for n in self._channel.federation.notices if told.get(n.name, 0) < n.version]
        told.update((notice.name, notice.version) for notice in answer)
        return answer

    def acknowledge(self, session: str, position: int) -> None:
        """Raises SessionOver."""
        link = self._fed_by(session)
        with self._channel.lock:
            link.feed.acknowledge(session, position)

    def leave(self, session: str) -> None:
        """A peer has removed this channel. Raises SessionOver."""
        with contextlib.suppress(UnknownPeer):
            self.remove(self._fed_by(session).record.name, is_told=True)

    def forward(self, session: str, position: int, runs: list[Run]) -> None:
        """A batch from the feed of a peer; ignored where the session is over."""
        for link in list(self._links.values()):
            if link.gateway.session == session:
                link.gateway.forward(session, position, runs)

    def learn(self, news: list[Notice]) -> None:
        """Take in notices, and pass on what was new."""
        with self._channel.lock:
            changed = self._channel.federation.learn(news)
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
        """Where a peer is now: there it is looked for first, also after a restart."""
        link = self._links.get(record.name)
        if reference != record.reference and link and link.record is record:
            record.reference = reference
            try:
                self._store.save_peer(record)
            except ServiceError as wrong:  # after a restart it will be looked for as it was the first time
                _log.error("%s", wrong)

    def _link_foreign(self, record: PeerRecord) -> None:
        link = ForeignLink(record.name, self._channel, self._attach(record))
        self._foreign[record.name] = (record, link)
        link.start()

    def _add_foreign(self, record: PeerRecord) -> None:
        if record.name in self._links:
            raise InvalidPeer("name", f"{record.name} is a peer that is not foreign; remove it first")
        if not record.address:
            raise InvalidPeer("address", "that of a foreign channel has to be given")
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
            raise InvalidPeer(field, "a channel can't be a peer of itself")
        if name not in self._links and len(self._links) >= MAX_CHANNELS - 1:
            raise InvalidPeer(field, f"there are {MAX_CHANNELS - 1} peers already")

    def _get(self, name: str) -> _Link:
        link = self._links.get(name)
        if link is None:
            raise UnknownPeer(name, sorted(self._links))
        return link

    def _fed_by(self, session: str) -> _Link:
        for link in list(self._links.values()):
            if link.feed.session == session:
                return link
        raise SessionOver("this session has ended")

    def _keep_notices(self) -> None:
        with self._channel.lock:
            notices = self._channel.federation.notices
        try:
            self._store.save_notices(notices)
        except ServiceError as wrong:  # what is lost is heard again from the peers
            _log.error("%s", wrong)


def _removed(record: PeerRecord) -> PeerRecord:
    return PeerRecord(record.name, removed=True)
