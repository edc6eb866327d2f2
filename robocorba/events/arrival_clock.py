"""The system's clock as events arrive: it may be set at any time, by hours and in both directions."""

from __future__ import annotations

import time

#: Differences below this are delays between two readings and slow corrections, no steps [s].
STEP_S = 0.1


class ArrivalClock:
    """What lies between the system's clock, by which suppliers stamp events, and the monotonic one, by which they wait.

    It is exactly the same for all events between two steps, so that the intervals between events stay as stamped."""

    def __init__(self) -> None:
        self._epoch = time.time() - time.monotonic()

    def epoch(self) -> float:
        """When the monotonic clock was 0, by the system's clock now [s since 1970]."""
        measured = time.time() - time.monotonic()
        if abs(measured - self._epoch) > STEP_S:
            self._epoch = measured
        return self._epoch
