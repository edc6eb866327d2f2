"""Events that have come before an earlier one of their origin, which may still be on its way by another route."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Iterator
from typing import NamedTuple

from robocorba.events.account import Account
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import life_of
from robocorba.events.policies import ChannelPolicy


class Arrival(NamedTuple):
    """A batch that waits. before: number of the event that has to come before it. since: when it came
    [s, time.monotonic]. account: of the link by which it came."""

    batch: EventBatch
    before: int
    since: float
    account: Account


class Resequencer:
    """Guarded by the channel's lock. has_seen: whether an event of an origin was delivered to this channel."""

    def __init__(self, has_seen: Callable[[str, int], bool], policy: ChannelPolicy) -> None:
        self._has_seen, self._policy = has_seen, policy
        #: In order, by stream: the events of an origin in one life.
        self._held: dict[tuple[str, int], list[Arrival]] = {}
        self._length = 0

    def add(self, arrival: Arrival) -> Iterator[Arrival]:
        """What can be delivered now, in order. Each must be delivered before the next one is asked for."""
        stream = arrival.batch.header.origin, life_of(arrival.batch.first)
        if stream not in self._held and self._is_next(arrival):  # as nearly always
            yield arrival
            return
        insort(self._held.setdefault(stream, []), arrival, key=lambda each: each.batch.first)
        self._count(arrival, len(arrival.batch))
        yield from self._next(stream)

    def overdue(self, now: float) -> Iterator[Arrival]:
        """What has waited for too long at `now` [s, time.monotonic], and what comes before and next; as by `add`."""
        for stream, held in list(self._held.items()):
            late = [index for index, arrival in enumerate(held) if arrival.since <= now - self._policy.max_held_s]
            for _ in range(late[-1] + 1 if late else 0):
                yield self._take(stream)
            yield from self._next(stream)

    def _next(self, stream: tuple[str, int]) -> Iterator[Arrival]:
        while (held := self._held.get(stream)) and (self._length > self._policy.max_held or self._is_next(held[0])):
            yield self._take(stream)

    def _is_next(self, arrival: Arrival) -> bool:
        origin = arrival.batch.header.origin
        return (
            not arrival.before
            or self._has_seen(origin, arrival.before)
            or self._has_seen(origin, arrival.batch.last)  # comes again
        )

    def _take(self, stream: tuple[str, int]) -> Arrival:
        held = self._held[stream]
        arrival = held.pop(0)
        if not held:
            del self._held[stream]
        self._count(arrival, -len(arrival.batch))
        return arrival

    def _count(self, arrival: Arrival, events: int) -> None:
        self._length += events
        arrival.account.received += events
        arrival.account.queued += events
