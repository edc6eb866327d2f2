"""Follows the running system: floors, postures, scans and missions."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Sequence

import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, FloorUpdate
from robocorba.map_editor.spatial.posture import Posture
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_scans import live_scans
from robocorba.robot.live_scans import LiveScans, robots_on
from robocorba.simulation.corba.remote_database import RemoteDatabase, RemoteFloors
from robocorba.simulation.mission_record import MissionState
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_changes import SystemChanges
from robocorba.system.backoff import Backoff

#: Interval between looks at scans and postures [s].
SENSORS_S = 0.1
#: Simulated time before the newest scan or posture that is read again [s]: some are reported late.
OVERLAP_S = 0.2
#: Times of postures, and of scans, that are remembered: as many robots as the simulation takes.
MAX_KEPT = 10_000


def live_system(orb: Orb, floors: Sequence[str] = (), with_scans: bool = True) -> LiveSystem:
    """The running system, by default with all floors; `close` it at the end."""
    database, control = RemoteDatabase(orb, 0.0), RemoteMissionControl(orb, 0.0)
    return LiveSystem(RemoteFloors(orb, floors), database, control, with_scans, live_scans(orb))


class LiveSystem:
    """What is new in the running system. Not thread-safe. with_scans: read the scans of programs, and those of actual
    robots' own sensors, which are asked; may be changed. sensed: asks them; None leaves them out."""

    def __init__(
        self,
        floors: RemoteFloors,
        database: RemoteDatabase,
        control: RemoteMissionControl,
        with_scans: bool = True,
        sensed: LiveScans | None = None,
    ) -> None:
        self._floors, self._database, self._control = floors, database, control
        self.with_scans, self._sensed = with_scans, sensed
        self._sensors_at_s = self._missions_at_s = 0.0
        self._mission_version = 0
        #: Simulated times of the last posture of each robot, and of the last scan of each of its sensors.
        self._posture_times: dict[tuple[object, ...], float] = {}
        self._scan_times: dict[tuple[object, ...], float] = {}
        #: The floors of the changes that were returned last.
        self._seen: set[str] = set()

    @property
    def actual(self) -> frozenset[str]:
        """The robots whose sensors are known to be their own."""
        return self._sensed.actual if self._sensed else frozenset()

    def close(self) -> None:
        if self._sensed:
            self._sensed.close()

    def begin(self, limit_s: float) -> SystemChanges:
        """All that there is. For `limit_s` servers that are restarting are waited for; raises as `follow` then."""
        until = time.monotonic() + limit_s
        return Backoff(0.1, 0.5).call(lambda: self.follow(max(0.0, until - time.monotonic())), limit_s, NotReachable)

    def follow(self, resolve_timeout_s: float) -> SystemChanges:
        """What has changed since the last call. After a failure the next one has whole floors. A floor that is gone,
        or has another name, comes once more: empty.

        Raises UnknownFloor, and NotReachable if the Omni database is not found within `resolve_timeout_s`."""
        updates = self._floors.follow(resolve_timeout_s)
        try:
            changes = self._changes(updates)
        except NotReachable:
            self._floors.views = {}  # nobody has seen these updates
            raise
        if updates:
            present = {update.floor for update in updates}
            gone, self._seen = self._seen - present, present
            newest = max(updates, key=lambda update: update.time)
            changes.updates.extend(_empty(floor, newest) for floor in sorted(gone))
        return changes

    def _changes(self, updates: list[FloorUpdate]) -> SystemChanges:
        now_s = time.monotonic()
        postures: list[Posture] = []
        scans: list[RobotScan] = []
        missions: list[MissionState] = []
        if now_s >= self._sensors_at_s:
            self._sensors_at_s = max(now_s, self._sensors_at_s + SENSORS_S)
            for update in updates:
                with contextlib.suppress(UnknownFloor):  # it has been removed meanwhile
                    postures += self._new_postures(update)
                    scans += self._new_scans(update) if self.with_scans else ()
            scans += self._new_own_scans(updates) if self.with_scans else ()
        if now_s >= self._missions_at_s:
            self._missions_at_s = now_s + 0.5
            with contextlib.suppress(NotReachable):  # floors are followed without it
                missions = self._control.missions_since(self._mission_version)
                self._mission_version = max([self._mission_version, *(state.version for state in missions)])
        return SystemChanges(updates, postures, scans, missions)

    def _new_postures(self, update: FloorUpdate) -> list[Posture]:
        found = self._database.postures(update.floor, update.time - SENSORS_S - OVERLAP_S)
        return [each for each in found if _is_new(self._posture_times, (each.robot,), each.time, update.time)]

    def _new_scans(self, update: FloorUpdate) -> list[RobotScan]:
        found = self._database.scans_since(update.floor, update.time - SENSORS_S - OVERLAP_S)
        return [each for each in found if self._is_new_scan(each, update.time)]

    def _new_own_scans(self, updates: Sequence[FloorUpdate]) -> list[RobotScan]:
        """Those of actual robots: the virtual sensors are not asked, since all that they see is known."""
        views = self._floors.views
        robots = [robot for update in updates if update.floor in views for robot in robots_on(views[update.floor])]
        found = self._sensed.read(robots, with_virtual=False) if self._sensed else []
        return [each for each in found if self._is_new_scan(each, each.time)]

    def _is_new_scan(self, scan: RobotScan, now_s: float) -> bool:
        return _is_new(self._scan_times, (scan.robot, *scan.sensor), scan.time, now_s)


def _empty(floor: str, last: FloorUpdate) -> FloorUpdate:
    """The update of a floor without anything on it, at the time of another floor's update."""
    return FloorUpdate(floor, WHOLE, last.version, last.time, last.map_version, [], [], np.empty(0, MOTION), {})


def _is_new(times: dict[tuple[object, ...], float], key: tuple[object, ...], time_s: float, now_s: float) -> bool:
    """Whether something of a simulated time has not been seen before; notes that it has. times: of what was seen last,
    by key. now_s: the present simulated time; a server that was killed may begin again a little earlier."""
    if times.get(key) == time_s or time_s < times.get(key, -math.inf) <= now_s + OVERLAP_S:
        return False
    times.pop(key, None)
    times[key] = time_s
    while len(times) > MAX_KEPT:  # of robots that left long ago
        del times[next(iter(times))]
    return True
