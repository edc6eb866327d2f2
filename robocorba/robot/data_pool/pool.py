"""The data pool: the state of the floor that its robot is on, and of no other floor.

It loads the floor from a source, the Omni database of the running simulation, and follows its changes. Readers get
immutable snapshots of one floor at one time; a newer snapshot replaces the older one as a whole.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import FloorUpdate, FloorView
from robocorba.robot.data_pool.snapshot import (
    NO_BODIES,
    NO_ELEVATORS,
    NO_MOTIONS,
    FloorBodies,
    FloorSnapshot,
    Updates,
    continued,
)
from robocorba.robot.data_pool.walls import Walls

#: Maximum age of a snapshot from which the present positions of moving robots can be extrapolated [s].
STALE_S = 0.3


#: Returns the changes on a floor since a version; for WHOLE, the whole floor. Raises UnknownFloor, NotReachable.
FloorUpdates = Callable[[str, int], FloorUpdate]
#: Returns a building with at least the floor of this name. Raises UnknownFloor, NotReachable.
MapSource = Callable[[str], Building]


class DataPool:
    """The data pool of the robot `own_name`, which starts on `floor`. It is empty before the first `follow`.

    One thread calls `follow` periodically, another `follow_map`; these and `change_floor` block on the source. Readers
    on any thread never block. clock: returns the time [s]."""

    def __init__(
        self,
        source: FloorUpdates,
        map_source: MapSource,
        floor: str,
        own_name: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._new_follower = partial(_Follower, source, map_source, own_name, clock)
        self._follower = self._new_follower(floor)
        self._snapshot = FloorSnapshot(floor)
        #: Why the snapshot is not up to date; empty if it is.
        self.problem = "the floor has not been requested yet"

    # ---- one thread ----

    def follow(self) -> None:
        """Apply the source's changes. If this fails, the snapshot stays and `problem` gives the cause."""
        follower = self._follower
        snapshot, problem = None, ""
        try:
            snapshot = follower.follow()
        except (NotReachable, UnknownFloor, UpdateMismatch) as error:
            problem = str(error)
        with self._lock:
            if follower is self._follower:  # else the robot has changed floors meanwhile
                self._snapshot, self.problem = snapshot or self._snapshot, problem

    def follow_map(self) -> None:
        """Load the walls again if the map was edited; the next `follow` publishes them.

        Raises UnknownFloor, NotReachable."""
        if self._snapshot.is_known:
            self._follower.load_walls()

    def change_floor(self, floor: str) -> bool:
        """Load the floor that the robot has changed to, and drop the previous one. One thread at a time.

        Returns whether the floor is loaded. If the source does not answer, it is not, and `follow` retries. Raises
        UnknownFloor and then changes nothing."""
        if floor == self.floor:
            return self.snapshot().is_known
        follower = self._new_follower(floor)
        snapshot, problem = FloorSnapshot(floor), ""
        try:
            snapshot = follower.follow()
        except (NotReachable, UpdateMismatch) as error:
            problem = str(error)
        with self._lock:
            self._follower, self._snapshot, self.problem = follower, snapshot, problem
        return not problem

    # ---- any thread ----

    @property
    def floor(self) -> str:
        """The floor that the robot is on."""
        return self._snapshot.floor

    @property
    def lag_s(self) -> float:
        """Upper bound of the snapshot's age [s], but for one simulation step; infinite before the first one."""
        return self._clock() - self._snapshot.valid_at

    def snapshot(self) -> FloorSnapshot:
        """The latest snapshot. Readers that need several consistent answers use one snapshot for all of them."""
        return self._snapshot

    def loaded_snapshot(self) -> FloorSnapshot:
        """The latest snapshot. Raises NotReachable until the floor is loaded."""
        snapshot, problem = self._snapshot, self.problem
        if not snapshot.is_known:
            raise NotReachable(f"floor {snapshot.floor} is not loaded: {problem}")
        return snapshot

    def current_snapshot(self) -> FloorSnapshot:
        """The latest snapshot. Raises NotReachable if it is older than STALE_S."""
        lag_s = self.lag_s
        if lag_s > STALE_S:
            cause = self.problem or f"the data pool lags by {lag_s:.2f} s, more than {STALE_S:g} s"
            raise NotReachable(f"positions of other robots are unknown: {cause}")
        return self.loaded_snapshot()


class _Follower:
    """Follows one floor, with the parameters of DataPool."""

    def __init__(
        self, source: FloorUpdates, map_source: MapSource, own_name: str, clock: Callable[[], float], floor: str
    ) -> None:
        self._source, self._map_source, self._floor = source, map_source, floor
        self._own_name, self._clock = own_name, clock
        self._view = FloorView(floor)
        self._walls: Walls | None = None
        self._bodies, self._motions = NO_BODIES, NO_MOTIONS
        self._elevators: Mapping[str, ElevatorState] = NO_ELEVATORS
        self._recent: Updates = ()

    def load_walls(self) -> None:
        """Load the walls if they differ from the loaded ones. Raises UnknownFloor, NotReachable."""
        building = self._map_source(self._floor)
        if self._walls is None or not self._walls.match(building):
            self._walls = Walls(building, self._floor)

    def follow(self) -> FloorSnapshot:
        """The current snapshot. Raises UnknownFloor, NotReachable; UpdateMismatch, after which the next call
        reloads the whole floor."""
        if self._walls is None:
            self.load_walls()
        requested_at = self._clock()
        view = self._view
        try:
            update = self._source(view.floor, view.version)
            has_changed = view.apply(update)
        except UpdateMismatch:
            self._view = FloorView(self._floor)
            raise
        # The view keeps changing; the content of a snapshot must not.
        if has_changed:
            self._bodies = FloorBodies(tuple(view.bodies.values()), self._own_name)
        if has_changed or update.elevators:
            self._elevators = MappingProxyType(dict(view.elevators))
        if has_changed or len(update.motions):
            self._motions = view.motions.copy()
            self._motions.setflags(write=False)
        self._recent = continued(self._recent, update)
        content = view.version, view.time, view.map_version, self._bodies, self._motions, self._elevators
        return FloorSnapshot(self._floor, self._walls, *content, requested_at, self._recent)
