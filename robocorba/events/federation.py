"""The federation as one channel knows it: its channels, their links and their interest (the union of subscriptions).

Each channel advertises its peers, those of them that its events do not reach at present, and its interest, and passes
the advertisements of others on (link-state routing). Each copy of an event names the channels that it must reach; for
each of these a channel knows the peer that is next on the shortest path. A link that is down is used only where there
is no other way: there the events wait.

A version counts the changes of an advertisement, and names the life of its channel (see event_numbers.py). A channel
supersedes what others remember of its earlier lives. An earlier life that supersedes it in turn, again and again, is
another channel of the same name: a conflict, during which the links of both are down.
"""

from __future__ import annotations

import functools
import heapq
import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.events import InvalidPeer
from robocorba.events.subscription import MAX_UNION, Pattern

#: Maximum number of channels in a federation. Where two that were joined have more, each channel goes on with the
#: nearest ones.
MAX_CHANNELS = 256
#: The bits of a version that name the life.
LIFE_BITS = 32
#: Maximum length of a channel's name [characters].
MAX_NAME = 60


class Advertisement(NamedTuple):
    """A link-state advertisement of channel `name` (a LinkNotice of the IDL): its peers, its interest, and the peers
    that its events do not reach at present. The higher version is the newer one; its upper bits count changes, its
    lower ones name the channel's life."""

    name: str
    version: int
    peers: tuple[str, ...]
    interest: tuple[Pattern, ...]
    down: tuple[str, ...] = ()

    @property
    def life(self) -> int:
        return self.version & ((1 << LIFE_BITS) - 1)

    def reaches(self, channel: str) -> bool:
        """Whether `channel` gets what this one sends without another one between."""
        return channel == self.name or (channel in self.peers and channel not in self.down)


@dataclass(slots=True)
class _Rivalry:
    """Lives of one channel that supersede each other. lives: those that were superseded. returns: how often one of them
    has come back. last_at: when it did so last [s, time.monotonic]. peers: of the two latest advertisements.

    Where parts of a federation that were separated remember different lives of one channel, a life comes back a few
    times; four times are of two channels."""

    lives: set[int]
    returns: int = 0
    last_at: float = 0.0
    peers: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    @property
    def is_over(self) -> bool:
        return time.monotonic() - self.last_at > 10.0  # s; a conflict shows itself once a second

    @property
    def is_conflict(self) -> bool:
        return self.returns >= 4 and not self.is_over

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
    return len(text) <= MAX_NAME and _has_valid_characters(text)


@functools.lru_cache(maxsize=4 * MAX_CHANNELS)
def _has_valid_characters(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", text) is not None


class KnownAdvertisements:
    """Which advertisements both ends of a session have, so that a renewal carries only new ones."""

    def __init__(self) -> None:
        self._versions: dict[str, int] = {}
        #: The last sequence of which the other end had everything: most renewals compare nothing else.
        self._complete: Sequence[Advertisement] | None = None

    def missing(self, advertisements: Sequence[Advertisement]) -> list[Advertisement]:
        """Those that the other end neither has nor has sent. The sequence must not be changed afterwards."""
        if advertisements is self._complete:
            return []
        missing = [entry for entry in advertisements if self._versions.get(entry.name, 0) < entry.version]
        if not missing:
            self._complete = advertisements
        return missing

    def add(self, advertisements: Iterable[Advertisement]) -> None:
        """The other end has received these, or has sent them."""
        self._versions.update((entry.name, entry.version) for entry in advertisements)


class Federation:
    """Advertisements by channel name, and the shortest paths between channels. Guarded by the channel's lock.

    name, life: of the channel that this federation is seen from. known: stored advertisements of an earlier process."""

    def __init__(
        self, name: str, known: Iterable[Advertisement] = (), life: int = 1, max_channels: int = MAX_CHANNELS
    ) -> None:
        self.name, self._life = name, life
        #: The peer by which each reachable channel is reached, as ordered by their distance; itself by "".
        self.next_peers: dict[str, str] = {}
        #: The peer by which each channel is reached that is one too many: no events go there.
        self.left_out: dict[str, str] = {}
        self._max_channels = max_channels
        #: Includes channels that are unreachable now. They are ignored, but kept: nobody would send them again.
        self._advertisements = {entry.name: entry for entry in known}
        own = self._advertisements.get(name)
        own = own or Advertisement(name, 0, (), ())
        self._advertisements[name] = own._replace(version=self._version_above(own.version))
        #: What `advertisements` returns, None after a change.
        self._listed: list[Advertisement] | None = None
        self._rivalries: dict[str, _Rivalry] = {}
        #: An advertisement of this channel's name that has superseded its own, None if there is none.
        self._superseding: Advertisement | None = None
        self._find_paths()

    @property
    def own(self) -> Advertisement:
        return self._advertisements[self.name]

    @property
    def advertisements(self) -> list[Advertisement]:
        """Of the reachable channels: its own first, then the others by name. The same list until one changes."""
        if self._listed is None:
            reachable = (entry for entry in self._advertisements.values() if entry.name in self.next_peers)
            self._listed = sorted(reachable, key=lambda entry: (entry.name != self.name, entry.name))
        return self._listed

    def interest_of(self, channel: str) -> tuple[Pattern, ...]:
        """The interest that a channel advertises; empty for an unknown channel."""
        entry = self._advertisements.get(channel)
        return entry.interest if entry else ()

    def advertise(self, peers: Iterable[str], interest: tuple[Pattern, ...], down: Iterable[str] = ()) -> bool:
        """Set this channel's own advertisement; whether it changed. down: the peers that its events do not reach."""
        before = self.own
        own = before._replace(peers=tuple(sorted(peers)), interest=interest, down=tuple(sorted(down)))
        if own == before:
            return False
        self._advertisements[self.name] = own._replace(version=self._version_above(before.version))
        self._listed = None
        if (own.peers, own.down) != (before.peers, before.down):
            self._find_paths()
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
            if known is None and len(self._advertisements) >= 2 * self._max_channels:
                reachable = self.next_peers.keys() | self.left_out.keys()
                self._advertisements = {name: kept for name, kept in self._advertisements.items() if name in reachable}
                if len(self._advertisements) >= 2 * self._max_channels:
                    continue
            self._advertisements[entry.name] = entry._replace(interest=entry.interest[:MAX_UNION])
            self._listed = None
            links_changed |= known is None or (known.peers, known.down) != (entry.peers, entry.down)
        if links_changed:
            self._find_paths()
        return self._reassert() or changed

    def excess(self, peer: str) -> str:
        """Which channels that `peer` leads to are too many; empty if none is."""
        names = sorted(name for name, first in self.left_out.items() if first == peer)
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"without {', '.join(names[:3])}{more}: the maximum is {self._max_channels} channels" if names else ""

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
        """Supersede it: at once, and during a conflict once a second. Whether the own advertisement has changed."""
        entry, rivalry = self._superseding, self._rivalries.get(self.name)
        if entry is None:
            return False
        if rivalry and rivalry.is_conflict and time.monotonic() - rivalry.last_at < 1.0:
            return False
        own = self._advertisements[self.name] = self.own._replace(version=self._version_above(entry.version))
        self._listed = self._superseding = None
        if entry.life != self._life:
            self._note_life(entry, own)
        return True

    def _note_life(self, before: Advertisement, after: Advertisement) -> None:
        """Note that an advertisement of another life supersedes one."""
        rivalry = self._rivalries.get(after.name)
        if rivalry is None or rivalry.is_over:
            if len(self._rivalries) >= self._max_channels:
                self._rivalries.clear()
            rivalry = self._rivalries[after.name] = _Rivalry(set())
        rivalry.lives.add(before.life)
        rivalry.returns += after.life in rivalry.lives
        rivalry.last_at, rivalry.peers = time.monotonic(), (before.peers, after.peers)

    def _version_above(self, version: int) -> int:
        """The next version after `version` that names this life."""
        return (((version >> LIFE_BITS) + 1) << LIFE_BITS) | self._life

    def ways(self, type: str, source: str, origin: str) -> dict[str, list[str]]:
        """The reachable channels that want an event of another one, by the peer that is next on the way to them."""
        result: dict[str, list[str]] = {}
        for name, peer in self.next_peers.items():
            entry = self._advertisements.get(name)
            if peer and entry and name != origin and any(p.matches(type, source) for p in entry.interest):
                result.setdefault(peer, []).append(name)
        return result

    def _find_paths(self) -> None:
        """Dijkstra's algorithm. Links count that both ends advertise, and those to channels without an advertisement
        yet. Of paths of the same length every channel takes the one by the peer that is first by its name, so that the
        path to a channel is part of all paths that lead through it."""
        known = self._advertisements
        peers = {name: frozenset(entry.peers) for name, entry in known.items()}
        self.next_peers, self.left_out = {}, {}
        #: Length of the path, its next peer, and the channel at its end; the shortest one that has been found to each.
        ends = [(0, "", self.name)]
        best = {self.name: (0, "")}
        while ends:
            length, first, name = heapq.heappop(ends)
            if name in self.next_peers or name in self.left_out:
                continue
            is_one_too_many = len(self.next_peers) >= self._max_channels
            (self.left_out if is_one_too_many else self.next_peers)[name] = first
            entry = known.get(name)
            for peer in entry.peers if entry else [other for other in known if name in peers[other]]:
                is_down = entry is not None and peer in entry.down
                # A link that is down is longer than any path of links that are up.
                path = (length + (MAX_CHANNELS if is_down else 1), first or peer)
                is_shorter = peer not in best or path < best[peer]
                if is_shorter and name in peers.get(peer, (name,)):
                    best[peer] = path
                    heapq.heappush(ends, (*path, peer))
