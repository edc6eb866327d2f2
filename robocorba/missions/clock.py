"""The leader's clock, estimated by another robot from the timestamps of states and orders."""

from __future__ import annotations

import time
from collections import deque

#: Number of latest exchanges kept; the one with the shortest round trip is used.
MAX_EXCHANGES = 50


class LeaderClock:
    """Offset of the leader's clock from the local one [s].

    Each exchange yields one estimate: a message sent at `sent`, received by the leader at `came`, answered at
    `answered` and received back at `back`. Both directions are assumed to take equally long."""

    def __init__(self) -> None:
        self._measured: deque[tuple[float, float]] = deque(maxlen=MAX_EXCHANGES)

    def measure(self, sent: float, came: float, answered: float, back: float) -> None:
        """Add an exchange: `sent` and `back` by the local clock, `came` and `answered` by the leader's."""
        delay = (back - sent) - (answered - came)
        if delay >= 0.0:
            self._measured.append((delay, ((came - sent) + (answered - back)) / 2.0))

    @property
    def offset_s(self) -> float:
        """To be added to the local clock; 0 before the first exchange."""
        return min(self._measured, default=(0.0, 0.0))[1]

    @property
    def delay_s(self) -> float:
        """The shortest round trip."""
        return min(self._measured, default=(0.0, 0.0))[0]

    def now(self) -> float:
        """The leader's time [s since 1970]."""
        return time.time() + self.offset_s
