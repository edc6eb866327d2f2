"""The Omni database: what is where on each floor, in versions, so that whoever knows one is told what changed since.

Versions are made when somebody asks, not with every step. Nothing here waits for the simulation.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import NamedTuple

import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.kernels import kernel
from robocorba.simulation.building import SimulatedBuilding
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_state import FloorState, Pose
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, FloorUpdate, Motions
from robocorba.spatial.grids import Floats, Longs

#: Bodies that left a floor and are remembered; who knows an older version gets the whole floor.
MOST_DEPARTED = 10_000


class LastScan(NamedTuple):
    """What a robot's sensor saw last: where it was, the first of its rays and the angle between them, rad, and their
    lengths, m; `time` is the simulation's."""

    robot: str
    time: float
    at: Pose
    first_rad: float
    step_rad: float
    distances: Floats


class OmniDatabase:
    """Of a building whose robots and elevators another thread moves. Safe from any thread."""

    def __init__(self, building: SimulatedBuilding) -> None:
        self._building = building
        self.map_version = 0
        self._lock = threading.Lock()
        # Whoever followed an earlier process knows smaller versions, and is told the whole.
        self._first_version = time.time_ns() // 1000
        self._floors: dict[str, _FloorVersions] = {}
        self._scans: dict[str, LastScan] = {}

    @property
    def floors(self) -> list[str]:
        return list(self._building.floors)

    def floor(self, name: str) -> FloorUpdate:
        """All of a floor. Raises UnknownFloor."""
        return self.changes(name, WHOLE)

    def changes(self, name: str, since: int) -> FloorUpdate:
        """What changed since a version; all of the floor where nobody remembers that one. Raises UnknownFloor."""
        with self._lock:
            physics = self._building.floors.get(name)
            if physics is None:
                self._floors.pop(name, None)
                raise UnknownFloor("floorName", name, self.floors)
            floor = self._floors.setdefault(name, _FloorVersions(self._first_version))
            floor.update(physics.snapshot, self._building.bodies, self._building.moments_on(name))
            return floor.since(name, since, self.map_version)

    def elevators(self) -> dict[str, ElevatorState]:
        """All of them, by name."""
        return dict(self._building.moments)

    # ---- sensors' data ----

    def record_scan(self, scan: LastScan) -> None:
        """What a robot's sensor saw."""
        self._scans[scan.robot] = scan

    def forget_scans(self, robot: str) -> None:
        """The robot is gone."""
        self._scans.pop(robot, None)

    def last_scans(self, floor: str) -> list[LastScan]:
        """Raises UnknownFloor."""
        if floor not in self._building.floors:
            raise UnknownFloor("floorName", floor, self.floors)
        return [scan for scan in list(self._scans.values()) if scan.at.floor == floor]


class _FloorVersions:
    """A floor as it was looked at last, and the version in which each thing changed."""

    def __init__(self, version: int) -> None:
        self.version = self._oldest = version
        self._seen: FloorState | None = None
        self._bodies: dict[str, Body] = {}
        #: In the order of the bodies: their numbers, their rows in what was seen, these rows, and since when they hold.
        self._numbers = self._places = self._moved_in = np.empty(0, np.int64)
        self._rows: Floats = np.empty((0, 6))
        self._arrived_in: dict[str, int] = {}
        self._last_arrival = version
        self._went: deque[tuple[int, int]] = deque()
        self._elevators: dict[str, tuple[ElevatorState, int]] = {}

    def update(self, seen: FloorState, known: dict[str, Body], elevators: dict[str, ElevatorState]) -> None:
        """Make a new version of it, where anything has changed."""
        next_version = self.version + 1
        has_changed = False
        if seen is not self._seen:
            is_same = self._seen is not None and seen.names is self._seen.names
            has_changed = (
                self._merge_motion(seen, next_version) if is_same else self._rebuild_rows(seen, known, next_version)
            )
            self._seen = seen
        for name, moment in elevators.items():
            if name not in self._elevators or self._elevators[name][0] != moment:
                self._elevators[name] = (moment, next_version)
                has_changed = True
        for name in [name for name in self._elevators if name not in elevators]:
            del self._elevators[name]
            self._oldest, has_changed = next_version, True  # so that everybody forgets it
        if has_changed:
            self.version = next_version

    def since(self, name: str, since: int, map_version: int) -> FloorUpdate:
        if not self._oldest <= since <= self.version:
            since = WHOLE
        came = []
        if since < self._last_arrival:
            came = [self._bodies[body] for body, version in self._arrived_in.items() if version > since]
        went = [] if since == WHOLE else [number for version, number in self._went if version > since]
        elevators = {elevator: moment for elevator, (moment, version) in self._elevators.items() if version > since}
        seen_at = self._seen.time if self._seen else 0.0
        motions = np.empty(len(self._bodies), MOTION)
        moved = write_motion(self._numbers, self._rows, self._moved_in, since, motions)
        return FloorUpdate(name, since, self.version, seen_at, map_version, came, went, motions[:moved], elevators)

    def _merge_motion(self, seen: FloorState, version: int) -> bool:
        return merge_motion(seen.rows, self._places, self._rows, self._moved_in, version)

    def _rebuild_rows(self, seen: FloorState, known: dict[str, Body], version: int) -> bool:
        """Bodies came, went, or are kept in another order."""
        # What stands, and who has just gone, is not known.
        bodies = {name: body for name in seen.names if (body := known.get(name))}
        same = {name for name, body in bodies.items() if self._bodies.get(name) is body}
        places = np.array([seen.row_of[name] for name in bodies], np.int64)
        rows, moved_in = seen.rows[places], np.full(len(bodies), version)
        before = {name: row for row, name in enumerate(self._bodies)}
        for row, name in enumerate(bodies):
            if name in same and np.array_equal(rows[row], self._rows[before[name]]):
                moved_in[row] = self._moved_in[before[name]]
        self._went.extend((version, body.number) for name, body in self._bodies.items() if name not in same)
        while len(self._went) > MOST_DEPARTED:
            self._oldest = self._went.popleft()[0]
        self._arrived_in = {name: self._arrived_in[name] if name in same else version for name in bodies}
        self._last_arrival = max(self._arrived_in.values(), default=version)
        self._bodies, self._places, self._rows, self._moved_in = bodies, places, rows, moved_in
        self._numbers = np.array([body.number for body in bodies.values()], np.int64)
        return True


@kernel
def merge_motion(seen: Floats, places: Longs, rows: Floats, moved_in: Longs, version: int) -> bool:
    """Take the rows (n, 6) that differ over from those that were seen, at these places; whether any did."""
    has_moved = False
    for body in range(len(places)):
        place = places[body]
        for k in range(6):
            if seen[place, k] != rows[body, k]:
                rows[body] = seen[place]
                moved_in[body] = version
                has_moved = True
                break
    return has_moved


@kernel
def write_motion(numbers: Longs, rows: Floats, moved_in: Longs, since: int, motions: Motions) -> int:
    """Write how the bodies move that have moved since a version; how many."""
    count = 0
    for body in range(len(numbers)):
        if moved_in[body] > since:
            x, y, heading, vx, vy, turn = rows[body]
            motion = motions[count]
            motion.number, motion.vx, motion.vy, motion.turn, motion.x, motion.y = numbers[body], vx, vy, turn, x, y
            motion.heading = heading - 2 * np.pi * np.round(heading / (2 * np.pi))
            count += 1
    return count


def warm_up() -> None:
    """Load what looking and telling need, so that the first answer takes no longer than the others."""
    numbers, rows = np.zeros(1, np.int64), np.zeros((1, 6))
    merge_motion(rows, numbers, rows, numbers, 1)
    write_motion(numbers, rows, numbers, 0, np.empty(1, MOTION))
