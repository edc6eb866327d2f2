"""The time of leases: it stands still while the server itself is held up."""

from __future__ import annotations

import time
from collections.abc import Callable

#: Longest pause between two calls of `attend` that counts [s]; the simulation thread calls it every 0.02 s.
LONGEST_PAUSE_S = 0.2


class AttendedTime:
    """Clock [s] of a server that calls `attend` again and again while it works. Thread-safe.

    A server that was held up for seconds, by a debugger or a busy machine, has not read what its clients sent
    meanwhile: of such a pause only LONGEST_PAUSE_S counts, so that no lease expires in it.
    clock: the time that passes in any case [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        #: When `attend` was last called, and the time that does not count until then; one object, replaced as a whole.
        self._attended = (clock(), 0.0)

    def __call__(self) -> float:
        attended_at, held_up_s = self._attended
        return min(self._clock(), attended_at + LONGEST_PAUSE_S) - held_up_s

    def attend(self) -> None:
        """The server works; one thread only calls this."""
        now = self._clock()
        attended_at, held_up_s = self._attended
        self._attended = (now, held_up_s + max(0.0, now - attended_at - LONGEST_PAUSE_S))
