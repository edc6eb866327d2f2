"""The leader's rhythm: how far along its trajectory a body that is carried shall be, now."""

from __future__ import annotations

import threading

#: Without news from the leader the rhythm goes on for so long, then it stands still, s.
ALONE_S = 0.3


class Rhythm:
    """Follows orders: from a time on, so far along and so fast. Times are the leader's. Safe from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        #: (since, along_s, rate) in force, and what will be in force; and when the leader was heard last.
        self._now, self._next = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self._heard = 0.0

    def reset(self) -> None:
        """Another trajectory begins: what was said of the last one counts no more."""
        with self._lock:
            self._now = self._next = (0.0, 0.0, 0.0)

    def follow(self, since: float, along_s: float, rate: float, sent: float) -> None:
        """An order that was sent then."""
        with self._lock:
            self._heard = max(self._heard, sent)
            if since > self._next[0]:
                self._now, self._next = self._next, (since, along_s, rate)

    def along_s(self, now: float) -> tuple[float, float]:
        """How far along at a time, s, and how fast it goes on."""
        with self._lock:
            since, along, rate = self._next if now >= self._next[0] else self._now
            until = min(now, self._heard + ALONE_S)
            return along + rate * max(0.0, until - since), rate if now <= until else 0.0
