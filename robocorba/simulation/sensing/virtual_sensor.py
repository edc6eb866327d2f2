"""The virtual sensor: scans that sensors on robots would make in the simulated building.

Its copy of each floor follows the Omni database; walls come from the map.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.sensing import InvalidScan, SensorBehind
from robocorba.map_editor.model import Building, Floor
from robocorba.map_editor.movable import fixed_obstacles, landing_doors
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.map_editor.spatial.floor_update import BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.grids import column_of, row_of
from robocorba.simulation.sensing.casting import ObstacleGrids, cast
from robocorba.simulation.sensing.noise import disturb
from robocorba.simulation.sensing.scan import LASER, Mount, Noise, ScanResult, ScanSpec
from robocorba.simulation.sensing.visible_obstacles import NO_ROBOT, VisibleObstacles, border_segments
from robocorba.system.kernels import kernel

#: Maximum age of floor data for a scan [s].
LAG_LIMIT_S = 1.0
#: Maximum number of rays in one call.
MAX_RAYS_AT_ONCE = 1_000_000
#: Number in place of a robot's: the sensor is mounted on the robot at the pose of the scan.
ROBOT_AT_POSE = -2


class VirtualSensor:
    """Virtual sensors on all floors of a building. One thread updates it (`set_map`, `follow`); scans are thread-safe.

    clock: returns the time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._floors: dict[str, _SensedFloor] = {}

    @property
    def lag_s(self) -> float:
        """Age of the floor data that was updated least recently [s]; infinite without floors."""
        now = self._clock()
        return max((now - floor.valid_at for floor in self._floors.values()), default=float("inf"))

    @property
    def robots(self) -> set[str]:
        """Names of the robots on all floors."""
        return {name for floor in self._floors.values() for name in floor.numbers}

    def set_map(self, building: Building) -> None:
        """Use a new or edited map; forget floors that it does not have."""
        for name in [name for name in self._floors if name not in building.floors]:
            del self._floors[name]
        for name in building.floors:
            if name in self._floors:
                self._floors[name].set_map(building)
            else:
                self._floors[name] = _SensedFloor(name, building)

    @property
    def floors(self) -> list[str]:
        return list(self._floors)

    def warm_up(self) -> None:
        """Compile or load the kernels, so that the first update and scan take no longer than the others."""
        for floor in list(self._floors.values())[:1]:
            scan_from(floor.obstacles.grids, np.zeros((1, 3)), Mount(), NO_ROBOT, LASER.rays, ScanSpec(LASER).frame)
        disturb(Noise(0.01), np.ones((1, 8)), 2.0, 0, np.zeros(1, np.int64))

    def view(self, floor: str) -> FloorView:
        """The copy of a floor. Raises UnknownFloor."""
        return self._floor(floor).view

    def version(self, floor: str) -> int:
        """Version of the copy of a floor, for the request of later changes. Raises UnknownFloor."""
        return self.view(floor).version

    def follow(self, update: FloorUpdate, requested_at: float) -> None:
        """Apply an update that was requested from the Omni database at `requested_at` by the clock [s].

        Raises UnknownFloor, UpdateMismatch."""
        self._floor(update.floor).follow(update, requested_at)

    def scan(
        self, floor: str, robots: Floats, mount: Mount, spec: ScanSpec, own_robot: str | None = None
    ) -> ScanResult:
        """Scan with sensors on robots (m, 3) of x, y [m], heading [rad].

        The scan ignores the robot that the sensor is mounted on: `own_robot`, or for None the robot at each pose.
        Raises InvalidScan, UnknownFloor, SensorBehind."""
        sensed = self._floor(floor)
        lag_s = self._clock() - sensed.valid_at
        if lag_s > LAG_LIMIT_S:
            raise SensorBehind(lag_s, LAG_LIMIT_S)
        _check_rays(len(robots), spec)
        time_s, fan = sensed.view.time, spec.fan
        grids, numbers = sensed.current
        number = ROBOT_AT_POSE if own_robot is None else numbers.get(own_robot, NO_ROBOT)
        is_finite, sensors, own_robots, distances = scan_from(grids, robots, mount, number, fan.rays, spec.frame)
        if not is_finite:
            raise InvalidScan("robot", "the pose of the robot or of its sensor is not finite")
        if spec.noise:
            distances = disturb(spec.noise, distances, fan.range_m, spec.seed, own_robots)
        return ScanResult(time_s, sensors, distances)

    def scan_many(
        self, floors: Sequence[str], robots: Floats, mount: Mount, spec: ScanSpec, own_robot: str | None = None
    ) -> list[ScanResult]:
        """Scan with sensors on robots (m, 3) on these floors; one result for each. Raises as `scan`."""
        _check_rays(len(robots), spec)
        results: dict[int, ScanResult] = {}
        for floor in dict.fromkeys(floors):
            indices = [index for index, other in enumerate(floors) if other == floor]
            time_s, sensors, distances = self.scan(floor, robots[indices], mount, spec, own_robot)
            for row, index in enumerate(indices):
                results[index] = ScanResult(time_s, sensors[row : row + 1], distances[row : row + 1])
        return [results[index] for index in range(len(robots))]

    def _floor(self, name: str) -> _SensedFloor:
        if name not in self._floors:
            raise UnknownFloor("robot", name, list(self._floors))
        return self._floors[name]


def warm_up() -> None:
    """Compile or load the kernels, by rays in a room."""
    room = Floor("L1", 1, 0.0, outline=((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)))
    sensor = VirtualSensor()
    sensor.set_map(Building("warm-up").with_element("", room))
    sensor.warm_up()


def _check_rays(robots: int, spec: ScanSpec) -> None:
    if robots * spec.fan.count > MAX_RAYS_AT_ONCE:
        raise InvalidScan("rays", f"{robots} x {spec.fan.count} rays; at most {MAX_RAYS_AT_ONCE} in one call")


class _SensedFloor:
    """A floor: the copy from the Omni database, and the obstacles that sensors see."""

    def __init__(self, name: str, building: Building) -> None:
        self.view = FloorView(name)
        self.obstacles = VisibleObstacles()
        #: When the latest update was requested [s]: the copy is at least as new. -inf before the first one.
        self.valid_at = float("-inf")
        self.numbers: dict[str, int] = {}
        self._discs = np.empty((0, 4))
        #: Rows of the robots in the view's motions.
        self._robots = np.empty(0, np.int64)
        self._is_object = np.empty(0, bool)
        #: Sides of the objects in their own frames, and the row of the object that each belongs to.
        self._sides, self._side_of = np.empty((0, 4)), np.empty(0, np.int64)
        self.set_map(building)

    def set_map(self, building: Building) -> None:
        floor = self.view.floor
        self.obstacles.set_static(fixed_obstacles(building, floor))
        self._doors = {
            name: border_segments([landing_doors(building, name, floor)])
            for name, elevator in building.elevators.items()
            if floor in elevator.floors()
        }
        self.obstacles.set_moving(self._discs, self._moving_segments())
        #: Grids and the robots' numbers in them, replaced together.
        self.current = self.obstacles.grids, self.numbers

    def follow(self, update: FloorUpdate, requested_at: float) -> None:
        has_changed = self.view.apply(update)
        if has_changed:
            self._rebuild()
        robots = self.view.motions[self._robots]
        self._discs = np.column_stack([robots["x"], robots["y"], self._discs[:, 2:]])
        has_new_segments = has_changed or update.elevators or self._is_object[self.view.moved].any()
        self.obstacles.set_moving(self._discs, self._moving_segments() if has_new_segments else None)
        self.valid_at = requested_at
        self.current = self.obstacles.grids, self.numbers

    def _rebuild(self) -> None:
        """Rebuild the discs and sides after bodies were added or removed."""
        bodies = list(self.view.bodies.values())
        robots = [body for body in bodies if body.kind is BodyKind.ROBOT]
        objects = [body for body in bodies if body.kind is BodyKind.OBJECT]
        is_robot = np.array([body.kind is BodyKind.ROBOT for body in bodies], bool)
        self._robots, self._is_object = np.flatnonzero(is_robot), ~is_robot
        self._discs = np.array([(0.0, 0.0, body.radius_m, body.number) for body in robots]).reshape(-1, 4)
        self.numbers = {body.name: body.number for body in robots}
        rings = [np.array([*body.outline, body.outline[0]]) for body in objects]
        sides = [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
        self._sides = np.concatenate(sides) if sides else np.empty((0, 4))
        self._side_of = np.repeat(np.flatnonzero(~is_robot), [len(ring) for ring in sides])

    def _moving_segments(self) -> Floats:
        """Segments (n, 4) of movable objects and of elevator doors that are not open."""
        at, objects = self.view.motions[self._side_of], np.empty_like(self._sides)
        c, s = np.cos(at["heading"]), np.sin(at["heading"])
        for end in (0, 2):
            x, y = self._sides[:, end], self._sides[:, end + 1]
            objects[:, end] = at["x"] + c * x - s * y
            objects[:, end + 1] = at["y"] + s * x + c * y
        return np.concatenate([objects, *(lines for name, lines in self._doors.items() if not self._is_open(name))])

    def _is_open(self, elevator: str) -> bool:
        state = self.view.elevators.get(elevator)
        return bool(state and state.floor == self.view.floor and state.doors is Doors.OPEN)


@kernel
def scan_from(
    obstacles: ObstacleGrids,
    robots: Floats,
    mount: Mount,
    own_robot: int,
    rays: tuple[Floats, Floats],
    frame: tuple[float, float, float, float],
) -> tuple[bool, Floats, Longs, Floats]:
    """Scan with sensors mounted on robots (m, 3); `own_robot` is a number, NO_ROBOT or ROBOT_AT_POSE.

    Returns whether all poses are finite, poses (m, 3) of the sensors, numbers (m,) of the robots that they are mounted
    on, and distances (m, rays) from the rim [m]. rays: of a Fan. frame: of a ScanSpec."""
    ahead_m, left_m, heading = mount
    cosines, sines = rays
    first, step, range_m, rim_m = frame
    m = len(robots)
    sensors, own_robots = np.empty((m, 3)), np.full(m, own_robot)
    total = 0.0
    for row in range(m):
        x, y, facing = robots[row]
        c, s = math.cos(facing), math.sin(facing)
        sensors[row, 0] = x + c * ahead_m - s * left_m
        sensors[row, 1] = y + s * ahead_m + c * left_m
        sensors[row, 2] = (facing + heading) % (2 * math.pi)
        total += 0.0 * (sensors[row, 0] + sensors[row, 1] + sensors[row, 2])
    if total != 0.0:
        return False, sensors, own_robots, np.empty((0, 0))
    if own_robot == ROBOT_AT_POSE:  # the one whose disc contains the place, the deepest if there are several
        grid = obstacles.static.frame
        for row in range(m):
            x, y, _ = robots[row]
            nearest_m, own_robots[row] = 0.0, NO_ROBOT
            cell = row_of(grid, y) * int(grid[3]) + column_of(grid, x)
            for at in range(obstacles.disc_start[cell], obstacles.disc_start[cell + 1]):
                disc_x, disc_y, radius, number = obstacles.discs[obstacles.disc_items[at]]
                distance_m = math.hypot(disc_x - x, disc_y - y) - radius
                if distance_m <= nearest_m:
                    nearest_m, own_robots[row] = distance_m, int(number)
    distances = cast(obstacles, sensors, own_robots, cosines, sines, first, step, range_m + rim_m)
    if rim_m > 0.0:
        for row in range(m):
            for k in range(len(cosines)):
                is_hit = distances[row, k] < range_m + rim_m
                distances[row, k] = max(distances[row, k] - rim_m, 0.0) if is_hit else range_m
    return True, sensors, own_robots, distances
