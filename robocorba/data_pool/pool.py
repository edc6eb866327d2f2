"""The data pool: the state of the floor that its robot is on, and of no other floor.

It loads the floor from a source, the Omni database of the running simulation, and follows its changes. Readers get
immutable snapshots of one floor at one moment; a newer snapshot replaces the older one as a whole.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

from robocorba.data_pool.entities import FloorEntity
from robocorba.data_pool.snapshot import NO_BODIES, NO_ELEVATORS, NO_MOTIONS, FloorBodies, FloorSnapshot, NearbyRobot
from robocorba.data_pool.walls import NearestObstacle, Walls
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UpdateMismatch
from robocorba.maps.model import Building
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_update import FloorUpdate, FloorView


class FloorSource(Protocol):
    """Supplies the state of every floor."""

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """The changes on a floor since a version; for WHOLE, the whole floor. Raises UnknownFloor, NotReachable."""


#: Returns a building with at least the floor of this name. Raises UnknownFloor, NotReachable.
MapOf = Callable[[str], Building]


class DataPool:
    """The data pool of the robot called `own_name`, which begins on `floor`. It is empty before the first `follow`.

    One thread calls `follow` periodically, another `follow_map`; these and `change_floor` block on the source. Readers on any
    thread never block. clock: returns the time [s]."""

    def __init__(
        self,
        source: FloorSource,
        map_of: MapOf,
        floor: str,
        own_name: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source, self._map_of, self._own_name, self._clock = source, map_of, own_name, clock
        self._lock = threading.Lock()
        self._here = _Follower(floor, source, map_of, own_name, clock)
        self._snapshot = FloorSnapshot(floor)
        #: Why the snapshot is not up to date; empty if it is.
        self.problem = "the floor has not been requested yet"

    # ---- one thread ----

    def follow(self) -> None:
        """Apply the source's changes. If this fails, the snapshot stays and `problem` gives the cause."""
        here = self._here
        try:
            self._replace(here, here.follow(), "")
        except (NotReachable, UnknownFloor, UpdateMismatch) as error:
            self._replace(here, None, str(error))

    def follow_map(self) -> None:
        """Load the walls if the map was edited; the next `follow` publishes them. `follow` loads the first ones.

        Raises UnknownFloor, NotReachable."""
        if self._snapshot.is_known:
            self._here.look_at_map()

    def change_floor(self, floor: str) -> bool:
        """Load the floor that the robot has changed to, and drop the previous one. One thread at a time.

        Returns whether the floor is loaded. If the source does not answer, it is not, and `follow` retries. Raises
        UnknownFloor and then changes nothing."""
        if floor == self.floor:
            return self.snapshot().is_known
        there = _Follower(floor, self._source, self._map_of, self._own_name, self._clock)
        snapshot, problem = FloorSnapshot(floor), ""
        try:
            snapshot = there.follow()
        except (NotReachable, UpdateMismatch) as error:
            problem = str(error)
        with self._lock:
            self._here, self._snapshot, self.problem = there, snapshot, problem
        return not problem

    def _replace(self, here: _Follower, snapshot: FloorSnapshot | None, problem: str) -> None:
        with self._lock:
            if here is self._here:  # else the robot has changed floors meanwhile
                self._snapshot, self.problem = snapshot or self._snapshot, problem

    # ---- any thread ----

    @property
    def floor(self) -> str:
        """The floor that the robot is on."""
        return self._snapshot.floor

    @property
    def lag_s(self) -> float:
        """The greatest age of the snapshot [s], up to one simulation step; infinite before the first one."""
        return self._clock() - self._snapshot.valid_at

    def snapshot(self) -> FloorSnapshot:
        """The latest snapshot. Readers that need several consistent answers use one snapshot for all of them."""
        return self._snapshot

    # The methods below read the latest snapshot. They raise NotReachable until the floor is loaded.

    def nearest_obstacle(self, x: float, y: float) -> NearestObstacle | None:
        """As FloorSnapshot.nearest_obstacle."""
        return self._known().nearest_obstacle(x, y)

    def nearest_non_robot(self, x: float, y: float) -> NearestObstacle | None:
        """As FloorSnapshot.nearest_non_robot."""
        return self._known().nearest_non_robot(x, y)

    def robots_near(self, x: float, y: float, range_m: float) -> list[NearbyRobot]:
        """As FloorSnapshot.robots_near."""
        return self._known().robots_near(x, y, range_m)

    def robot(self, name: str) -> FloorEntity | None:
        """The robot of this name; None if it is not on this floor."""
        return self._known().robot(name)

    def object(self, name: str) -> FloorEntity | None:
        """The object of this name; None if it is not on this floor."""
        return self._known().object(name)

    def objects(self, pattern: str = "*") -> list[FloorEntity]:
        """As FloorSnapshot.objects."""
        return self._known().objects(pattern)

    @property
    def elevators(self) -> Mapping[str, ElevatorState]:
        """Elevators that serve the floor, by name."""
        return self._known().elevators

    def _known(self) -> FloorSnapshot:
        snapshot, problem = self._snapshot, self.problem
        if not snapshot.is_known:
            raise NotReachable(f"floor {snapshot.floor} is not loaded: {problem}")
        return snapshot


class _Follower:
    """Follows one floor while the robot is on it."""

    def __init__(
        self, floor: str, source: FloorSource, map_of: MapOf, own_name: str, clock: Callable[[], float]
    ) -> None:
        self._floor, self._source, self._map_of, self._own_name, self._clock = floor, source, map_of, own_name, clock
        self._view = FloorView(floor)
        self._walls: Walls | None = None
        self._bodies, self._motions = NO_BODIES, NO_MOTIONS
        self._elevators: Mapping[str, ElevatorState] = NO_ELEVATORS

    def look_at_map(self) -> None:
        """Raises UnknownFloor, NotReachable."""
        building = self._map_of(self._floor)
        if self._walls is None or not self._walls.are_those_of(building):
            self._walls = Walls(building, self._floor)

    def follow(self) -> FloorSnapshot:
        """The current snapshot. Raises UnknownFloor, NotReachable; UpdateMismatch, after which the next call
        reloads the whole floor."""
        if self._walls is None:
            self.look_at_map()
        requested_at = self._clock()
        view = self._view
        try:
            update = self._source.changes(view.floor, view.version)
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
        known = view.version, view.time, view.map_version, self._bodies, self._motions, self._elevators
        return FloorSnapshot(self._floor, self._walls, *known, requested_at)
