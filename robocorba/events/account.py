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
