"""Keeps a virtual sensor's copies of floors up to date: a floor that nobody scans costs next to nothing."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Collection, Iterator

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import fixed_obstacles
from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor

#: Time after the last scan on a floor until nobody scans there any more [s].
SCAN_WINDOW_S = 2.0
#: Interval between updates of a floor that nobody scans [s]. Below the age that scans allow, for the server's load.
QUIET_INTERVAL_S = 0.5


class FloorFollower:
    """Follows the floors of `sensor`. Thread-safe.

    changes: returns the changes of a floor since a version; raises UnknownFloor, NotReachable. clock: that of the
    sensor [s]."""

    def __init__(
        self,
        sensor: VirtualSensor,
        changes: Callable[[str, int], FloorUpdate],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.sensor, self._changes, self._clock = sensor, changes, clock
        #: Held during an update of a floor, from its request on.
        self._lock = threading.Lock()
        self._scanned_at: dict[str, float] = {}
        self._updated_at: dict[str, float] = {}

    def set_map(self, building: Building) -> None:
        """Use an edited map."""
        for floor in building.floors:
            fixed_obstacles(building, floor)  # computed before scans have to wait; the results are cached
        with self._lock:
            self.sensor.set_map(building)
            for floor in self._updated_at.keys() - set(self.sensor.floors):
                del self._updated_at[floor]
                self._scanned_at.pop(floor, None)

    def follow(self) -> None:
        """Update all floors that are scanned, and those that nobody scans every QUIET_INTERVAL_S.

        Raises UpdateMismatch."""
        for floor in self.sensor.floors:
            age_s = self._clock() - self._updated_at.get(floor, float("-inf"))
            if self._is_scanned(floor) or age_s >= QUIET_INTERVAL_S:
                with self._lock:
                    self._update(floor)

    def prepare(self, floors: Collection[str]) -> None:
        """Call this before scans on floors: it updates those that nobody has scanned lately."""
        for floor in set(floors) & self._updated_at.keys():
            if not self._is_scanned(floor):
                with self._locked_for_scan() as is_mine, contextlib.suppress(UpdateMismatch):
                    if is_mine:
                        self._update(floor)
            self._scanned_at[floor] = self._clock()

    @contextlib.contextmanager
    def _locked_for_scan(self) -> Iterator[bool]:
        """Try to hold the lock for 0.5 s; yields whether it is held. Else a scan takes what is there."""
        is_mine = self._lock.acquire(timeout=0.5)
        try:
            yield is_mine
        finally:
            if is_mine:
                self._lock.release()

    def _is_scanned(self, floor: str) -> bool:
        return self._clock() - self._scanned_at.get(floor, float("-inf")) < SCAN_WINDOW_S

    def _update(self, floor: str) -> None:
        """Request and apply the changes of a floor. Raises UpdateMismatch."""
        with contextlib.suppress(NotReachable, UnknownFloor):
            requested_at = self._clock()
            self.sensor.follow(self._changes(floor, self.sensor.version(floor)), requested_at)
            self._updated_at[floor] = requested_at
