"""Conjunctions, the paper's correlation: events of several kinds, delivered together."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from robocorba.events.event import Run, Together
from robocorba.events.subscription import Clause


class Outcome(NamedTuple):
    """What an event led to: events that belong together, and how many of those that waited were dropped."""

    together: Together | None
    expired: int
    discarded: int


class Correlator:
    """Waits for an event of each pattern of clause number `which`; each event is used once, the oldest ones first.

    At most `limit` events wait for each pattern; then the oldest goes. `len` counts the events that wait.
    """

    def __init__(self, which: int, clause: Clause, limit: int) -> None:
        self.which, self.clause, self.limit = which, clause, limit
        self._window = clause.window
        self._slots: list[deque[Run]] = [deque() for _ in clause.patterns]

    def __len__(self) -> int:
        return sum(map(len, self._slots))

    def add(self, fitting: tuple[int, ...], event: Run, now: float) -> Outcome:
        """Take in a run of one that fits the patterns of these numbers. It waits where nothing waits yet, else at the
        first of them; times and `now` in s since 1970."""
        place = next((place for place in fitting if not self._slots[place]), fitting[0])
        slot = self._slots[place]
        slot.append(event)
        discarded = 0
        while len(slot) > self.limit:
            slot.popleft()
            discarded += 1
        together, expired = self._match(now)
        return Outcome(together, expired, discarded)

    def _match(self, now: float) -> tuple[Together | None, int]:
        expired = 0
        while True:
            for slot in self._slots:
                while slot and slot[0].fresh(now) is None:
                    slot.popleft()
                    expired += 1
            if not all(self._slots):
                return None, expired
            heads = [slot[0] for slot in self._slots]
            times = [head.times[0] for head in heads]
            if not self._window or max(times) - min(times) <= self._window:
                for slot in self._slots:
                    slot.popleft()
                return Together(self.which, heads), expired
            # The oldest can't be paired any more: whatever comes for the other patterns is later still.
            self._slots[times.index(min(times))].popleft()
            expired += 1
