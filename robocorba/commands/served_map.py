"""The map of the running map editor, for commands that follow the system."""

from __future__ import annotations

import time
from collections.abc import Callable

from robocorba.commands.options import served_building
from robocorba.commands.waiting import RETRY_TIMEOUT_S, StopSignal
from robocorba.console.corba.live_system import LiveSystem
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_lasers import RemoteLasers
from robocorba.simulation.sensing.continuous_scans import ContinuousScans
from robocorba.simulation.system_changes import SystemChanges
from robocorba.simulation.system_view import RobotPlace

#: Interval between looks at the system, and least interval between loads of the map [s].
LOOK_S, INTERVAL_S = 0.05, 2.0


def scanning(
    orb: Orb, system: LiveSystem, places: Callable[[], tuple[float, dict[str, RobotPlace]]], rate_hz: float
) -> ContinuousScans | None:
    """Scans of all robots' lasers, to be closed; None at a rate of 0. places: simulated time [s], and robots."""
    return ContinuousScans(RemoteLasers(orb).scans, places, rate_hz, lambda: system.actual) if rate_hz else None


def serve(
    stop: StopSignal,
    system: LiveSystem,
    served: ServedMap,
    lasers: ContinuousScans | None,
    show: Callable[[SystemChanges], object],
    set_building: Callable[[Building], object],
    note: Callable[[str], object],
) -> None:
    """Show what changes in the running system, with the scans of lasers and the map, until stopped. note: gets a
    problem when it begins, and an empty text when it has ended."""
    noted = ""
    for _ in stop.ticks(LOOK_S):
        try:
            changes = system.follow(RETRY_TIMEOUT_S)
            if lasers:
                lasers.note(changes.scans)
                changes.scans.extend(lasers.take())
            show(changes)
            if building := served.after(changes):
                set_building(building)
            found = ""
        except RoboCorbaError as error:
            found = str(error)
        if found != noted:
            noted = found
            note(found)


class ServedMap:
    """Loads the map, and loads it again when it was edited. changes: those of the system that are known at first.
    building: as it was loaded first. Raises NotReachable, MapFileError."""

    def __init__(self, orb: Orb, changes: SystemChanges) -> None:
        self._orb = orb
        self.building = served_building(orb)
        self._version, self._next_s = _version(changes), 0.0

    def after(self, changes: SystemChanges) -> Building | None:
        """The map, if it is another one by these changes, once every INTERVAL_S at most; else None. Raises
        NotReachable, MapFileError."""
        version, now_s = _version(changes), time.monotonic()
        if not changes.updates or version == self._version or now_s < self._next_s:
            return None
        self._next_s = now_s + INTERVAL_S
        building = served_building(self._orb)
        self._version = version
        return building


def _version(changes: SystemChanges) -> int:
    """The newest version of the map in updates; 0 without updates."""
    return max((update.map_version for update in changes.updates), default=0)
