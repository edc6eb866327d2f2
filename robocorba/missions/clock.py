"""The leader's clock as another robot knows it: measured over the channel, with every state and order that goes."""

from __future__ import annotations

import time
from collections import deque

#: The one with the shortest way of so many last ones counts.
KEPT = 50


class LeaderClock:
    """Its difference to our own, s. Each exchange gives one: we said something at `sent`, the leader got it at `came`,
    said something at `answered`, and we got that at `back`; the ways there and back are taken for equally long."""

    def __init__(self) -> None:
        self._measured: deque[tuple[float, float]] = deque(maxlen=KEPT)

    def measure(self, sent: float, came: float, answered: float, back: float) -> None:
        """An exchange: `sent` and `back` by our clock, the others by the leader's."""
        delay = (back - sent) - (answered - came)
        if delay >= 0.0:
            self._measured.append((delay, ((came - sent) + (answered - back)) / 2.0))

    @property
    def offset_s(self) -> float:
        """To be added to our own clock; 0 before the first exchange."""
        return min(self._measured, default=(0.0, 0.0))[1]

    @property
    def delay_s(self) -> float:
        """There and back, of the shortest."""
        return min(self._measured, default=(0.0, 0.0))[0]

    def now(self) -> float:
        """The leader's time."""
        return time.time() + self.offset_s
