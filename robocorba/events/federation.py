"""The federation as one channel knows it: its channels, their links and their interest (the union of subscriptions).

Each channel advertises its peers and its interest, and passes the advertisements of others on (link-state routing).
An event goes to those peers that lie on a shortest path from its origin to a channel that wants it. So a channel
without interest that lies on no such path receives nothing, and events never loop in cyclic topologies.

A version counts the changes of an advertisement, and names the life of its channel (see event_numbers.py). A channel
supersedes what others remember of its earlier lives. An earlier life that supersedes it in turn, again and again, is
another channel of the same name: a conflict, during which the links of both are down.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer
from robocorba.events.subscription import MAX_UNION, Pattern

#: Maximum number of channels in a federation.
MAX_CHANNELS = 256
#: Maximum length of a channel's name [characters].
MAX_NAME = 60
#: The bits of a version that name the life.
LIFE_BITS = 32
_LIFE_MASK = (1 << LIFE_BITS) - 1
#: Lives that have superseded each other this many times are of two channels. A few times are possible where parts of a
#: federation that were separated remember different lives of a channel.
MIN_RETURNS = 4
#: Two channels of the same name supersede each other at this interval [s], after the first few times.
CONFLICT_INTERVAL_S = 1.0
#: A conflict has ended when they have not for this time [s].
CONFLICT_S = 10.0
_UNREACHABLE = 1 << 30


class Advertisement(NamedTuple):
    """A link-state advertisement of channel `name` (a ChannelNotice of the IDL): its peers and its interest. The higher
    version is the newer one; its upper bits count changes, its lower ones name the channel's life."""

    name: str
    version: int
    peers: tuple[str, ...]
    interest: tuple[Pattern, ...]

    @property
    def life(self) -> int:
        return self.version & _LIFE_MASK


@dataclass(slots=True)
class _Rivalry:
    """Lives of one channel that supersede each other. lives: those that were superseded. returns: how often one of them
    has come back. last_at: when it did so last [s, time.monotonic]. peers: of the two latest advertisements."""

    lives: set[int]
    returns: int = 0
    last_at: float = 0.0
    peers: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    @property
    def is_conflict(self) -> bool:
        return self.returns >= MIN_RETURNS and time.monotonic() - self.last_at <= CONFLICT_S

    def describe(self, name: str) -> str:
        linked = [f"one linked with {', '.join(peers)}" for peers in sorted(self.peers) if peers]
        where = f" ({'; '.join(linked)})" if linked else ""
        return f"two channels with the name {name} are in the federation{where}; give one of them another name"


def check_name(name: str, field: str = "name") -> str:
    """The name of a channel, which is part of object keys, file names and names in the naming service.

    Raises InvalidPeer."""
    if not is_name(name):
        raise InvalidPeer(field, f"{name[:80]!r} is not 1 to {MAX_NAME} letters, digits or . _ - (first: no . or -)")
    return name


def is_name(text: str) -> bool:
    """Whether a channel can have this name."""
    return re.fullmatch(rf"[A-Za-z0-9_][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}", text) is not None


class Federation:
    """Advertisements by channel name, and the shortest paths between channels. Guarded by the channel's lock.

    name, life: of the channel that this federation is seen from. known: stored advertisements of an earlier process."""

    def __init__(
        self, name: str, known: Iterable[Advertisement] = (), life: int = 1, max_channels: int = MAX_CHANNELS
    ) -> None:
        self.name, self._life = name, life
        #: Number of changes of the links.
        self.topology = 0
        self._max_channels = max_channels
        #: Includes channels that are unreachable now. They are ignored, but kept: nobody would send them again.
        self._advertisements = {entry.name: entry for entry in known}
        own = self._advertisements.get(name)
        version, peers, interest = (own.version, own.peers, own.interest) if own else (0, (), ())
        self._advertisements[name] = Advertisement(name, self._version_above(version), peers, interest)
        #: What `advertisements` returns, None after a change.
        self._listed: list[Advertisement] | None = None
        self._rivalries: dict[str, _Rivalry] = {}
        #: An advertisement of this channel's name that has superseded its own, None if there is none.
        self._superseding: Advertisement | None = None
        self._rebuild_graph()

    @property
    def own(self) -> Advertisement:
        return self._advertisements[self.name]

    @property
    def advertisements(self) -> list[Advertisement]:
        """Of the reachable channels: its own first, then the others by name. The same list until one changes."""
        if self._listed is None:
            reachable = (entry for entry in self._advertisements.values() if entry.name in self._own_distances)
            self._listed = sorted(reachable, key=lambda entry: (entry.name != self.name, entry.name))
        return self._listed

    def interest_of(self, channel: str) -> tuple[Pattern, ...]:
        """The interest that a channel advertises; empty for an unknown channel."""
        entry = self._advertisements.get(channel)
        return entry.interest if entry else ()

    def advertise(self, peers: Iterable[str], interest: tuple[Pattern, ...]) -> bool:
        """Set this channel's own advertisement; whether it changed."""
        own, peers = self.own, tuple(sorted(peers))
        if (own.peers, own.interest) == (peers, interest):
            return False
        self._advertisements[self.name] = Advertisement(self.name, self._version_above(own.version), peers, interest)
        self._listed = None
        if peers != own.peers:
            self._rebuild_graph()
        return True

    def learn(self, advertisements: Iterable[Advertisement]) -> bool:
        """Merge the advertisements that another channel knows; whether any has changed. To be called at least every
        two seconds, with no advertisements if there are none: see `_reassert`."""
        changed = links_changed = False
        for entry in advertisements:
            known = self._advertisements.get(entry.name)
            if known and known.version >= entry.version:
                continue
            if entry.name == self.name:
                self._contest(entry)
                continue
            changed = True
            if known and known.life != entry.life:
                self._note_life(known, entry)
            if known is None and len(self._advertisements) >= self._max_channels:
                self._advertisements = {reachable.name: reachable for reachable in self.advertisements}
                if len(self._advertisements) >= self._max_channels:
                    continue
            self._advertisements[entry.name] = entry._replace(interest=entry.interest[:MAX_UNION])
            self._listed = None
            links_changed |= known is None or known.peers != entry.peers
        if links_changed:
            self._rebuild_graph()
        return self._reassert() or changed

    def conflicts(self) -> dict[str, str]:
        """The names that two channels have, and why no link with these can be up."""
        return {name: rivalry.describe(name) for name, rivalry in self._rivalries.items() if rivalry.is_conflict}

    def _contest(self, entry: Advertisement) -> None:
        """Note that an advertisement of this channel's name has superseded the own one: that of an earlier life, or of
        another channel."""
        if self._superseding and self._superseding.version >= entry.version:
            return
        if entry.life != self._life:
            self._note_life(self.own, entry)
        self._superseding = entry

    def _reassert(self) -> bool:
        """Supersede it: at once, and during a conflict at intervals. Whether the own advertisement has changed."""
        entry, rivalry = self._superseding, self._rivalries.get(self.name)
        if entry is None:
            return False
        if rivalry and rivalry.is_conflict and time.monotonic() - rivalry.last_at < CONFLICT_INTERVAL_S:
            return False
        own = self._advertisements[self.name] = self.own._replace(version=self._version_above(entry.version))
        self._listed = self._superseding = None
        if entry.life != self._life:
            self._note_life(entry, own)
        return True

    def _note_life(self, before: Advertisement, after: Advertisement) -> None:
        """Note that an advertisement of another life supersedes one."""
        now = time.monotonic()
        rivalry = self._rivalries.get(after.name)
        if rivalry is None or now - rivalry.last_at > CONFLICT_S:
            if len(self._rivalries) >= self._max_channels:
                self._rivalries.clear()
            rivalry = self._rivalries[after.name] = _Rivalry(set())
        rivalry.lives.add(before.life)
        rivalry.returns += after.life in rivalry.lives
        rivalry.last_at, rivalry.peers = now, (before.peers, after.peers)

    def _version_above(self, version: int) -> int:
        """The next version after `version` that names this life."""
        return (((version >> LIFE_BITS) + 1) << LIFE_BITS) | self._life

    def is_wanted(self, peer: str, type: str, source: str, origin: str) -> bool:
        """Whether this channel has to forward an event to `peer`."""
        if origin == peer:
            return False
        return any(
            self._is_next_hop(origin, peer, entry.name) and any(p.matches(type, source) for p in entry.interest)
            for entry in self._advertisements.values()
            if entry.name not in (self.name, origin)
        )

    def _is_next_hop(self, origin: str, peer: str, target: str) -> bool:
        """Whether a shortest path from `origin` to `target` leads through this channel and then `peer`."""
        rest = 1 + self._distances(peer).get(target, _UNREACHABLE)
        if origin == self.name or origin not in self._own_distances:
            return rest == self._own_distances.get(target, _UNREACHABLE)
        return self._own_distances[origin] + rest == self._distances(origin).get(target, _UNREACHABLE)

    def _distances(self, channel: str) -> dict[str, int]:
        """Distances from one channel to the others [links]."""
        import networkx as nx  # here: it takes 0.2 s to load, and every client of a channel loads this module

        if channel not in self._cached_distances:
            known = channel in self._graph
            self._cached_distances[channel] = (
                nx.single_source_shortest_path_length(self._graph, channel) if known else {}
            )
        return self._cached_distances[channel]

    def _rebuild_graph(self) -> None:
        """Use the links that both ends advertise, and links to channels without an advertisement yet."""
        import networkx as nx

        graph: nx.Graph[str] = nx.Graph()
        graph.add_node(self.name)
        for entry in self._advertisements.values():
            for peer in entry.peers:
                other = self._advertisements.get(peer)
                if other is None or entry.name in other.peers:
                    graph.add_edge(entry.name, peer)
        self._graph = graph
        self.topology += 1
        self._cached_distances: dict[str, dict[str, int]] = {}
        self._own_distances = self._distances(self.name)
