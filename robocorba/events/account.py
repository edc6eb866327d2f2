"""What became of the events that a proxy or a link had to deliver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Totals(NamedTuple):
    """An account at one moment: received = delivered + discarded + expired + queued, exactly.

    unconfirmed is a part of delivered: sent, but no answer came. queued: waiting, or on its way."""

    received: int = 0
    delivered: int = 0
    unconfirmed: int = 0
    discarded: int = 0
    expired: int = 0
    queued: int = 0


@dataclass(slots=True)
class Account:
    """Counters of events, each counted where it happens."""

    received: int = 0
    delivered: int = 0
    unconfirmed: int = 0
    discarded: int = 0
    expired: int = 0

    def totals(self, queued: int) -> Totals:
        """The account with `queued` events still here."""
        return Totals(self.received, self.delivered, self.unconfirmed, self.discarded, self.expired, queued)
