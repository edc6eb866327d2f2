"""Conjunctions, the paper's correlation: events that match several patterns, delivered together."""

from __future__ import annotations

from collections import deque

from robocorba.events.account import Account
from robocorba.events.event import CorrelatedEvents, EventBatch
from robocorba.events.subscription import Clause


class Correlator:
    """Collects one event for each pattern of a clause of a subscription. Each event is used once, oldest first.

    At most `limit` events wait for each pattern; beyond that the oldest is discarded. `len` counts the waiting events.
    """

    def __init__(self, clause_number: int, clause: Clause, limit: int) -> None:
        self.clause_number, self.clause, self.limit = clause_number, clause, limit
        #: Waiting events by pattern, each a batch of one.
        self._waiting: list[deque[EventBatch]] = [deque() for _ in clause.patterns]

    def __len__(self) -> int:
        return sum(map(len, self._waiting))

    def add(
        self, pattern_numbers: tuple[int, ...], event: EventBatch, now: float, account: Account
    ) -> CorrelatedEvents | None:
        """Add an event (a batch of one) that matches these patterns; returns the correlated events if complete.

        It waits for the first of them without a waiting event, else for the first. Waiting events that are dropped are
        counted in `account`. now: s, time.monotonic."""
        number = next((number for number in pattern_numbers if not self._waiting[number]), pattern_numbers[0])
        events = self._waiting[number]
        events.append(event)
        while len(events) > self.limit:
            events.popleft()
            account.discarded += 1
        while True:
            for events in self._waiting:
                while events and events[0].unexpired(now) is None:
                    events.popleft()
                    account.expired += 1
            if not all(self._waiting):
                return None
            oldest = [events[0] for events in self._waiting]
            times = [event.since for event in oldest]
            if not self.clause.window or max(times) - min(times) <= self.clause.window:
                for events in self._waiting:
                    events.popleft()
                return CorrelatedEvents(self.clause_number, oldest)
            # The oldest event cannot match any more: later events of the other patterns are even farther away in time.
            self._waiting[times.index(min(times))].popleft()
            account.expired += 1
