"""The monotonic clock of a peer, by which this channel knows how old the peer's events are. The clocks of the two
systems need not agree, and may be set."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

#: Number of latest exchanges kept: those of half a minute at most. The one with the shortest round trip is used;
#: monotonic clocks of two machines drift apart by some 3 ms in this time.
MAX_EXCHANGES = 30
#: Differences below this are uncertainties of the measurement [s]. A steady offset keeps the intervals between events
#: as they were stamped.
STEADY_S = 0.01


class Exchange(NamedTuple):
    """A call of the peer: when it was sent and when the answer came, by the local monotonic clock [s], and the peer's
    clock meanwhile [s]."""

    sent: float
    there: float
    received: float


class PeerClock:
    """behind_s: what the peer's monotonic clock shows less than the local one [s]; 0 before the first exchange."""

    def __init__(self) -> None:
        self.behind_s = 0.0
        #: Round trip, and `behind_s` by this exchange.
        self._measured: deque[tuple[float, float]] = deque(maxlen=MAX_EXCHANGES)

    def measure(self, exchange: Exchange) -> None:
        sent, there, received = exchange
        self._measured.append((received - sent, (sent + received) / 2.0 - there))
        measured = min(self._measured)[1]
        if len(self._measured) == 1 or abs(measured - self.behind_s) > STEADY_S:
            self.behind_s = measured

    @property
    def round_trip_s(self) -> float:
        """The shortest round trip of the latest exchanges [s]; 0 before the first one."""
        return min(self._measured)[0] if self._measured else 0.0

    def reset(self) -> None:
        """The peer's process may be another one, on another machine."""
        self._measured.clear()
