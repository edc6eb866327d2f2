"""How long consumers that hardly take events may hold up the suppliers of a channel.

The policy BLOCK_SUPPLIER slows suppliers down to the pace of a consumer. One that takes events steadily may do so for
as long as it likes. All the others of a channel together have some time for it, which returns slowly; when it is used
up nobody waits for them, and their queues discard events instead."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

#: Time for which all of them may hold suppliers up, and in which that time returns [s].
BUDGET_S, RETURNS_IN_S = 10.0, 60.0
#: A consumer that takes an event within this time is steady [s].
STEADY_S = 0.1

_log = logging.getLogger(__name__)


class BlockingBudget:
    """Of a channel. Not thread-safe: the owner locks. clock: [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left_s, self._at = BUDGET_S, clock()
        self._is_reported = False

    def left_s(self) -> float:
        """The time that is left [s], below 0 if more than all was used."""
        now = self._clock()
        self._left_s = min(BUDGET_S, self._left_s + (now - self._at) * BUDGET_S / RETURNS_IN_S)
        self._at = now
        if self._left_s == BUDGET_S:
            self._is_reported = False
        return self._left_s

    def spend(self, seconds: float, consumer: str) -> None:
        """A supplier has waited this much longer for a consumer than for a steady one [s]."""
        left_s = self.left_s()
        self._left_s -= seconds
        if left_s > 0.0 >= self._left_s and not self._is_reported:
            self._is_reported = True
            _log.warning(
                "consumer %s and others have held up suppliers for %g s; until they keep up events are discarded for "
                "them, see the accounts",
                consumer,
                BUDGET_S,
            )
