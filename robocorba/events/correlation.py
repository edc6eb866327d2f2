"""Conjunctions, the paper's correlation: events that match several patterns, delivered together."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from robocorba.events.event import CorrelatedEvents, EventRun
from robocorba.events.subscription import Clause


class CorrelationResult(NamedTuple):
    """Result of one event: the correlated events, if complete, and how many waiting events were dropped."""

    together: CorrelatedEvents | None
    expired: int
    discarded: int


class Correlator:
    """Collects one event for each pattern of a clause of a subscription. Each event is used once, oldest first.

    At most `limit` events wait for each pattern; beyond that the oldest is discarded. `len` counts the waiting events.
    """

    def __init__(self, clause_number: int, clause: Clause, limit: int) -> None:
        self.clause_number, self.clause, self.limit = clause_number, clause, limit
        self._window = clause.window
        self._slots: list[deque[EventRun]] = [deque() for _ in clause.patterns]

    def __len__(self) -> int:
        return sum(map(len, self._slots))

    def add(self, fitting: tuple[int, ...], event: EventRun, now: float) -> CorrelationResult:
        """Add an event (a run of one) that matches the patterns with these indices. It waits in the first empty slot
        among them, else in the first slot. `now`: s since 1970."""
        place = next((place for place in fitting if not self._slots[place]), fitting[0])
        slot = self._slots[place]
        slot.append(event)
        discarded = 0
        while len(slot) > self.limit:
            slot.popleft()
            discarded += 1
        together, expired = self._correlate(now)
        return CorrelationResult(together, expired, discarded)

    def _correlate(self, now: float) -> tuple[CorrelatedEvents | None, int]:
        expired = 0
        while True:
            for slot in self._slots:
                while slot and slot[0].unexpired(now) is None:
                    slot.popleft()
                    expired += 1
            if not all(self._slots):
                return None, expired
            heads = [slot[0] for slot in self._slots]
            times = [head.times[0] for head in heads]
            if not self._window or max(times) - min(times) <= self._window:
                for slot in self._slots:
                    slot.popleft()
                return CorrelatedEvents(self.clause_number, heads), expired
            # The oldest event cannot match any more: later events of the other patterns are even farther away in time.
            self._slots[times.index(min(times))].popleft()
            expired += 1
