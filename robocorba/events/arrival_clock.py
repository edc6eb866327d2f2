"""The system's clock as events arrive: it may be set at any time, by hours and in both directions."""

from __future__ import annotations

import time
from collections.abc import Callable

#: Differences below this are delays between two readings and slow corrections, no steps [s].
STEP_S = 0.1


def _system_time() -> float:
    return time.time()


class ArrivalClock:
    """What lies between the system's clock, by which suppliers stamp events, and the monotonic one, by which they wait.

    It is exactly the same for all events between two steps, so that the intervals between events stay as stamped."""

    def __init__(self, now: Callable[[], float] = _system_time) -> None:
        #: The time by the system's clock [s since 1970].
        self.now = now
        self._epoch = now() - time.monotonic()

    def epoch(self) -> float:
        """When the monotonic clock was 0, by the system's clock now [s since 1970]."""
        measured = self.now() - time.monotonic()
        if abs(measured - self._epoch) > STEP_S:
            self._epoch = measured
        return self._epoch
