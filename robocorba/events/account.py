"""Counters of the events that a proxy or a link received, delivered and lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Totals(NamedTuple):
    """Snapshot of an account: received = delivered + discarded + expired + queued, exactly.

    unconfirmed: the part of delivered without an answer. queued: waiting or in flight."""

    received: int = 0
    delivered: int = 0
    unconfirmed: int = 0
    discarded: int = 0
    expired: int = 0
    queued: int = 0


@dataclass(slots=True)
class Account:
    """Counters of events, incremented where each outcome happens."""

    received: int = 0
    delivered: int = 0
    unconfirmed: int = 0
    discarded: int = 0
    expired: int = 0

    def totals(self, queued: int) -> Totals:
        """Snapshot with `queued` events that wait or are in flight."""
        return Totals(self.received, self.delivered, self.unconfirmed, self.discarded, self.expired, queued)


@dataclass(slots=True)
class Arrivals(Account):
    """Counters of the events from a peer. repeated: those that came before, which nothing else counts. refused: of the
    discarded, those of which the channel cannot tell whether they came before, or which it could not read. held: they
    wait for earlier ones."""

    repeated: int = 0
    refused: int = 0
    held: int = 0

    def snapshot(self) -> Totals:
        return Totals(
            self.received + self.held, self.delivered, self.unconfirmed, self.discarded, self.expired, self.held
        )
