"""The state of a floor at one time, for the 3D view and programs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point

from robocorba.errors.paths import InvalidPoint, InvalidRequest
from robocorba.map_editor.model import MapObject
from robocorba.map_editor.movable import object_outline
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, Motions
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.data_pool.walls import NearbyObstacle, Walls, nearest_of

#: Updates that a pool remembers: some 4 s. A reader with an older version gets the whole floor.
MAX_UPDATES = 128
Updates = tuple[FloorUpdate, ...]


class FloorEntity(NamedTuple):
    """A robot or an object: x, y [m] and heading [rad] on its floor, velocity along the floor's axes [m/s] and turn
    [rad/s].

    radius_m: of a robot, or of the circle around an object. outline: of an object in its own frame, the corners of a
    polygon or the two ends of a line. mass_kg: 0 for an object that can't be moved, whose mass maps don't contain."""

    name: str
    kind: BodyKind
    x: float
    y: float
    heading: float
    vx: float
    vy: float
    turn: float
    radius_m: float
    outline: tuple[XY, ...]
    mass_kg: float
    is_movable: bool
    #: Of the body in the simulation, its identity while names change; 0 for an object that can't be moved.
    number: int = 0

    @property
    def corners(self) -> tuple[XY, ...]:
        """The outline in the floor's frame [m]."""
        return tuple(out_of(x, y, (self.x, self.y, self.heading)) for x, y in self.outline)


def entity_of_body(body: Body, motion: np.void) -> FloorEntity:
    """An entity from a body and its row of MOTION."""
    _, vx, vy, turn, x, y, heading = motion.tolist()
    shape = body.radius_m, body.outline, body.mass_kg
    return FloorEntity(body.name, body.kind, x, y, heading, vx, vy, turn, *shape, is_movable=True, number=body.number)


def entity_of_map_object(item: MapObject) -> FloorEntity:
    """An object that can't be moved, at its pose on the map."""
    corners = shapely.get_coordinates(object_outline(item)).tolist()
    if corners[0] == corners[-1]:  # a ring
        corners.pop()
    radius_m = max(math.hypot(x, y) for x, y in corners)
    pose, shape = (*item.at, item.heading), tuple((x, y) for x, y in corners)
    return FloorEntity(item.name, BodyKind.OBJECT, *pose, 0.0, 0.0, 0.0, radius_m, shape, 0.0, is_movable=False)


class FloorBodies:
    """Robots and movable objects on a floor, in the order of its motions. own_name: the pool's own robot, which is not
    among `others`."""

    def __init__(self, bodies: tuple[Body, ...] = (), own_name: str = "") -> None:
        self.all = bodies
        self.row_of = {(body.kind, body.name): row for row, body in enumerate(bodies)}
        is_robot = np.array([body.kind is BodyKind.ROBOT for body in bodies], bool)
        is_other = np.array([body.name != own_name for body in bodies], bool)
        self.others, self.objects = np.flatnonzero(is_robot & is_other), np.flatnonzero(~is_robot)
        self.radii_m = np.array([body.radius_m for body in bodies], float)


NO_BODIES = FloorBodies()
NO_MOTIONS: Motions = np.empty(0, MOTION)
NO_ELEVATORS: Mapping[str, ElevatorState] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class FloorSnapshot:
    """A floor as the Omni database reported it; immutable and thread-safe.

    version: of the floor in the database, WHOLE until the first update. time: of the simulation [s]. valid_at: when the
    update was requested, by the pool's clock [s]: its content is at least as new."""

    floor: str
    walls: Walls | None = None
    version: int = WHOLE
    time: float = 0.0
    map_version: int = 0
    bodies: FloorBodies = NO_BODIES
    #: Rows of MOTION, in the order of `bodies`.
    motions: Motions = field(default_factory=lambda: NO_MOTIONS, repr=False)
    #: Elevators that serve the floor, by name.
    elevators: Mapping[str, ElevatorState] = field(default_factory=lambda: NO_ELEVATORS)
    valid_at: float = -math.inf
    #: The last updates that led to `version`.
    recent: Updates = field(default=(), repr=False)

    @property
    def is_known(self) -> bool:
        return self.version != WHOLE

    @property
    def robots(self) -> list[FloorEntity]:
        """All robots on the floor, including the pool's own."""
        return [self._entity(row) for row, body in enumerate(self.bodies.all) if body.kind is BodyKind.ROBOT]

    def robot(self, name: str) -> FloorEntity | None:
        """The robot of this name; None if it is not on this floor."""
        row = self.bodies.row_of.get((BodyKind.ROBOT, name))
        return None if row is None else self._entity(row)

    def object(self, name: str) -> FloorEntity | None:
        """The object of this name; None if it is not on this floor."""
        row = self.bodies.row_of.get((BodyKind.OBJECT, name))
        if row is not None:
            return self._entity(row)
        fixed = self.walls.objects.get(name) if self.walls else None
        return entity_of_map_object(fixed) if fixed else None

    def objects(self, pattern: str = "*") -> list[FloorEntity]:
        """Objects whose names match `pattern`, in which * matches any text and ? one character; sorted by name."""
        movable = [row for row in self.bodies.objects.tolist() if fnmatchcase(self.bodies.all[row].name, pattern)]
        found = [self._entity(row) for row in movable]
        if self.walls:
            fixed = self.walls.objects.values()
            found += [entity_of_map_object(item) for item in fixed if fnmatchcase(item.name, pattern)]
        return sorted(found, key=lambda entity: entity.name)

    def robots_near(self, x: float, y: float, range_m: float) -> list[tuple[float, FloorEntity]]:
        """Other robots whose rims are within `range_m` of a point (x, y) [m], nearest first, each after the distance to
        its rim [m], 0 inside it.

        Raises InvalidPoint, InvalidRequest."""
        _check_point(x, y)
        if not range_m >= 0.0:  # also refuses NaN
            raise InvalidRequest("range_m", f"{range_m} is not 0 or more")
        rows = self.bodies.others
        distances_m = self._distances_m(rows, x, y)
        order = np.argsort(distances_m, kind="stable")
        return [
            (max(float(distances_m[i]), 0.0), self._entity(int(rows[i]))) for i in order if distances_m[i] <= range_m
        ]

    def nearest_non_robot(self, x: float, y: float) -> NearbyObstacle | None:
        """The fixed obstacle or object nearest to a point (x, y) [m]; None on an empty floor. Raises InvalidPoint."""
        _check_point(x, y)
        fixed = self.walls.nearest(x, y, self.elevators) if self.walls else None
        limit_m = fixed.distance_m if fixed else math.inf
        return min(self._nearer_objects(x, y, limit_m), default=fixed)

    def _nearer_objects(self, x: float, y: float, limit_m: float) -> Iterator[NearbyObstacle]:
        """Movable objects nearer than `limit_m`, each nearer than the one before."""
        rows, point = self.bodies.objects, Point(x, y)
        distances_m = self._distances_m(rows, x, y)
        for i in np.argsort(distances_m):
            if distances_m[i] >= limit_m:  # its circle and those of all remaining objects are too far away
                return
            entity = self._entity(rows[i])
            near = nearest_of(point, shapely.polygons(entity.corners), entity.name)
            if near.distance_m < limit_m:
                limit_m = near.distance_m
                yield near

    def explains(self, points: Floats, within_m: Floats) -> npt.NDArray[np.bool_]:
        """Which points (n, 2) are within some distances (n,) of walls, doors or objects [m]."""
        found = self.walls.near(points, within_m) if self.walls else np.zeros(len(points), bool)
        if not len(points):
            return found
        (x, y), rows, places = points.mean(axis=0).tolist(), self.bodies.objects, shapely.points(points)
        reach_m = float(np.hypot(*(points - (x, y)).T).max() + within_m.max())
        for row in rows[self._distances_m(rows, x, y) <= reach_m].tolist():
            found |= shapely.dwithin(places, shapely.polygons(self._entity(row).corners), within_m)
        return found

    def _distances_m(self, rows: Longs, x: float, y: float) -> Floats:
        """Distances (n,) from a point to the circles around bodies [m]; negative inside them."""
        motions = self.motions[rows]
        return np.hypot(motions["x"] - x, motions["y"] - y) - self.bodies.radii_m[rows]

    def _entity(self, row: int) -> FloorEntity:
        return entity_of_body(self.bodies.all[row], self.motions[row])

    def as_update(self) -> FloorUpdate:
        """The whole floor, for a reader without an earlier version."""
        came, elevators = list(self.bodies.all), dict(self.elevators)
        return FloorUpdate(
            self.floor, WHOLE, self.version, self.time, self.map_version, came, [], self.motions, elevators
        )

    def changes(self, version: int) -> FloorUpdate:
        """What changed since a version; the whole floor if that version is not remembered."""
        whole = self.as_update()
        updates = () if version == self.version else since(self.recent, version)
        return whole if updates is None or not self.is_known else merged(updates, whole)


def _check_point(x: float, y: float) -> None:
    for name, value in (("x", x), ("y", y)):
        if not math.isfinite(value):
            raise InvalidPoint("place", name, f"{value} is not a finite number")


# ---- the last updates, for readers that have an earlier version ----


def continued(recent: Updates, update: FloorUpdate) -> Updates:
    """The updates with one more that continues the last one; none after a whole floor, which readers get instead.
    Without changes, as before."""
    if update.since == WHOLE:
        return ()
    if update.version == update.since:
        return recent
    return (*recent[1 - MAX_UPDATES :], update)


def since(recent: Sequence[FloorUpdate], version: int) -> Sequence[FloorUpdate] | None:
    """The updates that lead from a version to the last one; None if it is not remembered."""
    for index, update in enumerate(recent):
        if update.since == version:
            return recent[index:]
    return None


def merged(updates: Sequence[FloorUpdate], last: FloorUpdate) -> FloorUpdate:
    """One update with the effect of all `updates`, in their order; time and map are those of `last`."""
    came: dict[int, Body] = {}
    went: dict[int, None] = {}
    rows: dict[int, np.void] = {}
    elevators: dict[str, ElevatorState] = {}
    for update in updates:
        for number in update.went:
            came.pop(number, None)
            rows.pop(number, None)
            went[number] = None
        came.update((body.number, body) for body in update.came)
        rows.update(zip(update.motions["number"].tolist(), update.motions, strict=True))
        elevators.update(update.elevators)
    first = updates[0].since if updates else last.version
    motions = np.array(list(rows.values()), MOTION) if rows else np.empty(0, MOTION)
    return last._replace(since=first, came=list(came.values()), went=list(went), motions=motions, elevators=elevators)
