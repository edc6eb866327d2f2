"""The queue in front of a consumer or a peer: bounded, first in first out, with a rule for when it is full."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from typing import NamedTuple, TypeAlias

from robocorba.errors.events import InvalidQueue
from robocorba.events.event import Run, Together

Item: TypeAlias = Run | Together

MAX_SIZE = 1_000_000
MAX_BLOCK_S = 10.0


class OverflowRule(Enum):
    """What happens to events that find the queue full. Those of the lowest priority in it go first, whichever rule."""

    DISCARD_OLDEST = 0
    DISCARD_NEWEST = 1
    BLOCK_SUPPLIER = 2


class QueuePolicy(NamedTuple):
    """size: events that may wait; block_limit: longest time in s that a supplier waits for room."""

    size: int = 10_000
    when_full: OverflowRule = OverflowRule.DISCARD_OLDEST
    block_limit: float = 0.0

    def checked(self) -> QueuePolicy:
        """Itself. Raises InvalidQueue."""
        if not 1 <= self.size <= MAX_SIZE:
            raise InvalidQueue("size", f"{self.size} is not between 1 and {MAX_SIZE}")
        if not (math.isfinite(self.block_limit) and 0 <= self.block_limit <= MAX_BLOCK_S):
            raise InvalidQueue("blockLimit", f"{self.block_limit} is not between 0 and {MAX_BLOCK_S:g} seconds")
        return self


class EventQueue:
    """Runs and conjunctions that wait. Not locked: its owner does that.

    `len`, or `length`, counts events. Items of each priority wait in a lane of their own, and each carries its turn:
    taking follows the turns, discarding starts with the lane of the lowest priority.
    """

    def __init__(self, policy: QueuePolicy) -> None:
        self.policy = policy
        self._lanes: dict[int, deque[tuple[int, Item]]] = {}
        self.length = 0
        self._next_turn = self._first_turn = 0

    def __len__(self) -> int:
        return self.length

    @property
    def room(self) -> int:
        """Events that it takes without discarding any."""
        return self.policy.size - self.length

    def put(self, item: Item) -> int:
        """Append; how many events were discarded for it, perhaps of its own."""
        self._lane(item.priority).append((self._next_turn, item))
        self._next_turn += 1
        self.length += len(item)
        return self._trim(self.policy.when_full is OverflowRule.DISCARD_OLDEST) if self.room < 0 else 0

    def put_back(self, items: list[Item]) -> int:
        """Put what was taken last before everything else again; how many events were discarded for it."""
        for item in reversed(items):
            self._first_turn -= 1
            self._lane(item.priority).appendleft((self._first_turn, item))
            self.length += len(item)
        return self._trim(self.policy.when_full is OverflowRule.DISCARD_OLDEST) if self.room < 0 else 0

    def take(self, most: int, now: float, most_bytes: int = 2**62) -> tuple[list[Item], int]:
        """The next events, at least one item where there is one, at most `most` events and about `most_bytes`;
        and how many were dropped on the way because they had expired at `now`.

        A conjunction comes alone."""
        taken: list[Item] = []
        events = size = expired = 0
        while self.length and events < most and size < most_bytes:
            lane = self._first_lane()
            turn, item = lane[0]
            if isinstance(item, Together) and taken:
                break
            alive = item.fresh(now)
            if alive is not item:
                expired += len(item) - (len(alive) if alive else 0)
            if isinstance(alive, Run) and len(alive) > most - events:
                rest = alive.part(most - events)
                lane[0] = (turn, rest)
                alive = alive.part(0, most - events)
                self.length -= len(item) - len(rest)
            else:
                lane.popleft()
                self.length -= len(item)
            if alive:
                taken.append(alive)
                events += len(alive)
                size += alive.size if most_bytes < 2**62 else 0
                if isinstance(alive, Together):
                    break
        return taken, expired

    def oldest_time(self) -> float | None:
        """The time of the event that is next, None where none waits."""
        if not self.length:
            return None
        item = self._first_lane()[0][1]
        return item.times[0] if isinstance(item, Run) else item.runs[0].times[0]

    def resize(self, policy: QueuePolicy) -> int:
        """Follow another policy from now on; how many events were discarded."""
        self.policy = policy
        return self._trim(policy.when_full is OverflowRule.DISCARD_OLDEST) if self.room < 0 else 0

    def clear(self) -> int:
        """Drop all; how many events there were."""
        dropped, self.length = self.length, 0
        self._lanes.clear()
        return dropped

    def _lane(self, priority: int) -> deque[tuple[int, Item]]:
        lane = self._lanes.get(priority)
        if lane is None:
            lane = self._lanes[priority] = deque()
        return lane

    def _first_lane(self) -> deque[tuple[int, Item]]:
        if len(self._lanes) == 1:
            (lane,) = self._lanes.values()
            if lane:
                return lane
        self._drop_empty_lanes()
        return min(self._lanes.values(), key=lambda lane: lane[0][0])

    def _drop_empty_lanes(self) -> None:
        for priority in [priority for priority, lane in self._lanes.items() if not lane]:
            del self._lanes[priority]

    def _trim(self, oldest: bool) -> int:
        before = self.length
        while (excess := -self.room) > 0:
            self._drop_empty_lanes()
            lane = self._lanes[min(self._lanes)]
            turn, item = lane[0] if oldest else lane[-1]
            if isinstance(item, Run) and len(item) > excess:
                kept = item.part(excess) if oldest else item.part(0, len(item) - excess)
                lane[0 if oldest else -1] = (turn, kept)
                self.length -= excess
            else:
                lane.popleft() if oldest else lane.pop()
                self.length -= len(item)
        return before - self.length
