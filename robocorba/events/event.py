"""Events as a channel handles them: a header, and batches of consecutive events that share it.

All parts of a channel handle an `EventBatch`, never a single event: the events of one call, or consecutive events
of a queue. A batch of a hundred events costs little more than a batch of one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from functools import lru_cache
from typing import Any, NamedTuple

from robocorba.errors.events import EventTooLarge, InvalidEvent

#: Maximum length of an event type and of a source [characters].
MAX_NAME = 200
#: Maximum size of a payload [bytes]. Larger data belong in a file or a stream: they would delay all events behind them.
MAX_PAYLOAD_BYTES = 8 * 2**20
#: Maximum of an expiry, and of a time since 1970 [s]. Float arithmetic stays exact enough up to here.
MAX_SECONDS = 1e11


class Encoding(IntEnum):
    """Encoding of a payload. NATIVE: the unmodified `any` of a plain client (one that supports OMG's interfaces only),
    which the channel does not read; its length is the number of bytes of its encoding."""

    MSGPACK = 0
    CDR_ANY = 1
    NATIVE = 2


class EventHeader(NamedTuple):
    """What the events of a batch share. origin: the channel that received them from a supplier. expiry: seconds after
    each event's time, 0 for never."""

    type: str
    source: str
    origin: str = ""
    priority: int = 0
    expiry: float = 0.0
    encoding: Encoding = Encoding.MSGPACK


@lru_cache(4096)
def checked_header(type: str, source: str, priority: int, expiry: float, encoding: Encoding) -> EventHeader:
    """The header of events from a client, without origin. Raises InvalidEvent."""
    if not type:
        raise InvalidEvent("type", "is empty")
    for field, text in (("type", type), ("source", source)):
        if len(text) > MAX_NAME:
            raise InvalidEvent(field, f"has {len(text)} characters; at most {MAX_NAME} are allowed")
        if "\0" in text or "\N{REPLACEMENT CHARACTER}" in text:
            raise InvalidEvent(field, "has NUL, or bytes that are not UTF-8")
    if not 0 <= expiry <= MAX_SECONDS:
        raise InvalidEvent("expiry", f"{expiry} is not between 0 and {MAX_SECONDS:g} seconds")
    return EventHeader(type, source, "", priority, expiry, encoding)


class EventBatch:
    """Consecutive events that share a header, numbered from `first` on. It is an EventRun of the IDL, whose "batch", a
    sequence of runs, is a packet in feed.py. `times` (s since 1970) and `payloads` have one entry for each event.

    via: the id of the foreign channel's proxy by which they came, empty for others. epoch: when the monotonic clock was
    0, by the clock that stamped them [s since 1970]; it is that of the system of their origin. Only the monotonic clock
    decides how old they are: other clocks may be set meanwhile, and need not agree."""

    __slots__ = ("cached", "epoch", "first", "header", "hops", "payloads", "targets", "times", "via")

    def __init__(
        self,
        header: EventHeader,
        times: Sequence[float],
        payloads: Sequence[Any],
        first: int = 0,
        via: str = "",
        epoch: float = 0.0,
    ) -> None:
        self.header, self.times, self.payloads, self.first, self.via = header, times, payloads, first, via
        self.epoch = epoch
        #: The channels that this copy must still reach, and for each the number of the event before the first one that
        #: its origin has sent there, 0 if there is none. None for events that are not on their way between channels.
        self.targets: dict[str, int] | None = None
        #: Number of links that this copy has crossed.
        self.hops = 0
        #: The EventRun struct of this batch, cached because several consumers receive the same one.
        self.cached: Any = None

    def __len__(self) -> int:
        return len(self.payloads)

    def __repr__(self) -> str:
        return f"EventBatch({self.header.type!r} from {self.header.origin!r}, {self.first} to {self.last})"

    @property
    def priority(self) -> int:
        return self.header.priority

    @property
    def since(self) -> float:
        """When the first event was made [s, time.monotonic]."""
        return self.times[0] - self.epoch

    @property
    def last(self) -> int:
        """The number of the last event."""
        return self.first + len(self.payloads) - 1

    @property
    def size(self) -> int:
        """Approximate size of header and payloads [bytes]."""
        header, payloads = self.header, sum(map(len, self.payloads))
        return 64 + len(header.type) + len(header.source) + len(header.origin) + payloads + 12 * len(self.payloads)

    def part(self, start: int, stop: int | None = None) -> EventBatch:
        """The events with indices from `start` to before `stop`."""
        times, payloads = self.times[start:stop], self.payloads[start:stop]
        part = EventBatch(self.header, times, payloads, self.first + start, self.via, self.epoch)
        if self.targets is not None:
            part.hops = self.hops
            part.targets = dict.fromkeys(self.targets, part.first - 1) if start else self.targets
        return part

    def toward(self, targets: dict[str, int]) -> EventBatch:
        """A copy for these channels; see `targets`."""
        copy = EventBatch(self.header, self.times, self.payloads, self.first, epoch=self.epoch)
        copy.targets, copy.hops, copy.cached = targets, self.hops, self.cached
        return copy

    def unexpired(self, now: float) -> EventBatch | None:
        """The events that have not expired at `now` (s since `epoch`), None if all have.

        The numbers of a batch are contiguous: in a numbered batch, expired events between unexpired ones stay."""
        expiry = self.header.expiry
        now += self.epoch
        if not expiry or all(time + expiry > now for time in self.times):
            return self
        keep = [index for index, time in enumerate(self.times) if time + expiry > now]
        if not keep:
            return None
        if self.first:
            return self.part(keep[0], keep[-1] + 1)
        times, payloads = [self.times[index] for index in keep], [self.payloads[index] for index in keep]
        return EventBatch(self.header, times, payloads, via=self.via, epoch=self.epoch)


class CorrelatedEvents:
    """Events that match the conjunction with index `clause_number` of a subscription. batches: one event each, in the
    order of its patterns."""

    __slots__ = ("batches", "clause_number")

    def __init__(self, clause_number: int, batches: Sequence[EventBatch]) -> None:
        self.clause_number, self.batches = clause_number, tuple(batches)

    def __len__(self) -> int:
        return len(self.batches)

    @property
    def priority(self) -> int:
        return max(batch.priority for batch in self.batches)

    @property
    def size(self) -> int:
        return sum(batch.size for batch in self.batches)

    def unexpired(self, now: float) -> CorrelatedEvents | None:
        """Itself, or None if one of the events has expired."""
        return self if all(batch.unexpired(now) for batch in self.batches) else None


def check(batch: EventBatch) -> None:
    """Check times and payloads; `checked_header` checks the header. Raises InvalidEvent."""
    if len(batch.times) != len(batch.payloads):
        raise InvalidEvent("times", f"has {len(batch.times)} entries for {len(batch.payloads)} payloads")
    for time in batch.times:
        if not -MAX_SECONDS <= time <= MAX_SECONDS:  # also refuses NaN
            raise InvalidEvent("time", "is not a number" if math.isnan(time) else f"{time} is out of range")
    for payload in batch.payloads:
        if len(payload) > MAX_PAYLOAD_BYTES:
            raise EventTooLarge(len(payload), MAX_PAYLOAD_BYTES)


def merged(batches: Iterable[EventBatch]) -> list[EventBatch]:
    """The same events in the same order, in as few batches as possible."""
    groups: list[list[EventBatch]] = []
    expected = 0
    for batch in batches:
        before = groups[-1][0] if groups and batch.first == expected else None
        if (
            before
            and batch.header == before.header
            and batch.via == before.via
            and batch.epoch == before.epoch
            and _have_one_way(before, batch)
        ):
            groups[-1].append(batch)
        else:
            groups.append([batch])
        expected = batch.first + len(batch.payloads)
    return [_joined(group) if len(group) > 1 else group[0] for group in groups]


def _have_one_way(before: EventBatch, batch: EventBatch) -> bool:
    """Whether a batch is for the channels of the one before it, and each of them gets it next."""
    if before.targets is None or batch.targets is None:
        return before.targets is batch.targets
    is_same = before.hops == batch.hops and before.targets.keys() == batch.targets.keys()
    return is_same and all(number == batch.first - 1 for number in batch.targets.values())


def _joined(group: list[EventBatch]) -> EventBatch:
    times = [time for batch in group for time in batch.times]
    payloads = [payload for batch in group for payload in batch.payloads]
    joined = EventBatch(group[0].header, times, payloads, group[0].first, group[0].via, group[0].epoch)
    joined.targets, joined.hops = group[0].targets, group[0].hops
    return joined
