"""The federation as one channel knows it: which channels there are, who is linked with whom, who wants what.

Each channel tells a notice of itself, and passes on those of others. From them follows where an event goes:
to those peers that lie on a shortest way from its origin to a channel that wants it. So a channel that nobody
needs as a way, and that asked for nothing, gets nothing; and in a ring nothing goes round.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer
from robocorba.events.subscription import MAX_UNION, Pattern

#: Channels of one federation.
MAX_CHANNELS = 256
MAX_NAME = 60
_FAR = 1 << 30


class Notice(NamedTuple):
    """What channel `name` tells of itself; the higher version is the newer one."""

    name: str
    version: int
    peers: tuple[str, ...]
    interest: tuple[Pattern, ...]


def check_name(name: str, field: str = "name") -> str:
    """The name of a channel: it stands in object keys, files and the naming service. Raises InvalidPeer."""
    if not is_name(name):
        raise InvalidPeer(field, f"{name[:80]!r} is not 1 to {MAX_NAME} letters, digits or . _ - (first: no . or -)")
    return name


def is_name(text: str) -> bool:
    """Whether a channel can have this name."""
    return re.fullmatch(rf"[A-Za-z0-9_][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}", text) is not None


class Federation:
    """Notices by name, and the ways between channels. Guarded by the channel's lock."""

    def __init__(self, name: str, known: Iterable[Notice] = ()) -> None:
        self.name = name
        #: Those of channels that no way leads to just now count for nothing, but are kept: nobody tells them again.
        self._notices = {notice.name: notice for notice in known}
        own = self._notices.get(name)
        self._notices[name] = Notice(name, _next_version(own), own.peers if own else (), own.interest if own else ())
        self._find_ways()

    @property
    def own(self) -> Notice:
        return self._notices[self.name]

    @property
    def notices(self) -> list[Notice]:
        """Of the channels that can be reached: its own first, then the others by name."""
        near = (notice for notice in self._notices.values() if notice.name in self._near)
        return sorted(near, key=lambda notice: (notice.name != self.name, notice.name))

    def interest_of(self, channel: str) -> tuple[Pattern, ...]:
        notice = self._notices.get(channel)
        return notice.interest if notice else ()

    def tell(self, peers: Iterable[str], interest: tuple[Pattern, ...]) -> bool:
        """Make its own notice say this; whether it said something else before."""
        own, peers = self.own, tuple(sorted(peers))
        if (own.peers, own.interest) == (peers, interest):
            return False
        self._notices[self.name] = Notice(self.name, _next_version(own), peers, interest)
        if peers != own.peers:
            self._find_ways()
        return True

    def learn(self, notices: Iterable[Notice]) -> bool:
        """Take in what another channel knows; whether any of it was new."""
        changed = is_moved = False
        for notice in notices:
            known = self._notices.get(notice.name)
            if known and known.version >= notice.version:
                continue
            if notice.name == self.name:
                if notice.version > _clock():  # of before it was set back: what this channel says now has to count
                    self._notices[self.name] = self.own._replace(version=notice.version + 1)
                    changed = True
                continue
            changed = True
            if known is None and len(self._notices) >= MAX_CHANNELS:
                self._notices = {near.name: near for near in self.notices}
                if len(self._notices) >= MAX_CHANNELS:
                    continue
            self._notices[notice.name] = notice._replace(interest=notice.interest[:MAX_UNION])
            is_moved |= known is None or known.peers != notice.peers
        if is_moved:
            self._find_ways()
        return changed

    def is_wanted(self, peer: str, type: str, source: str, origin: str) -> bool:
        """Whether an event that is here has to go to `peer`."""
        if origin == peer:
            return False
        return any(
            self._leads(origin, peer, notice.name) and any(p.matches(type, source) for p in notice.interest)
            for notice in self._notices.values()
            if notice.name not in (self.name, origin)
        )

    def _leads(self, origin: str, peer: str, target: str) -> bool:
        """Whether a shortest way from `origin` to `target` goes from here on to `peer`."""
        rest = 1 + self._distances(peer).get(target, _FAR)
        if origin == self.name or origin not in self._near:
            return rest == self._near.get(target, _FAR)
        return self._near[origin] + rest == self._distances(origin).get(target, _FAR)

    def _distances(self, channel: str) -> dict[str, int]:
        """How many links away from one channel the others are."""
        import networkx as nx  # here: every client of a channel loads this module, and would wait 0.2 s for it

        if channel not in self._ways:
            known = channel in self._graph
            self._ways[channel] = nx.single_source_shortest_path_length(self._graph, channel) if known else {}
        return self._ways[channel]

    def _find_ways(self) -> None:
        """Shortest ways over the links that both ends tell of; an end that tells nothing yet is believed."""
        import networkx as nx

        graph: nx.Graph[str] = nx.Graph()
        graph.add_node(self.name)
        for notice in self._notices.values():
            for peer in notice.peers:
                other = self._notices.get(peer)
                if other is None or notice.name in other.peers:
                    graph.add_edge(notice.name, peer)
        self._graph = graph
        self._ways: dict[str, dict[str, int]] = {}
        self._near = self._distances(self.name)


def _next_version(before: Notice | None) -> int:
    """By the clock, so that a channel that lost its state is believed again."""
    return max(before.version + 1 if before else 0, _clock())


def _clock() -> int:
    """Microseconds since 1970."""
    return time.time_ns() // 1000
