"""A floor at one moment, as the 3D view and programs ask for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Point

from robocorba.data_pool.things import Thing, fixed, moving
from robocorba.data_pool.walls import Nearest, Walls, nearest_of
from robocorba.errors.paths import InvalidPoint, InvalidRequest
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, Motions
from robocorba.spatial.grids import Floats, Longs


class Near(NamedTuple):
    """A robot, and how far its rim is, m; 0 within it."""

    distance_m: float
    robot: Thing


class Bodies:
    """Who is on a floor, in the order of its motions. `oneself` is no obstacle to oneself."""

    def __init__(self, bodies: tuple[Body, ...] = (), oneself: str = "") -> None:
        self.all = bodies
        self.row_of = {(body.kind, body.name): row for row, body in enumerate(bodies)}
        is_robot = np.array([body.kind is BodyKind.ROBOT for body in bodies], bool)
        is_other = np.array([body.name != oneself for body in bodies], bool)
        self.others, self.objects = np.flatnonzero(is_robot & is_other), np.flatnonzero(~is_robot)
        self.radii_m = np.array([body.radius_m for body in bodies], float)


NOBODY = Bodies()
NO_MOTIONS: Motions = np.empty(0, MOTION)
NO_ELEVATORS: Mapping[str, ElevatorState] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A floor as the Omni database told it; nothing of it changes any more, and any thread may read it.

    version: that of the database, WHOLE as long as nothing is known. time: the simulation's, s. true_at: when all this
    was so at the latest, by the clock of the pool, s."""

    floor: str
    walls: Walls | None = None
    version: int = WHOLE
    time: float = 0.0
    map_version: int = 0
    bodies: Bodies = NOBODY
    #: Rows of MOTION, in the order of the bodies.
    motions: Motions = field(default_factory=lambda: NO_MOTIONS, repr=False)
    #: That serve the floor, by name.
    elevators: Mapping[str, ElevatorState] = field(default_factory=lambda: NO_ELEVATORS)
    true_at: float = -math.inf

    @property
    def is_known(self) -> bool:
        return self.version != WHOLE

    @property
    def robots(self) -> list[Thing]:
        """All of them, oneself included."""
        return [self._thing(row) for row, body in enumerate(self.bodies.all) if body.kind is BodyKind.ROBOT]

    def robot(self, name: str) -> Thing | None:
        """None where it is not on this floor."""
        row = self.bodies.row_of.get((BodyKind.ROBOT, name))
        return None if row is None else self._thing(row)

    def object(self, name: str) -> Thing | None:
        """None where it is not on this floor."""
        row = self.bodies.row_of.get((BodyKind.OBJECT, name))
        if row is not None:
            return self._thing(row)
        stands = self.walls.objects.get(name) if self.walls else None
        return fixed(stands) if stands else None

    def objects(self, pattern: str = "*") -> list[Thing]:
        """Those whose names are like `pattern`, in which * stands for any text and ? for one character; by name."""
        can_move = [row for row in self.bodies.objects.tolist() if fnmatchcase(self.bodies.all[row].name, pattern)]
        found = [self._thing(row) for row in can_move]
        if self.walls:
            found += [fixed(thing) for thing in self.walls.objects.values() if fnmatchcase(thing.name, pattern)]
        return sorted(found, key=lambda thing: thing.name)

    def robots_near(self, x: float, y: float, range_m: float) -> list[Near]:
        """Other robots whose rims are no farther than `range_m` from a place, the nearest first.

        Raises InvalidPoint, InvalidRequest."""
        _check_place(x, y)
        if not range_m >= 0.0:  # also refuses NaN
            raise InvalidRequest("range_m", f"{range_m} is not 0 or more")
        rows = self.bodies.others
        beside = self._beside(rows, x, y)
        order = np.argsort(beside, kind="stable")
        return [Near(max(float(beside[i]), 0.0), self._thing(int(rows[i]))) for i in order if beside[i] <= range_m]

    def nearest_obstacle(self, x: float, y: float) -> Nearest | None:
        """The nearest to a place, m, of what stands, objects, and robots other than oneself; None for an empty floor.

        Raises InvalidPoint."""
        found = (self.nearest_thing(x, y), self._nearest_robot(x, y))
        return min((near for near in found if near), default=None)

    def nearest_thing(self, x: float, y: float) -> Nearest | None:
        """The same, whatever robots there are. Raises InvalidPoint."""
        _check_place(x, y)
        stands = self.walls.nearest(x, y, self.elevators) if self.walls else None
        found = [stands] if stands else []
        limit_m = stands.distance_m if stands else math.inf
        return min([*found, *self._nearer_objects(x, y, limit_m)], default=None)

    def _nearest_robot(self, x: float, y: float) -> Nearest | None:
        rows = self.bodies.others
        if not len(rows):
            return None
        beside = self._beside(rows, x, y)
        row = int(rows[np.argmin(beside)])
        motion, radius_m, away = self.motions[row], self.bodies.radii_m[row], float(beside.min())
        if away <= 0.0:
            return Nearest(0.0, x, y, self.bodies.all[row].name)
        share = radius_m / (radius_m + away)
        middle_x, middle_y = float(motion["x"]), float(motion["y"])
        at = middle_x + share * (x - middle_x), middle_y + share * (y - middle_y)
        return Nearest(away, *at, self.bodies.all[row].name)

    def _nearer_objects(self, x: float, y: float, limit_m: float) -> Iterator[Nearest]:
        """Those that can be moved and are nearer than `limit_m`; the last one is the nearest."""
        rows, place = self.bodies.objects, Point(x, y)
        beside = self._beside(rows, x, y)
        for i in np.argsort(beside):
            if beside[i] >= limit_m:  # the circle around it is too far away, and so are those of all the others
                return
            thing = self._thing(rows[i])
            near = nearest_of(place, shapely.polygons(thing.corners), thing.name)
            if near.distance_m < limit_m:
                limit_m = near.distance_m
                yield near

    def _beside(self, rows: Longs, x: float, y: float) -> Floats:
        """How far the circles around bodies are from a place, m; negative within them."""
        motions = self.motions[rows]
        return np.hypot(motions["x"] - x, motions["y"] - y) - self.bodies.radii_m[rows]

    def _thing(self, row: int) -> Thing:
        return moving(self.bodies.all[row], self.motions[row])

    def as_update(self) -> FloorUpdate:
        """The whole floor, for somebody who knows nothing of it."""
        came, elevators = list(self.bodies.all), dict(self.elevators)
        return FloorUpdate(
            self.floor, WHOLE, self.version, self.time, self.map_version, came, [], self.motions, elevators
        )


def _check_place(x: float, y: float) -> None:
    for name, value in (("x", x), ("y", y)):
        if not math.isfinite(value):
            raise InvalidPoint("place", name, f"{value} is not a finite number")
