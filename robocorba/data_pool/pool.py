"""The data pool: what is on the floor where its robot is, and nothing of any other floor.

It loads the floor from a source, the Omni database of the running simulation, and follows what changes there. Readers
get snapshots: each of them is of one floor at one moment, and a newer one takes its place as a whole.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

from robocorba.data_pool.snapshot import NO_ELEVATORS, NO_MOTIONS, NOBODY, Bodies, Near, Snapshot
from robocorba.data_pool.things import Thing
from robocorba.data_pool.walls import Nearest, Walls
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import OutOfStep
from robocorba.maps.model import Building
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_update import FloorUpdate, FloorView


class Source(Protocol):
    """Who knows what is where on every floor."""

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """What changed on a floor since a version, all of it for WHOLE. Raises UnknownFloor, NotReachable."""


#: A map that has at least the floor of this name. Raises UnknownFloor, NotReachable.
MapOf = Callable[[str], Building]


class DataPool:
    """Of the robot called `oneself`, which begins on `floor`. Nothing is known before the first `follow`.

    One thread calls `follow` again and again, one `follow_map`; these and `go_to` wait for the source. Any thread reads
    at any time, and waits for nobody. clock: tells the time in s."""

    def __init__(
        self,
        source: Source,
        map_of: MapOf,
        floor: str,
        oneself: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source, self._map_of, self._oneself, self._clock = source, map_of, oneself, clock
        self._lock = threading.Lock()
        self._here = _Follower(floor, source, map_of, oneself, clock)
        self._snapshot = Snapshot(floor)
        #: Why what is known is not up to date; empty where it is.
        self.problem = "it was not asked for yet"

    # ---- one thread ----

    def follow(self) -> None:
        """Catch up with the source. Where that does not answer, what is known stays, and `problem` tells why."""
        here = self._here
        try:
            self._replace(here, here.follow(), "")
        except (NotReachable, UnknownFloor, OutOfStep) as wrong:
            self._replace(here, None, str(wrong))

    def follow_map(self) -> None:
        """Take over the walls of an edited map; `follow` shows them, and loads the first ones.

        Raises UnknownFloor, NotReachable."""
        if self._snapshot.is_known:
            self._here.look_at_map()

    def go_to(self, floor: str) -> bool:
        """The robot is on another floor now: load that, and forget the one before.

        Whether it is known already. It is not where the source does not answer; then `follow` goes on trying. Raises
        UnknownFloor, and changes nothing. By one thread at a time."""
        if floor == self.floor:
            return self.snapshot().is_known
        there = _Follower(floor, self._source, self._map_of, self._oneself, self._clock)
        snapshot, problem = Snapshot(floor), ""
        try:
            snapshot = there.follow()
        except (NotReachable, OutOfStep) as wrong:
            problem = str(wrong)
        with self._lock:
            self._here, self._snapshot, self.problem = there, snapshot, problem
        return not problem

    def _replace(self, here: _Follower, snapshot: Snapshot | None, problem: str) -> None:
        with self._lock:
            if here is self._here:  # else the robot has gone to another floor meanwhile
                self._snapshot, self.problem = snapshot or self._snapshot, problem

    # ---- any thread ----

    @property
    def floor(self) -> str:
        """Where the robot is."""
        return self._snapshot.floor

    @property
    def lag_s(self) -> float:
        """How old what is known is at most, but for the simulation's step; infinite as long as nothing is known."""
        return self._clock() - self._snapshot.true_at

    def snapshot(self) -> Snapshot:
        """All that is known now, consistent in itself; whoever asks several things asks it."""
        return self._snapshot

    # What follows is asked of the latest snapshot. Raises NotReachable as long as nothing is known of the floor.

    def nearest_obstacle(self, x: float, y: float) -> Nearest | None:
        """As Snapshot.nearest_obstacle."""
        return self._known().nearest_obstacle(x, y)

    def nearest_thing(self, x: float, y: float) -> Nearest | None:
        """As Snapshot.nearest_thing."""
        return self._known().nearest_thing(x, y)

    def robots_near(self, x: float, y: float, range_m: float) -> list[Near]:
        """As Snapshot.robots_near."""
        return self._known().robots_near(x, y, range_m)

    def robot(self, name: str) -> Thing | None:
        """None where it is not on this floor."""
        return self._known().robot(name)

    def object(self, name: str) -> Thing | None:
        """None where it is not on this floor."""
        return self._known().object(name)

    def objects(self, pattern: str = "*") -> list[Thing]:
        """As Snapshot.objects."""
        return self._known().objects(pattern)

    @property
    def elevators(self) -> Mapping[str, ElevatorState]:
        """That serve the floor, by name."""
        return self._known().elevators

    def _known(self) -> Snapshot:
        snapshot, problem = self._snapshot, self.problem
        if not snapshot.is_known:
            raise NotReachable(f"nothing is known of {snapshot.floor}: {problem}")
        return snapshot


class _Follower:
    """One floor, for as long as the robot is there."""

    def __init__(self, floor: str, source: Source, map_of: MapOf, oneself: str, clock: Callable[[], float]) -> None:
        self._floor, self._source, self._map_of, self._oneself, self._clock = floor, source, map_of, oneself, clock
        self._view = FloorView(floor)
        self._walls: Walls | None = None
        self._bodies, self._motions = NOBODY, NO_MOTIONS
        self._elevators: Mapping[str, ElevatorState] = NO_ELEVATORS

    def look_at_map(self) -> None:
        """Raises UnknownFloor, NotReachable."""
        building = self._map_of(self._floor)
        if self._walls is None or not self._walls.are_those_of(building):
            self._walls = Walls(building, self._floor)

    def follow(self) -> Snapshot:
        """The floor now. Raises UnknownFloor, NotReachable; OutOfStep, after which it begins anew."""
        if self._walls is None:
            self.look_at_map()
        asked_at = self._clock()
        view = self._view
        try:
            update = self._source.changes(view.floor, view.version)
            has_changed = view.apply(update)
        except OutOfStep:
            self._view = FloorView(self._floor)
            raise
        # The view goes on changing; what is in a snapshot must not.
        if has_changed:
            self._bodies = Bodies(tuple(view.bodies.values()), self._oneself)
        if has_changed or update.elevators:
            self._elevators = MappingProxyType(dict(view.elevators))
        if has_changed or len(update.motions):
            self._motions = view.motions.copy()
            self._motions.setflags(write=False)
        known = view.version, view.time, view.map_version, self._bodies, self._motions, self._elevators
        return Snapshot(self._floor, self._walls, *known, asked_at)
