"""Progress of a carry: the position of the carried body on its trajectory, as the leader sets it."""

from __future__ import annotations

import threading

#: The body stops after this time without orders from the leader [s].
LEADER_TIMEOUT_S = 0.3


class CarryProgress:
    """Extrapolates the leader's orders: from `since` on, at `along_s` with `rate`. Times are the leader's.

    Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        #: (since, along_s, rate) in force, and the next one.
        self._now, self._next = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        #: When the leader sent its latest order.
        self._last_sent = 0.0

    def reset(self) -> None:
        """Discard the orders of the previous trajectory."""
        with self._lock:
            self._now = self._next = (0.0, 0.0, 0.0)

    def follow(self, since: float, along_s: float, rate: float, sent: float) -> None:
        """Take over an order that the leader sent at `sent`."""
        with self._lock:
            self._last_sent = max(self._last_sent, sent)
            if since > self._next[0]:
                self._now, self._next = self._next, (since, along_s, rate)

    def along_s(self, now: float) -> tuple[float, float]:
        """Trajectory time at `now` [s], and its rate; the rate is 0 after LEADER_TIMEOUT_S without orders."""
        with self._lock:
            since, along, rate = self._next if now >= self._next[0] else self._now
            until = min(now, self._last_sent + LEADER_TIMEOUT_S)
            return along + rate * max(0.0, until - since), rate if now <= until else 0.0
