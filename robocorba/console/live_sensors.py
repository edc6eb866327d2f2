"""Scans, postures and reservations of the running system, as far as viewers of the console want them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Collection
from typing import Any, NamedTuple, Protocol

from robocorba.console.sensor_feed import NOTHING, Feed, ScanFeed
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.reservations import ReservedAreas
from robocorba.simulation.robot_scans import RobotScan
from robocorba.system.repeating import Repeating

#: Interval between requests for scans and postures, and for reservations [s].
INTERVAL_S, RESERVATIONS_S = 0.1, 0.5
#: Interval at which everything on a floor is read, to notice what has gone [s].
WHOLE_S = 1.0
#: Simulated time before the newest scan or posture that is read again [s]: some are reported late.
OVERLAP_S = 0.2


class Wanted(NamedTuple):
    """What a viewer wants to see: floors with their scans, and with their postures; reservations of areas."""

    scans: tuple[str, ...] = ()
    postures: tuple[str, ...] = ()
    reservations: bool = False


class SensorSource(Protocol):
    """The Omni database. Its methods raise NotReachable, and UnknownFloor."""

    def scans_since(self, floor: str, time_s: float) -> list[RobotScan]: ...

    def postures(self, floor: str, time_s: float) -> list[Posture]: ...

    def reservations(self) -> list[ReservedAreas]: ...


class _Floor:
    """Scans and postures of a floor, and when all of them are read again [s]."""

    def __init__(self) -> None:
        self.scans, self.scans_at_s = ScanFeed(), 0.0
        self.postures, self.postures_at_s, self.newest_s = Feed(), 0.0, -1.0


class LiveSensors:
    """Reads what viewers want in a thread of its own, from `start` to `close`; nothing if nobody wants anything.
    Thread-safe.

    time_of: returns the simulated time of a floor [s]; may raise UnknownFloor. changed: called in that thread when
    there is news."""

    def __init__(self, source: SensorSource, time_of: Callable[[str], float], changed: Callable[[], None]) -> None:
        self._source, self._time_of, self._changed = source, time_of, changed
        self._lock = threading.Lock()
        self._wanted: dict[object, Wanted] = {}
        #: By floor, those with scans and those with postures that somebody wants.
        self._scans: dict[str, _Floor] = {}
        self._postures: dict[str, _Floor] = {}
        self._reservations = Feed()
        self._reservations_at_s = 0.0
        #: Why the Omni database does not answer; empty while it does, or nobody wants anything.
        self.problem = ""
        self._task = Repeating("console sensors", self.follow, INTERVAL_S)

    def start(self) -> None:
        self._task.start()

    def close(self) -> None:
        self._task.close()

    def want(self, viewer: object, wanted: Wanted) -> None:
        """What a viewer wants from now on; nothing: it may have left."""
        with self._lock:
            self._wanted.pop(viewer, None)
            if any(wanted):
                self._wanted[viewer] = wanted
            _keep(self._scans, {floor for one in self._wanted.values() for floor in one.scans})
            _keep(self._postures, {floor for one in self._wanted.values() for floor in one.postures})

    # ---- messages for viewers ----

    def scans_message(self, floor: str, version: int) -> tuple[int, str]:
        """The present version of a floor's scans, and the message that leads a viewer from `version` there; empty if
        it is there."""
        with self._lock:
            if floor not in self._scans or self._scans[floor].scans.feed.version == version:
                return version, ""
            feed = self._scans[floor].scans.feed
            changes = feed.since(version)
            head = _head(floor, changes.is_whole, changes.gone)
            return feed.version, f'{{"scans":{{{head},"scans":[{",".join(changes.entries.values())}]}}}}'

    def postures_message(self, floor: str, version: int) -> tuple[int, str]:
        """As `scans_message`, for postures."""
        with self._lock:
            if floor not in self._postures or self._postures[floor].postures.version == version:
                return version, ""
            feed = self._postures[floor].postures
            changes = feed.since(version)
            robots = ",".join(f"{json.dumps(robot)}:{joints}" for robot, joints in changes.entries.items())
            head = _head(floor, changes.is_whole, changes.gone)
            return feed.version, f'{{"postures":{{{head},"robots":{{{robots}}}}}}}'

    def reservations_message(self, version: int) -> tuple[int, str]:
        """As `scans_message`, for all reservations."""
        with self._lock:
            feed = self._reservations
            if feed.version == version or not self._reservations_at_s:
                return version, ""
            return feed.version, f'{{"reservations":[{",".join(feed.since(NOTHING).entries.values())}]}}'

    # ---- in the thread ----

    def follow(self) -> None:
        """Read what is wanted once."""
        now_s = time.monotonic()
        with self._lock:
            scans, postures = dict(self._scans), dict(self._postures)
            wants_reservations = any(one.reservations for one in self._wanted.values())
            before = self._version()
        try:
            for name, floor in scans.items():
                self._read_scans(name, floor, now_s)
            for name, floor in postures.items():
                self._read_postures(name, floor, now_s)
            if wants_reservations and now_s >= self._reservations_at_s + RESERVATIONS_S:
                self._read_reservations(now_s)
            problem = ""
        except RoboCorbaError as error:
            problem = str(error)
        with self._lock:
            has_changed = self._version() != before
        if has_changed or problem != self.problem:
            self.problem = problem
            self._changed()

    def _version(self) -> int:
        """The highest version of all feeds."""
        feeds = [floor.scans.feed for floor in self._scans.values()]
        feeds += [floor.postures for floor in self._postures.values()]
        return max(feed.version for feed in [self._reservations, *feeds])

    def _read_scans(self, name: str, floor: _Floor, now_s: float) -> None:
        is_all = now_s >= floor.scans_at_s
        try:
            found = self._source.scans_since(name, -1.0 if is_all else floor.scans.newest_s - OVERLAP_S)
            time_s = self._time_of(name)
        except UnknownFloor:
            found, time_s, is_all = [], 0.0, True
        with self._lock:
            floor.scans.update(found, is_all, time_s, now_s)
        if is_all:
            floor.scans_at_s = now_s + WHOLE_S

    def _read_postures(self, name: str, floor: _Floor, now_s: float) -> None:
        is_all = now_s >= floor.postures_at_s
        try:
            found = self._source.postures(name, -1.0 if is_all else floor.newest_s - OVERLAP_S)
        except UnknownFloor:
            found, is_all = [], True
        with self._lock:
            for posture in found:
                floor.postures.put(posture.robot, [round(angle, 4) for angle in posture.joints])
            if is_all:
                floor.postures.drop(set(floor.postures.keys) - {posture.robot for posture in found})
        times = [posture.time for posture in found]
        floor.newest_s = max(times, default=-1.0) if is_all else max([floor.newest_s, *times])
        if is_all:
            floor.postures_at_s = now_s + WHOLE_S

    def _read_reservations(self, now_s: float) -> None:
        found = self._source.reservations()
        with self._lock:
            for reserved in found:
                self._reservations.put(reserved.robot, _reservation_as_json(reserved))
            self._reservations.drop(set(self._reservations.keys) - {reserved.robot for reserved in found})
            self._reservations_at_s = now_s


def _keep(floors: dict[str, _Floor], wanted: Collection[str]) -> None:
    """Forget floors that nobody wants, and begin with new ones."""
    for name in [name for name in floors if name not in wanted]:
        del floors[name]
    for name in wanted:
        floors.setdefault(name, _Floor())


def _head(floor: str, is_whole: bool, gone: list[str]) -> str:
    """The members that messages of scans and postures share."""
    return f'"floor":{json.dumps(floor)},"whole":{json.dumps(is_whole)},"gone":{json.dumps(gone)}'


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
