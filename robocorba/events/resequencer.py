"""Events that have come before an earlier one of their origin, which may still be on its way by another route."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Iterator
from typing import NamedTuple

from robocorba.events.account import Arrivals
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import life_of

#: Maximum time that an event waits for earlier ones [s]. These may be on their way by a link that has just been cut:
#: the channel before it notices that after 5 s at most (LinkPolicy.silence_s), and sends them by another way. What a
#: killed channel held never comes.
MAX_WAIT_S = 6.0
#: Maximum number of events that wait. Beyond that the missing ones are not waited for.
MAX_HELD = 10_000


class Arrival(NamedTuple):
    """A batch that waits. before: number of the event that has to come before it. since: when it came
    [s, time.monotonic]. account: of the link by which it came."""

    batch: EventBatch
    before: int
    since: float
    account: Arrivals


def _first(arrival: Arrival) -> int:
    return arrival.batch.first


def stream_of(batch: EventBatch) -> tuple[str, int]:
    """The events of which these are a part: those of an origin in one life."""
    return batch.header.origin, life_of(batch.first)


class Resequencer:
    """Guarded by the channel's lock. has_seen: whether an event of an origin was delivered to this channel."""

    def __init__(self, has_seen: Callable[[str, int], bool]) -> None:
        self._has_seen = has_seen
        #: By stream, in order.
        self._held: dict[tuple[str, int], list[Arrival]] = {}
        self._length = 0

    def add(self, arrival: Arrival) -> Iterator[Arrival]:
        """What can be delivered now, in order. Each must be delivered before the next one is asked for."""
        stream = stream_of(arrival.batch)
        if stream not in self._held and self._is_next(arrival):  # as nearly always
            yield arrival
            return
        insort(self._held.setdefault(stream, []), arrival, key=_first)
        self._length += len(arrival.batch)
        arrival.account.held += len(arrival.batch)
        yield from self._next(stream)

    def overdue(self, now: float) -> Iterator[Arrival]:
        """What has waited for too long at `now` [s, time.monotonic], and what comes before and next; as by `add`."""
        for stream, held in list(self._held.items()):
            late = [index for index, arrival in enumerate(held) if arrival.since <= now - MAX_WAIT_S]
            for _ in range(late[-1] + 1 if late else 0):
                yield self._take(stream)
            yield from self._next(stream)

    def _next(self, stream: tuple[str, int]) -> Iterator[Arrival]:
        while (held := self._held.get(stream)) and (self._length > MAX_HELD or self._is_next(held[0])):
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
        self._length -= len(arrival.batch)
        arrival.account.held -= len(arrival.batch)
        return arrival
