"""Admission of long requests: one at a time, so that clients which repeat what has timed out can't pile up work."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from robocorba.errors.maps import ServerBusy


class LongRequests:
    """Serves one long request at a time. Thread-safe.

    wait_limit_s: half of the 2 s after which the most impatient of our clients give up, so that they receive the
    refusal, and hardly any is served whose client has gone. max_waiting: each holds a thread."""

    def __init__(self, wait_limit_s: float = 1.0, max_waiting: int = 4) -> None:
        self._wait_limit_s = wait_limit_s
        self._serving = threading.Lock()
        self._places = threading.Semaphore(max_waiting + 1)

    @contextmanager
    def admitted(self) -> Iterator[None]:
        """Wait until no other is served. Raises ServerBusy if that takes too long, or if too many wait."""
        if not self._places.acquire(blocking=False):
            raise ServerBusy("too many long requests wait already; try again")
        try:
            if not self._serving.acquire(timeout=self._wait_limit_s):
                raise ServerBusy(f"long requests of others took more than {self._wait_limit_s:g} s; try again")
            try:
                yield
            finally:
                self._serving.release()
        finally:
            self._places.release()
