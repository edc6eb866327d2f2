"""The virtual sensor: scans that robots would make at their poses in the building.

It follows each floor of the Omni database; walls come from the map.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.sensing import InvalidScan, SensorBehind
from robocorba.kernels import kernel
from robocorba.maps.model import Building
from robocorba.maps.movable import fixed_obstacles, landing_doors
from robocorba.sensing.casting import Scene, cast
from robocorba.sensing.fan import LASER, MAX_RANGE_M, Fan
from robocorba.sensing.noise import Noise
from robocorba.sensing.sight import NOBODY, SensedScene, lines_of
from robocorba.spatial.elevator_state import Doors
from robocorba.spatial.floor_update import BodyKind, FloorUpdate, FloorView, Motions
from robocorba.spatial.grids import Floats, Longs, column_of, row_of

#: Largest age of floor data for a scan [s].
LAG_LIMIT_S = 1.0
#: Largest distance of the rays' start from the sensor [m].
MAX_RIM_M = 100.0
#: Rays of one call at most.
MAX_RAYS_AT_ONCE = 1_000_000
NO_NOISE = Noise()
#: Carrier number that denotes the robot at the pose of the scan.
ROBOT_AT_PLACE = -2


class Mount(NamedTuple):
    """Pose of a sensor in the robot's frame: ahead, left [m], heading [rad]."""

    ahead_m: float = 0.0
    left_m: float = 0.0
    heading: float = 0.0


@dataclass(frozen=True)
class ScanSpec:
    """Rays of a fan, measured from a rim at distance `rim_m` around the sensor [m]. Raises InvalidScan."""

    fan: Fan
    rim_m: float = 0.0
    noise: Noise = NO_NOISE
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.rim_m <= MAX_RIM_M:  # also refuses NaN
            raise InvalidScan("rim", f"{self.rim_m} is not 0 to {MAX_RIM_M:g} m")
        if self.rim_m + self.fan.range_m > MAX_RANGE_M:
            raise InvalidScan("range", f"ends more than {MAX_RANGE_M:g} m from the sensor")

    @cached_property
    def frame(self) -> tuple[float, float, float, float]:
        """First angle, step [rad], range and rim [m]."""
        return self.fan.first_rad, self.fan.step_rad, self.fan.range_m, float(self.rim_m)


class ScanResult(NamedTuple):
    """Result of a scan: simulated time [s], poses (m, 3) of the sensors, distances (m, rays) [m]."""

    time: float
    sensors: Floats
    distances: Floats


class VirtualSensor:
    """One thread updates it (`know`, `follow`); scans are thread-safe. `clock` returns the time [s]."""

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

    def know(self, building: Building) -> None:
        """Take over a map; forget floors that it does not have."""
        for name in [name for name in self._floors if name not in building.floors]:
            del self._floors[name]
        for name in building.floors:
            if name in self._floors:
                self._floors[name].set_obstacles(building)
            else:
                self._floors[name] = _SensedFloor(name, building)

    @property
    def floors(self) -> list[str]:
        return list(self._floors)

    def warm_up(self) -> None:
        """Compile or load the kernels, so that the first update and scan take no longer than the others."""
        for floor in list(self._floors.values())[:1]:
            place_discs(floor.view.motions, floor.view.moved, floor.view.moved, np.empty(0, bool), np.empty((0, 4)))
            scan_from(floor.sensed.scene, np.zeros((1, 3)), Mount(), NOBODY, LASER.rays, ScanSpec(LASER).frame)
        Noise(0.01).disturb(np.ones((1, 8)), 2.0, 0, np.zeros(1, np.int64), 0)

    def view(self, floor: str) -> FloorView:
        """The copy of a floor. Raises UnknownFloor."""
        return self._floor(floor).view

    def version(self, floor: str) -> int:
        """Version of the copy of a floor, for the request of later changes. Raises UnknownFloor."""
        return self.view(floor).version

    def follow(self, update: FloorUpdate, asked_at: float) -> None:
        """Apply an update of a floor that was requested from the Omni database at time `asked_at` of the clock [s].

        Raises UnknownFloor, UpdateMismatch."""
        self._floor(update.floor).follow(update, asked_at)

    def scan(self, floor: str, robots: Floats, mount: Mount, spec: ScanSpec, carrier: str | None = None) -> ScanResult:
        """Scan with sensors on robots (m, 3) of x, y [m], heading [rad].

        The scan ignores the robot that carries the sensor: `carrier`, or for None the robot at each pose. Raises
        InvalidScan, UnknownFloor, SensorBehind."""
        here = self._floor(floor)
        lag_s = self._clock() - here.valid_at
        if lag_s > LAG_LIMIT_S:
            raise SensorBehind(lag_s, LAG_LIMIT_S)
        _check_rays(len(robots), spec)
        time_s, fan = here.view.time, spec.fan
        scene, numbers = here.current
        number = ROBOT_AT_PLACE if carrier is None else numbers.get(carrier, NOBODY)
        is_placed, sensors, carriers, distances = scan_from(scene, robots, mount, number, fan.rays, spec.frame)
        if not is_placed:
            raise InvalidScan("robot", "the pose of the robot or of its sensor is not finite")
        if spec.noise:
            distances = spec.noise.disturb(distances, fan.range_m, spec.seed, carriers, 0)
        return ScanResult(time_s, sensors, distances)

    def scan_many(
        self, floors: Sequence[str], robots: Floats, mount: Mount, spec: ScanSpec, carrier: str | None = None
    ) -> list[ScanResult]:
        """Scan with sensors on robots (m, 3) on these floors; one result for each. Raises as `scan`."""
        _check_rays(len(robots), spec)
        found: dict[int, ScanResult] = {}
        for floor in dict.fromkeys(floors):
            places = [place for place, other in enumerate(floors) if other == floor]
            scanned = self.scan(floor, robots[places], mount, spec, carrier)
            for row, place in enumerate(places):
                found[place] = ScanResult(
                    scanned.time, scanned.sensors[row : row + 1], scanned.distances[row : row + 1]
                )
        return [found[place] for place in range(len(robots))]

    def _floor(self, name: str) -> _SensedFloor:
        if name not in self._floors:
            raise UnknownFloor("robot", name, list(self._floors))
        return self._floors[name]


def _check_rays(robots: int, spec: ScanSpec) -> None:
    if robots * spec.fan.count > MAX_RAYS_AT_ONCE:
        raise InvalidScan("rays", f"{robots} x {spec.fan.count} rays; at most {MAX_RAYS_AT_ONCE} in one call")


class _SensedFloor:
    """A floor: the copy from the Omni database, and the scene that sensors see."""

    def __init__(self, name: str, building: Building) -> None:
        self.view = FloorView(name)
        self.sensed = SensedScene()
        #: Time of the clock up to which the copy is certainly valid [s]; -inf before the first update.
        self.valid_at = float("-inf")
        self.numbers: dict[str, int] = {}
        self._discs = np.empty((0, 4))
        #: Rows of the robots in the view's motions.
        self._robots = np.empty(0, np.int64)
        self._is_object = np.empty(0, bool)
        #: Sides of the objects in their own frames, and the row of the object that each belongs to.
        self._sides, self._side_of = np.empty((0, 4)), np.empty(0, np.int64)
        self.set_obstacles(building)

    def set_obstacles(self, building: Building) -> None:
        floor = self.view.floor
        self.sensed.set_obstacles(fixed_obstacles(building, floor))
        self._doors = {
            name: lines_of([landing_doors(building, name, floor)])
            for name, elevator in building.elevators.items()
            if floor in elevator.floors()
        }
        self.sensed.move(self._discs, self._moving_segments())
        #: Scene and the robots' numbers in it, replaced together.
        self.current = self.sensed.scene, self.numbers

    def follow(self, update: FloorUpdate, asked_at: float) -> None:
        has_changed = self.view.apply(update)
        if has_changed:
            self._rebuild()
        view = self.view
        discs, has_pushed = place_discs(view.motions, view.moved, self._robots, self._is_object, self._discs)
        is_other = has_changed or update.elevators or has_pushed
        self.sensed.move(discs, self._moving_segments() if is_other else None)
        self._discs, self.valid_at = discs, asked_at
        self.current = self.sensed.scene, self.numbers

    def _rebuild(self) -> None:
        """Rebuild the discs and sides after bodies came or went."""
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
        objects = place_sides(self.view.motions, self._side_of, self._sides)
        return np.concatenate([objects, *(lines for name, lines in self._doors.items() if not self._is_open(name))])

    def _is_open(self, elevator: str) -> bool:
        state = self.view.elevators.get(elevator)
        return bool(state and state.floor == self.view.floor and state.doors is Doors.OPEN)


@kernel
def place_discs(
    motions: Motions, moved: Longs, robots: Longs, is_object: NDArray[np.bool_], discs: Floats
) -> tuple[Floats, bool]:
    """Current discs (n, 4) of the robots in rows `robots`, and whether one of the rows `moved` is an object."""
    placed = discs.copy()
    for disc in range(len(robots)):
        motion = motions[robots[disc]]
        placed[disc, 0], placed[disc, 1] = motion.x, motion.y
    for row in moved:
        if is_object[row]:
            return placed, True
    return placed, False


@kernel
def place_sides(motions: Motions, side_of: Longs, sides: Floats) -> Floats:
    """Transform sides (n, 4) from the objects' frames to the floor; `side_of` has the row of each side's object."""
    placed = np.empty_like(sides)
    for side in range(len(sides)):
        motion = motions[side_of[side]]
        c, s = math.cos(motion.heading), math.sin(motion.heading)
        for end in (0, 2):
            x, y = sides[side, end], sides[side, end + 1]
            placed[side, end] = motion.x + c * x - s * y
            placed[side, end + 1] = motion.y + s * x + c * y
    return placed


@kernel
def scan_from(
    scene: Scene,
    robots: Floats,
    mount: Mount,
    carrier: int,
    rays: tuple[Floats, Floats],
    frame: tuple[float, float, float, float],
) -> tuple[bool, Floats, Longs, Floats]:
    """Scan with sensors mounted on robots (m, 3), carried by the robot number `carrier`.

    Returns whether all poses are finite, poses (m, 3) of the sensors, numbers (m,) of their carriers, and distances
    (m, rays) from the rim [m]. rays: of a Fan. frame: of a ScanSpec."""
    ahead_m, left_m, heading = mount
    cosines, sines = rays
    first, step, range_m, rim_m = frame
    m = len(robots)
    sensors, carriers = np.empty((m, 3)), np.full(m, carrier)
    total = 0.0
    for row in range(m):
        x, y, facing = robots[row]
        c, s = math.cos(facing), math.sin(facing)
        sensors[row, 0] = x + c * ahead_m - s * left_m
        sensors[row, 1] = y + s * ahead_m + c * left_m
        sensors[row, 2] = (facing + heading) % (2 * math.pi)
        total += 0.0 * (sensors[row, 0] + sensors[row, 1] + sensors[row, 2])
    if total != 0.0:
        return False, sensors, carriers, np.empty((0, 0))
    if carrier == ROBOT_AT_PLACE:
        for row in range(m):
            carriers[row] = robot_at(robots[row, 0], robots[row, 1], scene)
    distances = cast(scene, sensors, carriers, cosines, sines, first, step, range_m + rim_m)
    if rim_m > 0.0:
        for row in range(m):
            for k in range(len(cosines)):
                met = distances[row, k] < range_m + rim_m
                distances[row, k] = max(distances[row, k] - rim_m, 0.0) if met else range_m
    return True, sensors, carriers, distances


@kernel
def robot_at(x: float, y: float, scene: Scene) -> int:
    """Number of the robot whose disc contains a point; NOBODY for none."""
    found, nearest = NOBODY, 0.0
    frame = scene.standing.frame
    cell = row_of(frame, y) * int(frame[3]) + column_of(frame, x)
    for at in range(scene.disc_start[cell], scene.disc_start[cell + 1]):
        disc_x, disc_y, radius, number = scene.discs[scene.disc_items[at]]
        beside = math.hypot(disc_x - x, disc_y - y) - radius
        if beside <= nearest:
            nearest, found = beside, int(number)
    return found
