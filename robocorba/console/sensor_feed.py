"""Scans and postures of a floor as JSON, with what has changed since a version."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.scan import RAY_SENSORS
from robocorba.simulation.versioned import Versioned

#: Time after which a scan is taken away if its sensor makes no other one, in simulated and in real time [s].
MAX_AGE_S = 2.0
#: Rays of a scan that viewers get.
MAX_RAYS = 720
#: Departed entries that a feed remembers; a viewer with an older version gets the whole feed.
MAX_GONE = 1000
#: Version of a viewer that has nothing yet.
NOTHING = 0

_versions = itertools.count(1)


class Feed:
    """Entries by key as JSON texts. Versions are unique among all feeds. One thread may use it."""

    def __init__(self) -> None:
        self.version = next(_versions)
        self._entries: Versioned[str, str] = Versioned(self.version, MAX_GONE)
        #: Whether it has been read; simulated time of its newest entry, and when all of it is read again [s].
        self.is_known, self.newest_s, self.all_at_s = False, -1.0, 0.0

    def put(self, key: str, value: Any) -> None:
        """Set an entry to a value of JSON types."""
        text = json.dumps(value, separators=(",", ":"))
        if self._entries.get(key) != text:
            self.version = next(_versions)
            self._entries.put(key, text, self.version)

    def update(self, entries: Mapping[str, Any], is_all: bool) -> None:
        """Set entries to values of JSON types. is_all: there are no other ones."""
        for key, value in entries.items():
            self.put(key, value)
        if is_all:
            self.drop(self._entries.since(NOTHING).keys() - entries.keys())
        self.is_known = True

    def drop(self, keys: Iterable[str]) -> None:
        """Remove entries."""
        for key in [key for key in keys if self._entries.get(key) is not None]:
            self.version = next(_versions)
            self._entries.remove(key, self.version)

    def since(self, version: int) -> Changes:
        """What changed after a version; everything for NOTHING, and for a version that is not remembered."""
        if version < self._entries.oldest:
            return Changes(True, self._entries.since(NOTHING), [])
        changed = self._entries.since(version)
        return Changes(False, changed, [key for key in self._entries.removed_since(version) if key not in changed])


class Changes(NamedTuple):
    """Changes of a feed: entries as JSON texts by key, and keys of entries that it no longer has."""

    is_whole: bool
    entries: dict[str, str]
    gone: list[str]


class _Sensor(NamedTuple):
    """A sensor: its key, the simulated time of its last scan, and when that was received [s]."""

    key: str
    time: float
    received_at: float


class ScanFeed(Feed):
    """The last scans on a floor. clock times are in s."""

    def __init__(self) -> None:
        super().__init__()
        self._sensors: dict[tuple[object, ...], _Sensor] = {}

    def receive(self, found: Iterable[RobotScan], is_all: bool, time_s: float, now_s: float) -> None:
        """Take over scans that were read at simulated time `time_s` and real time `now_s`; is_all: there are no other
        ones on the floor."""
        seen = set()
        for scan in found:
            of = scan.robot, *scan.sensor
            seen.add(of)
            self.newest_s = max(self.newest_s, scan.time)
            known = self._sensors.get(of)
            # An actual robot goes on while simulated time is paused.
            if known is None or known.time != scan.time or not scan.is_virtual:
                # The first time there may be scans of sensors that were switched off long ago.
                age_s = max(0.0, time_s - scan.time) if not self.is_known else 0.0
                key = known.key if known else self._new_key(scan)
                self._sensors[of] = _Sensor(key, scan.time, now_s - age_s)
                if age_s <= MAX_AGE_S:
                    self.put(key, _scan_as_json(key, scan))
        self.is_known = True
        if is_all:
            self.newest_s = max((scan.time for scan in self._sensors.values()), default=-1.0)
            self.drop([self._sensors.pop(of).key for of in list(self._sensors) if of not in seen])
        self.drop(
            sensor.key
            for sensor in self._sensors.values()
            if now_s - sensor.received_at > MAX_AGE_S and time_s - sensor.time > MAX_AGE_S
        )

    def _new_key(self, scan: RobotScan) -> str:
        """The robot's name and that of the sensor, such as R1/laser; the second laser is R1/laser 2."""
        name, taken = f"{scan.robot}/{_kind(scan)}", {sensor.key for sensor in self._sensors.values()}
        numbered = (f"{name} {number}" for number in itertools.count(1))
        if name.endswith("/sensor"):
            return next(key for key in numbered if key not in taken)
        next(numbered)
        return next(key for key in itertools.chain([name], numbered) if key not in taken)


def _kind(scan: RobotScan) -> str:
    rays = scan.first_rad, scan.step_rad, len(scan.distances), scan.range_m
    for sensor in RAY_SENSORS.values():
        fan = sensor.fan
        if rays == (fan.first_rad, fan.step_rad, fan.count, fan.range_m):
            return sensor.name
    return "sensor"


def _scan_as_json(key: str, scan: RobotScan) -> dict[str, Any]:
    """A scan as static/live.js documents it; of more than MAX_RAYS rays every second one, or every third, and so on."""
    at, (ahead_m, left_m, heading) = scan.at, scan.mount
    hits = scan.hits.astype(int)
    if len(scan.unmapped):
        hits += scan.unmapped
    stride = max(1, -(-len(hits) // MAX_RAYS))
    ranges = (scan.distances + scan.rim_m)[::stride].round(3).tolist()
    return {
        "key": key,
        "robot": scan.robot,
        "sensor": key.rpartition("/")[2],
        "time": scan.time,
        "pose": {"x": at.x, "y": at.y, "heading": at.heading},
        "mount": {"ahead": ahead_m, "left": left_m, "heading": heading},
        "angles": {"first": scan.first_rad, "step": scan.step_rad * stride, "count": len(ranges)},
        "range": scan.range_m,
        "rim": scan.rim_m,
        "ranges": ranges,
        "hits": hits[::stride].tolist(),
        "virtual": scan.is_virtual,
    }
