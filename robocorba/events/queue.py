"""The bounded queue of a consumer or a peer: first in, first out, with an overflow rule."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence
from enum import Enum
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from robocorba.errors.events import InvalidQueue
from robocorba.events.account import Account
from robocorba.events.event import CorrelatedEvents, EventBatch

QueueItem: TypeAlias = EventBatch | CorrelatedEvents

#: Maximum size of a queue [events], and maximum time that it may block a supplier [s].
MAX_SIZE, MAX_BLOCK_S = 1_000_000, 10.0


class OverflowRule(Enum):
    """What is discarded when the queue is full. Under every rule, events of the lowest priority are discarded first."""

    DISCARD_OLDEST = 0
    DISCARD_NEWEST = 1
    BLOCK_SUPPLIER = 2


class QueuePolicy(NamedTuple):
    """size: maximum number of waiting events. block_limit: longest time that a supplier waits for room [s]."""

    size: int = 10_000
    when_full: OverflowRule = OverflowRule.DISCARD_OLDEST
    block_limit: float = 0.0

    def checked(self) -> QueuePolicy:
        """Itself, if its values are in range. Raises InvalidQueue."""
        if not 1 <= self.size <= MAX_SIZE:
            raise InvalidQueue("size", f"{self.size} is not between 1 and {MAX_SIZE}")
        if not (math.isfinite(self.block_limit) and 0 <= self.block_limit <= MAX_BLOCK_S):
            raise InvalidQueue("blockLimit", f"{self.block_limit} is not between 0 and {MAX_BLOCK_S:g} seconds")
        return self


class EventQueue:
    """Waiting batches and conjunctions, whose losses are counted in `account`. Not thread-safe: the owner locks.

    `length` counts events. Each priority has a lane. Every item has a sequence number: `take` follows the
    sequence numbers, discarding starts with the lane of the lowest priority.
    """

    def __init__(self, policy: QueuePolicy, account: Account) -> None:
        self.policy, self.account = policy, account
        self._lanes: dict[int, deque[tuple[int, QueueItem]]] = {}
        self.length = 0
        self._next_sequence = self._first_sequence = 0

    def put(self, item: QueueItem) -> None:
        """Append an item; discards what exceeds the size of the queue, possibly of the item itself."""
        self._lane(item.priority).append((self._next_sequence, item))
        self._next_sequence += 1
        self.length += len(item)
        self._trim()

    def put_back(self, items: Sequence[QueueItem]) -> None:
        """Put items back at the head of the queue; discards what exceeds its size."""
        for item in reversed(items):
            self._first_sequence -= 1
            self._lane(item.priority).appendleft((self._first_sequence, item))
            self.length += len(item)
        self._trim()

    def take(self, max_events: int, now: float, max_bytes: int = 2**62) -> list[QueueItem]:
        """Remove and return the next items: at most `max_events` events and about `max_bytes`, but at least one item if
        any is left. Drops events that have expired at `now` (s, time.monotonic).

        A conjunction is returned alone."""
        taken: list[QueueItem] = []
        events = size = 0
        while self.length and events < max_events and size < max_bytes:
            lane = self._first_lane()
            sequence, item = lane[0]
            if isinstance(item, CorrelatedEvents) and taken:
                break
            alive = item.unexpired(now)
            if alive is not item:
                self.account.expired += len(item) - (len(alive) if alive else 0)
                self.note_loss(item, alive)
            if isinstance(alive, EventBatch) and len(alive) > max_events - events:
                rest = alive.part(max_events - events)
                lane[0] = (sequence, rest)
                alive = alive.part(0, max_events - events)
                self.length -= len(item) - len(rest)
            else:
                lane.popleft()
                self.length -= len(item)
            if alive:
                taken.append(alive)
                events += len(alive)
                size += alive.size if max_bytes < 2**62 else 0
                if isinstance(alive, CorrelatedEvents):
                    break
        return taken

    def note_loss(self, item: QueueItem, kept: QueueItem | None) -> None:
        """Called when events of an item have expired or are discarded. kept: what is left of it."""

    def oldest_time(self) -> float | None:
        """When the next event was made (s, time.monotonic), None if the queue is empty."""
        if not self.length:
            return None
        item = self._first_lane()[0][1]
        return (item if isinstance(item, EventBatch) else item.batches[0]).since

    def items(self) -> list[QueueItem]:
        """All items, in the order of `take`."""
        return [item for _, item in sorted(itertools.chain(*self._lanes.values()), key=itemgetter(0))]

    def resize(self, policy: QueuePolicy) -> None:
        """Change the policy; discards what exceeds the new size."""
        self.policy = policy
        self._trim()

    def clear(self) -> None:
        """Remove all events; the caller counts them."""
        self.length = 0
        self._lanes.clear()

    def discard_all(self) -> None:
        self.account.discarded += self.length
        self.clear()

    def _lane(self, priority: int) -> deque[tuple[int, QueueItem]]:
        lane = self._lanes.get(priority)
        if lane is None:
            lane = self._lanes[priority] = deque()
        return lane

    def _first_lane(self) -> deque[tuple[int, QueueItem]]:
        if len(self._lanes) == 1:
            (lane,) = self._lanes.values()
            if lane:
                return lane
        self._drop_empty_lanes()
        return min(self._lanes.values(), key=lambda lane: lane[0][0])

    def _drop_empty_lanes(self) -> None:
        for priority in [priority for priority, lane in self._lanes.items() if not lane]:
            del self._lanes[priority]

    def _trim(self) -> None:
        """Discard what exceeds the size of the queue."""
        oldest = self.policy.when_full is OverflowRule.DISCARD_OLDEST
        while (excess := self.length - self.policy.size) > 0:
            self._drop_empty_lanes()
            lane = self._lanes[min(self._lanes)]
            sequence, item = lane[0] if oldest else lane[-1]
            lost = len(item)
            if isinstance(item, EventBatch) and lost > excess:
                lost = excess
                kept = item.part(excess) if oldest else item.part(0, len(item) - excess)
                self.note_loss(item, kept)
                lane[0 if oldest else -1] = (sequence, kept)
            else:
                self.note_loss(item, None)
                lane.popleft() if oldest else lane.pop()
            self.length -= lost
            self.account.discarded += lost
