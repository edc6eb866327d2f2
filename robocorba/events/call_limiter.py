"""How many threads call clients at the same time.

More than a few only wait for the interpreter's lock, and each call costs twice as much.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class Turns:
    """At most `most` turns at a time; one that takes longer than `limit_s` does not count any more.

    So clients that hang hold up nobody for longer than that."""

    def __init__(self, most: int, limit_s: float) -> None:
        self._most, self._limit_s = most, limit_s
        self._free = threading.Condition(threading.Lock())
        #: When the turns began, oldest first.
        self._running: dict[object, float] = {}

    @contextlib.contextmanager
    def one(self) -> Iterator[None]:
        """Wait for a turn, and have it."""
        turn = object()
        with self._free:
            while len(self._running) >= self._most:
                oldest, began = next(iter(self._running.items()))
                left = began + self._limit_s - time.monotonic()
                if left > 0:
                    self._free.wait(left)
                else:
                    del self._running[oldest]
            self._running[turn] = time.monotonic()
        try:
            yield
        finally:
            with self._free:
                if self._running.pop(turn, None):
                    self._free.notify()
