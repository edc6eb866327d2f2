"""Time in which a process works: it stands still while the process itself is held up."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

#: Longest pause between two calls of `attend` that counts [s]. The simulation thread calls it every 0.02 s.
LONGEST_PAUSE_S = 0.2


class AttendedTime:
    """Clock [s] of a process that calls `attend` again and again while it works. Thread-safe.

    A process that was held up for seconds, by a debugger or a busy machine, has not read what others sent meanwhile:
    of such a pause only `longest_pause_s` counts, so that no lease expires in it, and no call counts as hanging.
    clock: the time that passes in any case [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, longest_pause_s: float = LONGEST_PAUSE_S) -> None:
        self._clock, self._longest_pause_s = clock, longest_pause_s
        self._lock = threading.Lock()
        #: When `attend` was last called, and the time that does not count until then; one object, replaced as a whole.
        self._attended = (clock(), 0.0)

    def __call__(self) -> float:
        attended_at, held_up_s = self._attended
        return min(self._clock(), attended_at + self._longest_pause_s) - held_up_s

    def attend(self) -> None:
        """The process works."""
        with self._lock:
            now = self._clock()
            attended_at, held_up_s = self._attended
            self._attended = (now, held_up_s + max(0.0, now - attended_at - self._longest_pause_s))
