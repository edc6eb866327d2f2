"""The Omni database: the state of each floor in versions; a client asks for the changes since its own version.

Versions are created on request, not with every step. Nothing here waits for the simulation.
"""

from __future__ import annotations

import secrets
import threading
from collections import deque

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
from robocorba.system.kernels import kernel

#: Departed bodies remembered for each floor; a client with an older version gets the whole floor.
MAX_DEPARTED = 10_000
#: The bits of the first version of a process; JavaScript has 53.
VERSION_BITS = 50


class OmniDatabase:
    """Database of a building that another thread simulates. Thread-safe."""

    def __init__(self, building: SimulatedBuilding) -> None:
        self._building = building
        self.map_version = 0
        self._lock = threading.Lock()
        # Random: clients of an earlier process hold other versions, and so get whole floors. No clock tells two of them
        # apart: a computer without a real-time clock starts them at the same time.
        self._first_version = 1 + secrets.randbits(VERSION_BITS)
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
            floor = self._floors.setdefault(name, _FloorVersions(self._first_version))
            floor.update(physics.snapshot, self._building.occupants.published, self._building.elevators.states_on(name))
            return floor.changes(name, since, self.map_version)

    def elevators(self) -> dict[str, ElevatorState]:
        """State of all elevators, by name."""
        return dict(self._building.elevators.states)

    # ---- scans ----

    def record_scan(self, scan: LastScan) -> None:
        """Keep a scan as the last one of its robot."""
        self._scans[scan.robot] = scan

    def forget_scan(self, robot: str) -> None:
        """Forget the scan of a robot that logged off."""
        self._scans.pop(robot, None)

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
        self.version = self._oldest = version
        self._snapshot: FloorState | None = None
        self._bodies: dict[str, Body] = {}
        #: One entry for each body: number, row index in the snapshot, row, and version of the last change.
        self._numbers = self._snapshot_rows = self._moved_in = np.empty(0, np.int64)
        self._rows: Floats = np.empty((0, 6))
        self._arrived_in: dict[str, int] = {}
        self._last_arrival = version
        self._departed: deque[tuple[int, int]] = deque()
        self._elevators: dict[str, tuple[ElevatorState, int]] = {}

    def update(self, snapshot: FloorState, bodies: dict[str, Body], elevators: dict[str, ElevatorState]) -> None:
        """Create a new version if anything changed."""
        next_version = self.version + 1
        has_changed = False
        if snapshot is not self._snapshot:
            if self._snapshot is not None and snapshot.names is self._snapshot.names:
                has_changed = merge_motion(snapshot.rows, self._snapshot_rows, self._rows, self._moved_in, next_version)
            else:
                self._rebuild_rows(snapshot, bodies, next_version)
                has_changed = True
            self._snapshot = snapshot
        for name, state in elevators.items():
            if name not in self._elevators or self._elevators[name][0] != state:
                self._elevators[name] = (state, next_version)
                has_changed = True
        for name in [name for name in self._elevators if name not in elevators]:
            del self._elevators[name]
            self._oldest, has_changed = next_version, True  # clients can drop it only with a whole floor
        if has_changed:
            self.version = next_version

    def changes(self, name: str, since: int, map_version: int) -> FloorUpdate:
        """Changes since a version; the whole floor if that version is not remembered."""
        if not self._oldest <= since <= self.version:
            since = WHOLE
        came = []
        if since < self._last_arrival:
            came = [self._bodies[body] for body, version in self._arrived_in.items() if version > since]
        went = [] if since == WHOLE else [number for version, number in self._departed if version > since]
        elevators = {elevator: state for elevator, (state, version) in self._elevators.items() if version > since}
        time_s = self._snapshot.time if self._snapshot else 0.0
        motions = np.empty(len(self._bodies), MOTION)
        moved = write_motion(self._numbers, self._rows, self._moved_in, since, motions)
        return FloorUpdate(name, since, self.version, time_s, map_version, came, went, motions[:moved], elevators)

    def _rebuild_rows(self, snapshot: FloorState, published: dict[str, Body], version: int) -> None:
        """Rebuild the rows after bodies were added, removed or reordered."""
        # `published` has neither the static body nor bodies that were just removed.
        bodies = {name: body for name in snapshot.names if (body := published.get(name))}
        kept = {name for name, body in bodies.items() if self._bodies.get(name) is body}
        snapshot_rows = np.array([snapshot.row_of[name] for name in bodies], np.int64)
        rows, moved_in = snapshot.rows[snapshot_rows], np.full(len(bodies), version)
        row_before = {name: row for row, name in enumerate(self._bodies)}
        for row, name in enumerate(bodies):
            if name in kept and np.array_equal(rows[row], self._rows[row_before[name]]):
                moved_in[row] = self._moved_in[row_before[name]]
        numbers = {body.number for body in bodies.values()}  # those that are not kept have another name or outline
        self._departed.extend((version, body.number) for body in self._bodies.values() if body.number not in numbers)
        while len(self._departed) > MAX_DEPARTED:
            self._oldest = self._departed.popleft()[0]
        self._arrived_in = {name: self._arrived_in[name] if name in kept else version for name in bodies}
        self._last_arrival = max(self._arrived_in.values(), default=version)
        self._bodies, self._snapshot_rows, self._rows, self._moved_in = bodies, snapshot_rows, rows, moved_in
        self._numbers = np.array([body.number for body in bodies.values()], np.int64)


@kernel
def merge_motion(snapshot: Floats, snapshot_rows: Longs, rows: Floats, moved_in: Longs, version: int) -> bool:
    """Copy changed rows from `snapshot`, at indices `snapshot_rows`, to `rows` (n, 6); return whether any changed."""
    has_moved = False
    for body in range(len(snapshot_rows)):
        row = snapshot_rows[body]
        for k in range(6):
            if snapshot[row, k] != rows[body, k]:
                rows[body] = snapshot[row]
                moved_in[body] = version
                has_moved = True
                break
    return has_moved


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
    """Compile or load the kernels, so that the first answer takes no longer than the others."""
    numbers, rows = np.zeros(1, np.int64), np.zeros((1, 6))
    merge_motion(rows, numbers, rows, numbers, 1)
    write_motion(numbers, rows, numbers, 0, np.empty(1, MOTION))
