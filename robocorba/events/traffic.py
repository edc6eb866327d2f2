"""What a channel counts and measures of its traffic; `advice` predicts from it how fast other layouts would be."""

from __future__ import annotations

import dataclasses
import os
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

#: Maximum number of origins that are counted: a foreign channel may send any.
MAX_ORIGINS = 256
#: Weight of the latest event in the mean service time.
NEWEST_SHARE = 0.05


@dataclass(slots=True)
class OriginTraffic:
    """events: that came to a channel from one origin; of its own suppliers all, of other channels those that it wants.
    deliveries: of them to its consumers."""

    events: int = 0
    deliveries: int = 0


class ChannelTraffic(NamedTuple):
    """The traffic of one channel since the start of its process, and what it has measured.

    clock_s: when this was read, by a clock that is never set [s]. consumers: number of those that are connected.
    call_s, fastest_s: mean and shortest duration of the latest calls to them [s]. service_s: mean time from an event's
    arrival until it is passed on [s]. load: runnable threads a core. round_trips_s: the shortest of the latest calls to
    each peer that its links reach [s]."""

    clock_s: float
    origins: Mapping[str, OriginTraffic]
    consumers: int
    call_s: float
    fastest_s: float
    service_s: float
    load: float
    round_trips_s: Mapping[str, float]


class TrafficCounter:
    """Counts the traffic of a channel; guarded by the channel's lock."""

    def __init__(self) -> None:
        self.service_s = 0.0
        self._origins: dict[str, OriginTraffic] = {}

    def of(self, origin: str) -> OriginTraffic:
        """The counters of an origin; beyond MAX_ORIGINS they are lost."""
        if len(self._origins) >= MAX_ORIGINS:
            return self._origins.get(origin, OriginTraffic())
        return self._origins.setdefault(origin, OriginTraffic())

    def read(self, calls_s: Sequence[tuple[float, float]], round_trips_s: Mapping[str, float]) -> ChannelTraffic:
        """calls_s: of each connected consumer the mean and shortest duration of the latest calls [s], 0 before the
        first one. round_trips_s: see ChannelTraffic."""
        called = [(mean_s, fastest_s) for mean_s, fastest_s in calls_s if mean_s]
        return ChannelTraffic(
            time.monotonic(),
            {name: dataclasses.replace(one) for name, one in self._origins.items()},
            len(calls_s),
            statistics.fmean(mean_s for mean_s, _ in called) if called else 0.0,
            min((fastest_s for _, fastest_s in called), default=0.0),
            self.service_s,
            os.getloadavg()[0] / (os.cpu_count() or 1),
            round_trips_s,
        )

    def note_service(self, took_s: float) -> None:
        self.service_s += (took_s - self.service_s) * (NEWEST_SHARE if self.service_s else 1.0)
