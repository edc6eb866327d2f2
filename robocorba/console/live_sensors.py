"""Scans, postures and reservations of the running system, as far as viewers of the console want them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Collection
from typing import Any

from robocorba.console.following import Following
from robocorba.console.sensor_feed import NOTHING, Feed, ScanFeed
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.reservations import ReservedAreas
from robocorba.simulation.robot_scans import RobotScan

#: Interval between rounds [s].
INTERVAL_S = 0.1
#: Interval between requests for reservations [s].
RESERVATIONS_S = 0.5
#: Interval at which everything on a floor is read, to notice what has gone [s].
WHOLE_S = 1.0
#: Simulated time before the newest scan or posture that is read again [s]: some are reported late.
OVERLAP_S = 0.5
#: What a viewer can want: ("scans", floor), ("postures", floor), ("reservations", "").
Topic = tuple[str, str]


class LiveSensors(Following):
    """Reads what viewers want; nothing if nobody wants anything. Thread-safe.

    time_of: returns the simulated time of a floor [s]; may raise UnknownFloor. sensed: asks the sensors of all robots
    on floors for their scans, of some robots first."""

    def __init__(
        self,
        source: RemoteDatabase,
        time_of: Callable[[str], float],
        sensed: Callable[[Collection[str], Collection[str]], list[RobotScan]],
        changed: Callable[[], None],
    ) -> None:
        super().__init__("console sensors", self._pause_s, changed)
        self._source, self._time_of, self._sensed = source, time_of, sensed
        #: When the present round has begun [s], and what robots' sensors see in it.
        self._began_s = 0.0
        self._scans: list[RobotScan] = []
        self._lock = threading.Lock()
        self._wanted: dict[object, tuple[Topic, ...]] = {}
        #: The robots at which viewers look.
        self._first: dict[object, tuple[str, ...]] = {}
        #: The topics that somebody wants.
        self._feeds: dict[Topic, Feed] = {}
        self._read = {"scans": self._read_scans, "postures": self._read_postures, "reservations": self._read_areas}

    def want(self, viewer: object, topics: Collection[Topic], first: Collection[str] = ()) -> None:
        """What a viewer wants from now on; nothing: it may have left. first: robots whose scans it wants before
        those of others."""
        with self._lock:
            self._wanted.pop(viewer, None)
            self._first.pop(viewer, None)
            if topics:
                self._wanted[viewer], self._first[viewer] = tuple(topics), tuple(first)
            wanted = [topic for each in self._wanted.values() for topic in each]
            former, self._feeds = self._feeds, {}
            for topic in wanted:
                self._feeds[topic] = former.get(topic) or (ScanFeed() if topic[0] == "scans" else Feed())

    def message(self, topic: Topic, version: int) -> tuple[int, str]:
        """The present version of a topic, and the message that leads a viewer from `version` there; empty if it is
        there, or nothing has been read yet."""
        kind, floor = topic
        with self._lock:
            feed = self._feeds.get(topic)
            if feed is None or feed.version == version or not feed.is_known:
                return version, ""
            changes = feed.since(NOTHING if kind == "reservations" else version)
            version = feed.version
        entries = ",".join(changes.entries.values())
        if kind == "reservations":
            return version, f'{{"reservations":[{entries}]}}'
        head = f'"floor":{json.dumps(floor)},"whole":{json.dumps(changes.is_whole)},"gone":{json.dumps(changes.gone)}'
        if kind == "scans":
            return version, f'{{"scans":{{{head},"scans":[{entries}]}}}}'
        robots = ",".join(f"{json.dumps(robot)}:{joints}" for robot, joints in changes.entries.items())
        return version, f'{{"postures":{{{head},"robots":{{{robots}}}}}}}'

    # ---- in the thread ----

    def _read_news(self) -> bool:
        self._began_s = now_s = time.monotonic()
        has_changed = False
        with self._lock:
            feeds = dict(self._feeds)
            first = {robot for robots in self._first.values() for robot in robots}
        floors = [floor for kind, floor in feeds if kind == "scans"]
        self._scans = self._sensed(floors, first) if floors else []
        for (kind, floor), feed in feeds.items():
            before = feed.version if feed.is_known else None
            self._read[kind](floor, feed, now_s)
            has_changed |= feed.version != before
        return has_changed

    def _pause_s(self) -> float:
        """Until the next round begins [s]; a fifth of the time is left to others."""
        return max(INTERVAL_S / 5, self._began_s + INTERVAL_S - time.monotonic())

    def _read_scans(self, floor: str, feed: Feed, now_s: float) -> None:
        assert isinstance(feed, ScanFeed)
        is_all = now_s >= feed.all_at_s
        try:
            found = self._source.scans_since(floor, -1.0 if is_all else feed.newest_s - OVERLAP_S)
            time_s = self._time_of(floor)
        except UnknownFloor:
            found, time_s, is_all = [], 0.0, True
        # A program may have made others by the same sensor: the last one counts.
        here = sorted((*found, *(scan for scan in self._scans if scan.at.floor == floor)), key=lambda scan: scan.time)
        last = {(scan.robot, *scan.sensor): scan for scan in here}
        with self._lock:
            feed.receive(last.values(), is_all, time_s, now_s)
        if is_all:
            feed.all_at_s = now_s + WHOLE_S

    def _read_postures(self, floor: str, feed: Feed, now_s: float) -> None:
        is_all = now_s >= feed.all_at_s
        found: list[Posture] = []
        try:
            found = self._source.postures(floor, -1.0 if is_all else feed.newest_s - OVERLAP_S)
        except UnknownFloor:
            is_all = True
        with self._lock:
            feed.update({each.robot: [round(angle, 4) for angle in each.joints] for each in found}, is_all)
        feed.newest_s = max([-1.0 if is_all else feed.newest_s, *(each.time for each in found)])
        if is_all:
            feed.all_at_s = now_s + WHOLE_S

    def _read_areas(self, floor: str, feed: Feed, now_s: float) -> None:
        if now_s < feed.all_at_s:
            return
        found = self._source.reservations()
        with self._lock:
            feed.update({reserved.robot: _reservation_as_json(reserved) for reserved in found}, is_all=True)
        feed.all_at_s = now_s + RESERVATIONS_S


def _reservation_as_json(reserved: ReservedAreas) -> dict[str, Any]:
    """A reservation as static/live.js documents it."""
    status = reserved.status
    return {
        "robot": reserved.robot,
        "phase": "granted" if status.granted else "waiting",
        "ahead": status.ahead,
        "left": round(status.left_s, 1),
        "areas": [
            {"floor": floor, "polygon": [list(corner) for corner in corners]} for floor, corners in reserved.areas
        ],
    }
