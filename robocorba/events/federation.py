"""The federation as one channel knows it: its channels, their links and their interest (the union of subscriptions).

Each channel advertises its peers and its interest, and passes the advertisements of others on (link-state routing).
An event goes to those peers that lie on a shortest path from its origin to a channel that wants it. So a channel
without interest that lies on no such path receives nothing, and events never loop in cyclic topologies.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer
from robocorba.events.subscription import MAX_UNION, Pattern

#: Maximum number of channels in a federation.
MAX_CHANNELS = 256
#: Maximum length of a channel's name [characters].
MAX_NAME = 60
_UNREACHABLE = 1 << 30


class Advertisement(NamedTuple):
    """A link-state advertisement of channel `name` (a ChannelNotice of the IDL): its peers and its interest. The higher
    version is the newer one."""

    name: str
    version: int
    peers: tuple[str, ...]
    interest: tuple[Pattern, ...]


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

    name: of the channel that this federation is seen from. known: stored advertisements of an earlier process."""

    def __init__(self, name: str, known: Iterable[Advertisement] = (), max_channels: int = MAX_CHANNELS) -> None:
        self.name = name
        self._max_channels = max_channels
        #: Includes channels that are unreachable now. They are ignored, but kept: nobody would send them again.
        self._advertisements = {entry.name: entry for entry in known}
        own = self._advertisements.get(name)
        peers, interest = (own.peers, own.interest) if own else ((), ())
        self._advertisements[name] = Advertisement(name, _next_version(own), peers, interest)
        self._rebuild_graph()

    @property
    def own(self) -> Advertisement:
        return self._advertisements[self.name]

    @property
    def advertisements(self) -> list[Advertisement]:
        """Of the reachable channels: its own first, then the others by name."""
        reachable = (entry for entry in self._advertisements.values() if entry.name in self._own_distances)
        return sorted(reachable, key=lambda entry: (entry.name != self.name, entry.name))

    def interest_of(self, channel: str) -> tuple[Pattern, ...]:
        """The interest that a channel advertises; empty for an unknown channel."""
        entry = self._advertisements.get(channel)
        return entry.interest if entry else ()

    def advertise(self, peers: Iterable[str], interest: tuple[Pattern, ...]) -> bool:
        """Set this channel's own advertisement; whether it changed."""
        own, peers = self.own, tuple(sorted(peers))
        if (own.peers, own.interest) == (peers, interest):
            return False
        self._advertisements[self.name] = Advertisement(self.name, _next_version(own), peers, interest)
        if peers != own.peers:
            self._rebuild_graph()
        return True

    def learn(self, advertisements: Iterable[Advertisement]) -> bool:
        """Merge the advertisements that another channel knows; whether any of them was new."""
        changed = links_changed = False
        for entry in advertisements:
            known = self._advertisements.get(entry.name)
            if known and known.version >= entry.version:
                continue
            if entry.name == self.name:
                if entry.version > _clock():  # made before the clock was set back: the present one must supersede it
                    self._advertisements[self.name] = self.own._replace(version=entry.version + 1)
                    changed = True
                continue
            changed = True
            if known is None and len(self._advertisements) >= self._max_channels:
                self._advertisements = {reachable.name: reachable for reachable in self.advertisements}
                if len(self._advertisements) >= self._max_channels:
                    continue
            self._advertisements[entry.name] = entry._replace(interest=entry.interest[:MAX_UNION])
            links_changed |= known is None or known.peers != entry.peers
        if links_changed:
            self._rebuild_graph()
        return changed

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
        self._cached_distances: dict[str, dict[str, int]] = {}
        self._own_distances = self._distances(self.name)


def _next_version(before: Advertisement | None) -> int:
    """Based on the clock, so that the advertisement of a channel that lost its state supersedes its earlier ones."""
    return max(before.version + 1 if before else 0, _clock())


def _clock() -> int:
    """Microseconds since 1970."""
    return time.time_ns() // 1000
