"""The system's clock as events arrive: it may be set at any time, by hours and in both directions."""

from __future__ import annotations

import time
from collections.abc import Callable


class ArrivalClock:
    """What lies between the system's clock, by which suppliers stamp events, and the monotonic one, by which they wait.

    It is exactly the same for all events between two steps, so that the intervals between events stay as stamped."""

    def __init__(self, now: Callable[[], float] = lambda: time.time()) -> None:
        #: The time by the system's clock [s since 1970].
        self.now = now
        self._epoch = now() - time.monotonic()

    def epoch(self) -> float:
        """When the monotonic clock was 0, by the system's clock now [s since 1970]."""
        measured = self.now() - time.monotonic()
        if abs(measured - self._epoch) > 0.1:  # s; below are delays between two readings and slow corrections
            self._epoch = measured
        return self._epoch
