"""Events as a channel handles them: a header, and runs of events that share one.

What passes through the parts of a channel is never a single event but a `Run`: whatever came in one
call, or waits in a row. A run of one costs little; a run of a hundred costs little more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from functools import lru_cache
from typing import Any, NamedTuple

from robocorba.errors.events import InvalidEvent

MAX_NAME = 200
#: Larger ones belong into a file or a stream; they would hold up everything behind them on a link.
MAX_PAYLOAD_BYTES = 8 * 2**20
#: A header's expiry in seconds, and a time in seconds since 1970, for which arithmetic stays exact enough.
MAX_SECONDS = 1e11


class Encoding(IntEnum):
    """What a payload is. NATIVE is the `any` of a plain client as it came: a channel passes it on unread."""

    MSGPACK = 0
    CDR_ANY = 1
    NATIVE = 2


class Header(NamedTuple):
    """What the events of a run have in common. `origin` is the channel where they came in; expiry in s after each
    event's time, 0 for never."""

    type: str
    source: str
    origin: str = ""
    priority: int = 0
    expiry: float = 0.0
    encoding: Encoding = Encoding.MSGPACK


@lru_cache(4096)
def checked_header(type: str, source: str, priority: int, expiry: float, encoding: Encoding) -> Header:
    """The header of events that a client made; its origin is not known yet. Raises InvalidEvent."""
    if not type:
        raise InvalidEvent("type", "is empty")
    for field, text in (("type", type), ("source", source)):
        if len(text) > MAX_NAME:
            raise InvalidEvent(field, f"has {len(text)} characters; at most {MAX_NAME} are allowed")
    if not 0 <= expiry <= MAX_SECONDS:
        raise InvalidEvent("expiry", f"{expiry} is not between 0 and {MAX_SECONDS:g} seconds")
    return Header(type, source, "", priority, expiry, encoding)


class Run:
    """Events in a row that share a header. Their numbers count up from `first`; `times` (s since 1970) and `payloads`
    have an entry for each; `via` is the peer through which they came, empty for this channel's own suppliers."""

    __slots__ = ("cached", "first", "header", "payloads", "times", "via")

    def __init__(
        self, header: Header, times: Sequence[float], payloads: Sequence[Any], first: int = 0, via: str = ""
    ) -> None:
        self.header, self.times, self.payloads, self.first, self.via = header, times, payloads, first, via
        #: What a translator made of it, kept because several consumers get the same.
        self.cached: Any = None

    def __len__(self) -> int:
        return len(self.payloads)

    def __repr__(self) -> str:
        return f"Run({self.header.type!r} from {self.header.origin!r}, {self.first} to {self.last})"

    @property
    def priority(self) -> int:
        return self.header.priority

    @property
    def last(self) -> int:
        """The number of its last event."""
        return self.first + len(self.payloads) - 1

    @property
    def size(self) -> int:
        """Bytes of header and payloads, as far as they are known: a NATIVE payload is not counted."""
        header = self.header
        known = sum(map(len, self.payloads)) if header.encoding is not Encoding.NATIVE else 0
        return 64 + len(header.type) + len(header.source) + len(header.origin) + known + 12 * len(self.payloads)

    def part(self, start: int, stop: int | None = None) -> Run:
        """Its events from index `start` to before `stop`."""
        return Run(self.header, self.times[start:stop], self.payloads[start:stop], self.first + start, self.via)

    def fresh(self, now: float) -> Run | None:
        """What of it has not expired at `now`, in s since 1970.

        Where it has numbers already these must go on counting up by one, so that what lies between others stays."""
        expiry = self.header.expiry
        if not expiry or all(time + expiry > now for time in self.times):
            return self
        keep = [index for index, time in enumerate(self.times) if time + expiry > now]
        if not keep:
            return None
        if self.first:
            return self.part(keep[0], keep[-1] + 1)
        times, payloads = [self.times[index] for index in keep], [self.payloads[index] for index in keep]
        return Run(self.header, times, payloads, via=self.via)


class Together:
    """Events that made conjunction number `which` of a subscription true: a run of one for each of its patterns."""

    __slots__ = ("runs", "which")

    def __init__(self, which: int, runs: Sequence[Run]) -> None:
        self.which, self.runs = which, tuple(runs)

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def priority(self) -> int:
        return max(run.priority for run in self.runs)

    @property
    def size(self) -> int:
        return sum(run.size for run in self.runs)

    def fresh(self, now: float) -> Together | None:
        """Itself, unless one of its events has expired."""
        return self if all(run.fresh(now) for run in self.runs) else None


def check(run: Run) -> None:
    """Raise InvalidEvent for times or payloads that are out of range; the header was checked before."""
    if len(run.times) != len(run.payloads):
        raise InvalidEvent("times", f"has {len(run.times)} entries for {len(run.payloads)} payloads")
    for time in run.times:
        if not -MAX_SECONDS <= time <= MAX_SECONDS:  # also refuses NaN
            raise InvalidEvent("time", "is not a number" if math.isnan(time) else f"{time} is out of range")
    if run.header.encoding is not Encoding.NATIVE:
        for payload in run.payloads:
            if len(payload) > MAX_PAYLOAD_BYTES:
                raise InvalidEvent("payload", f"has {len(payload)} bytes; at most {MAX_PAYLOAD_BYTES} are allowed")


def merged(runs: Iterable[Run]) -> list[Run]:
    """The same events in the same order, in as few runs as can be."""
    result: list[Run] = []
    group: list[Run] = []

    def close() -> None:
        if len(group) == 1:
            result.append(group[0])
        elif group:
            times = [time for run in group for time in run.times]
            payloads = [payload for run in group for payload in run.payloads]
            result.append(Run(group[0].header, times, payloads, group[0].first, group[0].via))
        group.clear()

    expected = 0
    for run in runs:
        if group and (run.first != expected or run.header != group[0].header or run.via != group[0].via):
            close()
        group.append(run)
        expected = run.first + len(run.payloads)
    close()
    return result
