"""Time limits of long work in the map editor: its client stops waiting some time, and does not say so."""

from __future__ import annotations

import time
from collections.abc import Callable

from robocorba.errors.maps import TooSlow

#: Maximum time for a topological map or a check [s]. Our clients wait for 60 s, of which a call may wait for 8 s for
#: others; so they receive the error.
WORK_LIMIT_S = 50.0


class TimeLimit:
    """A time limit for `what`, such as "the topological map of L1", from now on [s]."""

    def __init__(self, what: str, limit_s: float = WORK_LIMIT_S, clock: Callable[[], float] = time.monotonic) -> None:
        self._what, self._limit_s, self._clock = what, limit_s, clock
        self._deadline = clock() + limit_s

    def check(self) -> None:
        """Raise TooSlow after the limit."""
        if self._clock() > self._deadline:
            raise TooSlow(self._what, self._limit_s)


def no_limit() -> None:
    """The check where there is no limit."""
