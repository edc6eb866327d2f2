"""The clocks of missions: a robot's own, and its leader's, estimated from the timestamps of states and orders."""

from __future__ import annotations

import time
from collections import deque


class SteadyClock:
    """Time since 1970 that passes steadily, also while the system's clock is set: orders name times in the future."""

    def __init__(self) -> None:
        #: The time at which the monotonic clock was 0; None before the first use, which a fork may precede.
        self._began: float | None = None

    def synchronize(self) -> None:
        """Take the time from the system's clock; not while a mission runs."""
        self._began = time.time() - time.monotonic()

    def now(self) -> float:
        """The time [s since 1970]."""
        if self._began is None:
            self.synchronize()
        assert self._began is not None
        return self._began + time.monotonic()


#: The time of this process, by which it stamps and receives all messages of missions.
OWN_CLOCK = SteadyClock()


class LeaderClock:
    """Offset of the leader's clock from the local one [s], as in NTP: a message and its answer are assumed to take
    equally long."""

    def __init__(self) -> None:
        #: Round trip and offset of the latest exchanges; the one with the shortest round trip is used.
        self._measured: deque[tuple[float, float]] = deque(maxlen=50)

    def reset(self) -> None:
        """Discard what was measured with another leader."""
        self._measured.clear()

    def measure(self, sent: float, received: float, answered: float, answer_received: float) -> None:
        """Add an exchange: `sent` and `answer_received` by the local clock, `received` and `answered` by the
        leader's."""
        round_trip_s = (answer_received - sent) - (answered - received)
        if round_trip_s >= 0.0:
            offset_s = ((received - sent) + (answered - answer_received)) / 2.0
            self._measured.append((round_trip_s, offset_s))

    @property
    def offset_s(self) -> float:
        """To be added to the local clock; 0 before the first exchange."""
        return min(self._measured, default=(0.0, 0.0))[1]

    @property
    def round_trip_s(self) -> float:
        """The shortest round trip [s]; 0 before the first exchange."""
        return min(self._measured, default=(0.0, 0.0))[0]

    def now(self) -> float:
        """The leader's time [s since 1970]."""
        return OWN_CLOCK.now() + self.offset_s
