"""The map of the running map editor, for commands that follow the system."""

from __future__ import annotations

import time

from robocorba.commands.options import served_building
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.simulation.system_changes import SystemChanges

#: Least interval between loads [s].
INTERVAL_S = 2.0


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
