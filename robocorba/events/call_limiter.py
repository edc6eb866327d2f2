"""Limits how many threads call clients at the same time.

More than a few threads only wait for the interpreter lock, and each call costs twice as much.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class CallLimiter:
    """At most `max_calls` slots are taken at a time. A slot that is held longer than `limit_s` no longer counts, so
    that clients that hang delay others by no more than that."""

    def __init__(self, max_calls: int, limit_s: float) -> None:
        self._max_calls, self._limit_s = max_calls, limit_s
        self._free = threading.Condition(threading.Lock())
        #: Held by the one thread that waits for a slot. The others wait for this lock, without a timeout: a thousand
        #: threads with one each would only wake each other.
        self._next = threading.Lock()
        #: When each slot was taken, oldest first [s, time.monotonic].
        self._running: dict[object, float] = {}

    @contextlib.contextmanager
    def slot(self) -> Iterator[None]:
        """Wait for a free slot and hold it."""
        slot = object()
        with self._next, self._free:
            while len(self._running) >= self._max_calls:
                oldest, began = next(iter(self._running.items()))
                left = began + self._limit_s - time.monotonic()
                if left > 0:
                    self._free.wait(left)
                else:
                    del self._running[oldest]
            self._running[slot] = time.monotonic()
        try:
            yield
        finally:
            with self._free:
                if self._running.pop(slot, None):
                    self._free.notify()
