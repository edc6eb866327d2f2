"""The Omni database: the state of each floor in versions; a client asks for the changes since its own version.

Versions are created on request, not with every step. Nothing here waits for the simulation.
"""

from __future__ import annotations

import threading

import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_state import FloorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, FloorUpdate, Motions
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.reservations import ReservedAreas
from robocorba.simulation.robot_scans import LastScan, RobotScan, RobotScans
from robocorba.simulation.versioned import Versioned, first_version
from robocorba.system.kernels import kernel

#: Departed bodies remembered for each floor; a client with an older version gets the whole floor.
MAX_DEPARTED = 10_000


class OmniDatabase:
    """Database of a building that another thread simulates. Thread-safe."""

    def __init__(self, building: SimulatedBuilding) -> None:
        self._building = building
        self.map_version = 0
        self._lock = threading.Lock()
        self._floors: dict[str, _FloorVersions] = {}
        self._scans: dict[str, LastScan] = {}
        #: The last scan of each sensor of the logged-on robots.
        self.robot_scans = RobotScans()

    @property
    def floors(self) -> list[str]:
        return list(self._building.occupants.floors)

    def floor(self, name: str) -> FloorUpdate:
        """The whole floor. Raises UnknownFloor."""
        return self.changes(name, WHOLE)

    def changes(self, name: str, since: int) -> FloorUpdate:
        """Changes since a version; the whole floor if that version is not remembered. Raises UnknownFloor."""
        with self._lock:
            physics = self._building.occupants.floors.get(name)
            if physics is None:
                self._floors.pop(name, None)
                raise UnknownFloor("floorName", name, self.floors)
            floor = self._floors.setdefault(name, _FloorVersions(first_version()))
            floor.update(physics.snapshot, self._building.occupants.published, self._building.elevators.states_on(name))
            return floor.changes(name, since, self.map_version)

    def elevators(self) -> dict[str, ElevatorState]:
        """State of all elevators, by name."""
        return dict(self._building.elevators.states)

    # ---- scans ----

    def record_scan(self, scan: LastScan) -> None:
        """Keep a scan as the last one of its robot."""
        self._scans[scan.robot] = scan

    def forget_scans(self, robot: str) -> None:
        """Forget the scans of a robot that logged off."""
        self._scans.pop(robot, None)
        self.robot_scans.forget(robot)

    def last_scans(self, floor: str) -> list[LastScan]:
        """Last scans on a floor. Raises UnknownFloor."""
        self.check(floor)
        return [scan for scan in list(self._scans.values()) if scan.at.floor == floor]

    def scans_since(self, floor: str, time_s: float) -> list[RobotScan]:
        """Scans on a floor after a simulated time [s], the last one of each sensor. Raises UnknownFloor."""
        self.check(floor)
        return self.robot_scans.since(floor, time_s)

    # ---- robots ----

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        """Postures that robots on a floor reported after a simulated time [s]. Raises UnknownFloor."""
        self.check(floor)
        robots = list(self._building.occupants.robots.values())
        postures = [robot.posture for robot in robots if robot.floor == floor]
        return [posture for posture in postures if posture and posture.time > time_s]

    def reservations(self) -> list[ReservedAreas]:
        """All reservations of areas, granted or waiting, first request first."""
        return self._building.reservations.all(self._building.time)

    def check(self, floor: str) -> None:
        """Raises UnknownFloor if there is no such floor."""
        if floor not in self._building.occupants.floors:
            raise UnknownFloor("floorName", floor, self.floors)


class _FloorVersions:
    """The last examined state of a floor, and the version in which each part changed."""

    def __init__(self, version: int) -> None:
        self.version = version
        self._snapshot: FloorState | None = None
        #: The bodies by number.
        self._bodies: Versioned[int, Body] = Versioned(version, MAX_DEPARTED)
        # The removal of an elevator is in no update: clients get the whole floor.
        self._elevators: Versioned[str, ElevatorState] = Versioned(version)
        #: One entry for each body: number, row index in the snapshot, row, and version of the last motion.
        self._numbers = self._snapshot_rows = self._moved_in = np.empty(0, np.int64)
        self._rows: Floats = np.empty((0, 6))

    def update(self, snapshot: FloorState, bodies: dict[str, Body], elevators: dict[str, ElevatorState]) -> None:
        """Create a new version if anything changed."""
        next_version = self.version + 1
        has_changed = False
        if snapshot is not self._snapshot:
            if self._snapshot is not None and snapshot.names is self._snapshot.names:
                has_changed = self._note_motion(snapshot.rows[self._snapshot_rows], next_version)
            else:
                self._rebuild_rows(snapshot, bodies, next_version)
                has_changed = True
            self._snapshot = snapshot
        if self._elevators.replace(elevators, next_version) or has_changed:
            self.version = next_version

    def changes(self, name: str, since: int, map_version: int) -> FloorUpdate:
        """Changes since a version; the whole floor if that version is not remembered."""
        if not max(self._bodies.oldest, self._elevators.oldest) <= since <= self.version:
            since = WHOLE
        came = list(self._bodies.since(since).values())
        went = [] if since == WHOLE else self._bodies.removed_since(since)
        time_s = self._snapshot.time if self._snapshot else 0.0
        motions = np.empty(len(self._numbers), MOTION)
        moved = write_motion(self._numbers, self._rows, self._moved_in, since, motions)
        elevators = self._elevators.since(since)
        return FloorUpdate(name, since, self.version, time_s, map_version, came, went, motions[:moved], elevators)

    def _note_motion(self, rows: Floats, version: int) -> bool:
        """Take over the rows of all bodies; return whether any has changed."""
        has_moved = (rows != self._rows).any(axis=1)
        self._moved_in[has_moved] = version
        self._rows = rows
        return bool(has_moved.any())

    def _rebuild_rows(self, snapshot: FloorState, published: dict[str, Body], version: int) -> None:
        """Rebuild the rows after bodies were added, removed or reordered."""
        # `published` has neither the static body nor bodies that were just removed.
        by_name = {name: body for name in snapshot.names if (body := published.get(name))}
        bodies = {body.number: body for body in by_name.values()}
        snapshot_rows = np.array([snapshot.row_of[name] for name in by_name], np.int64)
        rows, moved_in = snapshot.rows[snapshot_rows], np.full(len(bodies), version)
        row_before = {number: row for row, number in enumerate(self._numbers.tolist())}
        for row, (number, body) in enumerate(bodies.items()):
            is_same = self._bodies.get(number) == body  # else it is new, or has another name or outline
            if is_same and np.array_equal(rows[row], self._rows[row_before[number]]):
                moved_in[row] = self._moved_in[row_before[number]]
        self._bodies.replace(bodies, version)
        self._snapshot_rows, self._rows, self._moved_in = snapshot_rows, rows, moved_in
        self._numbers = np.array(list(bodies), np.int64)


@kernel
def write_motion(numbers: Longs, rows: Floats, moved_in: Longs, since: int, motions: Motions) -> int:
    """Write the motions of bodies that changed after version `since`; return their count."""
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
    """Compile or load the kernel, so that the first answer takes no longer than the others."""
    numbers = np.zeros(1, np.int64)
    write_motion(numbers, np.zeros((1, 6)), numbers, 0, np.empty(1, MOTION))
