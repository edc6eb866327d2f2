"""Counters of the events that a proxy or a link received, delivered and lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from robocorba.events.subscription import Pattern


@dataclass(slots=True)
class Account:
    """Counters of events, incremented where each outcome happens: received = delivered + discarded + expired + queued,
    exactly.

    unconfirmed: the part of delivered without an answer. queued: of a link, events that wait for earlier ones; in a
    snapshot all that wait or are in flight. repeated: events of a link that came before, which nothing else counts.
    refused: the part of discarded of which the channel cannot tell whether they came before, or which it could not
    read."""

    received: int = 0
    delivered: int = 0
    unconfirmed: int = 0
    discarded: int = 0
    expired: int = 0
    queued: int = 0
    repeated: int = 0
    refused: int = 0

    def snapshot(self, queued: int = 0) -> Account:
        """A copy; queued: number of events that wait or are in flight in addition."""
        return replace(self, queued=self.queued + queued)


class LinkEnd(NamedTuple):
    """One direction of a link at one moment, as its end here knows it.

    problem: why it is down, empty while it is up. joins: number of sessions since the start. interest: of the end that
    receives. lag_s: of a feed the age of the oldest queued event [s], of a gateway the latency of the last event, from
    its creation to its arrival [s]. packets, bytes: those that arrived since the start, each once. unseen: number of
    events that the peer did not want. round_trip_s: of a gateway, the shortest of its latest calls [s]. warning: what
    the link lacks although it is up."""

    problem: str
    joins: int
    totals: Account
    interest: tuple[Pattern, ...]
    lag_s: float
    packets: int = 0
    bytes: int = 0
    unseen: int = 0
    round_trip_s: float = 0.0
    warning: str = ""

    @property
    def is_up(self) -> bool:
        return not self.problem
