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
    """The running system, by default with all floors."""
    return LiveSystem(RemoteFloors(orb, floors), RemoteDatabase(orb, 0.0), RemoteMissionControl(orb, 0.0), with_scans)


class LiveSystem:
    """What is new in the running system. Not thread-safe. with_scans: read scans; sensors then report them more
    often."""

    def __init__(
        self, floors: RemoteFloors, database: RemoteDatabase, control: RemoteMissionControl, with_scans: bool = True
    ) -> None:
        self._floors, self._database, self._control = floors, database, control
        self._with_scans = with_scans
        self._sensors_at_s = self._missions_at_s = 0.0
        self._mission_version = 0
        #: Simulated times of the last posture of each robot, and of the last scan of each of its sensors.
        self._posture_times: dict[tuple[object, ...], float] = {}
        self._scan_times: dict[tuple[object, ...], float] = {}
        #: The floors of the changes that were returned last.
        self._seen: set[str] = set()

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
            self._sensors_at_s = now_s + SENSORS_S
            for update in updates:
                with contextlib.suppress(UnknownFloor):  # it has been removed meanwhile
                    postures += self._new_postures(update)
                    scans += self._new_scans(update) if self._with_scans else ()
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
        return [each for each in found if _is_new(self._scan_times, (each.robot, *each.sensor), each.time, update.time)]


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
