"""What is near a robot by its data pool: other robots, extrapolated to the present, and obstacles that are not on the
map."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import into, out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.snapshot import FloorEntity
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M

#: A robot below this speed is stationary [m/s].
STATIONARY_M_S = 0.05
#: Clearance of paths to stationary robots [m]; less where the robot or its goal is nearer already.
CLEARANCE_M = 0.1
#: Minimum distance of the robot and of its goal outside such an area [m]. It leaves the path some clearance to other
#: obstacles.
MIN_CLEARANCE_M = 0.07
#: Distance from a robot's centre up to which it holds what it faces [m].
HOLDS_WITHIN_M = 0.7
#: Distance from its rim at which a robot may be seen, as others know its place [m].
SEEN_WITHIN_M = 0.2
#: Clearance of paths to what the robot sees [m]: more comes into sight on the way.
SEEN_CLEARANCE_M = 0.05
#: By how much more than their size a held object and its other carriers are taken to fill [m], as grips give.
CARRIED_MARGIN_M = 0.1


class OtherRobot(NamedTuple):
    """Another robot now: position [m], velocity along the floor's axes [m/s], heading [rad]. radius_m includes what the
    robot may have deviated since it was observed."""

    name: str
    x: float
    y: float
    vx: float
    vy: float
    heading: float
    radius_m: float


class Nearby:
    """The robot `name` among others: its surroundings, and its policy of giving way. Thread-safe. pool: one that a
    PoolFollower keeps up to date. seen: returns what the robot itself sees, the same object until it changes, and
    check_seen raises NotReachable while that is old. reports: whether a robot reports its pose; one that does not is no
    robot here, only what is seen of it."""

    def __init__(
        self,
        pool: DataPool,
        name: str,
        policy: GivingWayPolicy = DEFAULT_POLICY,
        seen: Callable[[], TemporaryObstacles] = lambda: NO_OBSTACLES,
        check_seen: Callable[[], None] = lambda: None,
        reports: Callable[[str], bool] = lambda name: True,
    ) -> None:
        self._pool, self.name, self.policy, self._seen, self._reports = pool, name, policy, seen, reports
        self.check_seen = check_seen
        self._outlined = _Outlines(NO_OBSTACLES, "")

    def others(self, x: float, y: float) -> list[OtherRobot]:
        """Robots within 6 m of a point [m], beyond which a driving robot ignores them. Raises NotReachable if their
        positions are unknown."""
        lag_s, snapshot = self._pool.lag_s, self._pool.current_snapshot()
        deviation_m = BASE_LIMITS.acceleration * lag_s * lag_s / 2.0
        return [
            OtherRobot(
                other.name,
                other.x + other.vx * lag_s,
                other.y + other.vy * lag_s,
                other.vx,
                other.vy,
                other.heading,
                other.radius_m + deviation_m,
            )
            for _, other in snapshot.robots_near(x, y, 6.0)
            if self._reports(other.name)
        ]

    def robot_at(self, x: float, y: float) -> OtherRobot | None:
        """The robot whose rim is nearest to a point [m] and at most SEEN_WITHIN_M away; None if positions are unknown,
        too."""
        with contextlib.suppress(NotReachable):
            near = [(math.hypot(other.x - x, other.y - y) - other.radius_m, other) for other in self.others(x, y)]
            return min(((gap, other) for gap, other in near if gap < SEEN_WITHIN_M), default=(0.0, None))[1]
        return None

    def clearance_m(self, x: float, y: float) -> float:
        """Distance of a point from walls and objects [m]; infinite where there are none. Raises NotReachable."""
        near = self._pool.loaded_snapshot().nearest_non_robot(x, y)
        seen_m = shapely.distance(self._outlines.polygons, Point(x, y)).min(initial=math.inf)
        return min(near.distance_m if near else math.inf, float(seen_m))

    def shaft(self, elevator: str) -> Polygon | None:
        """The shaft of an elevator on this floor [m]; None while the floor is not loaded."""
        walls = self._pool.snapshot().walls
        return walls.shafts.get(elevator) if walls else None

    # ---- what the robot sees ----

    def explains(self, floor: str, points: Floats, within_m: Floats) -> npt.NDArray[np.bool_]:
        """Which points (n, 2) of a floor are within some distances (n,) of what is known there [m]: walls, doors,
        objects, robots that report their poses. Raises NotReachable."""
        snapshot = self._pool.current_snapshot()
        own = snapshot.robot(self.name)
        if snapshot.floor != floor or own is None:
            raise NotReachable(f"the data pool is not on floor {floor}")
        found = snapshot.explains(points, within_m)
        for other in self.others(own.x, own.y):
            found |= np.hypot(*(points - (other.x, other.y)).T) <= other.radius_m + np.maximum(within_m, SEEN_WITHIN_M)
        return found

    @property
    def seen(self) -> TemporaryObstacles:
        """What the robot sees: the same object until that changes."""
        return self._seen()

    def seen_around(self, x: float, y: float) -> Floats:
        """Points (n, 2) on the outlines of what the robot sees, at most 0.1 m apart, from a point [m]."""
        return self._outlines.points - (x, y)

    def seen_on(self, line: Sequence[XY], radius_m: float) -> str:
        """The name of what the robot sees that its disc touches on a line [m]; empty for nothing."""
        touched = np.flatnonzero(shapely.dwithin(self._outlines.polygons, LineString([*line, line[-1]]), radius_m))
        return self._outlines.names[touched[0]] if len(touched) else ""

    def with_seen(self, obstacles: TemporaryObstacles, robot: XY) -> TemporaryObstacles:
        """Obstacles, and what the robot sees, with SEEN_CLEARANCE_M around it; but nothing where the robot is [m]."""
        areas, names = list(obstacles.forbidden_areas), list(obstacles.names)
        disc = Point(robot).buffer(RADIUS_M + MIN_CLEARANCE_M)
        seen = self._seen()
        for (floor, corners), name in zip(seen.forbidden_areas, seen.names, strict=True):
            around = Polygon(corners).buffer(SEEN_CLEARANCE_M, join_style="mitre", mitre_limit=2.0)
            for part in shapely.get_parts(around.difference(disc)):
                areas.append((floor, tuple(map(tuple, shapely.get_coordinates(part.exterior)[:-1].tolist()))))
                names.append(name)
        return obstacles._replace(forbidden_areas=tuple(areas), names=tuple(names))

    @property
    def _outlines(self) -> _Outlines:
        seen, floor, known = self._seen(), self._pool.floor, self._outlined
        if known.seen is not seen or known.floor != floor:
            known = self._outlined = _Outlines(seen, floor)
        return known

    # ---- what stands in the way though it is not on the map; empty while the floor is not loaded ----

    def movable_objects(self, held: str = "") -> TemporaryObstacles:
        """Movable objects on the robot's floor at their present poses, except `held`, which the robot holds."""
        snapshot = self._pool.snapshot()
        own = snapshot.robot(self.name)
        if own is None:
            return TemporaryObstacles()
        movable = (item for item in snapshot.objects() if item.is_movable and item.name != held)
        nearest_first = sorted(movable, key=lambda item: math.hypot(item.x - own.x, item.y - own.y))
        is_complete = len(nearest_first) <= self.policy.max_objects
        nearest = nearest_first[: self.policy.max_objects]
        areas, names = tuple((snapshot.floor, item.corners) for item in nearest), tuple(item.name for item in nearest)
        return TemporaryObstacles(areas, (snapshot.floor,) if is_complete else (), names)

    def carried(self, held: str) -> BaseGeometry | None:
        """What moves with the robot, in its frame [m]: the object `held`, and the robots that face it within their
        hands' reach. None if it holds nothing, or its pose is unknown."""
        snapshot = self._pool.snapshot()
        own, item = snapshot.robot(self.name), snapshot.object(held) if held else None
        if own is None or item is None:
            return None
        outline = Polygon(item.corners)
        carriers = [
            Point(other.x, other.y).buffer(other.radius_m)
            for _, other in snapshot.robots_near(own.x, own.y, 2.0 * (item.radius_m + HOLDS_WITHIN_M))
            if _hands_of(other).intersects(outline)
        ]
        around = shapely.union_all([outline, *carriers]).buffer(CARRIED_MARGIN_M)
        frame = own.x, own.y, own.heading
        return shapely.transform(around, lambda points: np.array([into(x, y, frame) for x, y in points]))

    def parked_robots(self) -> TemporaryObstacles:
        """The other robots on the floor that stand still, at their full size."""
        snapshot = self._pool.snapshot()
        others = [
            other
            for other in snapshot.robots
            if other.name != self.name and not _drives(other) and self._reports(other.name)
        ]
        areas = tuple((snapshot.floor, _disc(other, other.radius_m)) for other in others)
        return TemporaryObstacles(areas, names=tuple(other.name for other in others))

    def temporary_obstacles(self, also: str = "", goal: XY | None = None, held: str = "") -> TemporaryObstacles:
        """Movable objects, and stationary robots within 15 m, on the robot's floor.

        also: a robot that is included even if it moves. goal: a point [m] that stays outside the robots' areas if
        possible. held: the object that the robot holds."""
        snapshot = self._pool.snapshot()
        own = snapshot.robot(self.name)
        if own is None:
            return TemporaryObstacles()
        near = [other for _, other in snapshot.robots_near(own.x, own.y, 15.0) if self._reports(other.name)]
        kept_free = [(own.x, own.y), *([goal] if goal else ())]
        blocking = [other for other in near if other.name == also or not _drives(other)][: self.policy.max_robots]
        objects = self.movable_objects(held)
        discs = tuple((snapshot.floor, _disc_beside(other, kept_free, own.radius_m)) for other in blocking)
        names = tuple(other.name for other in blocking)
        return objects._replace(forbidden_areas=discs + objects.forbidden_areas, names=names + objects.names)


class _Outlines:
    """What the robot sees on a floor, as polygons, and points (n, 2) on their borders, at most 0.1 m apart [m]."""

    def __init__(self, seen: TemporaryObstacles, floor: str) -> None:
        self.seen, self.floor = seen, floor
        here = [number for number, (where, _) in enumerate(seen.forbidden_areas) if where == floor]
        self.names = [seen.names[number] for number in here]
        self.polygons = np.array([Polygon(seen.forbidden_areas[number][1]) for number in here], object)
        self.points = shapely.get_coordinates(shapely.segmentize(self.polygons, 0.1))


def _drives(robot: FloorEntity) -> bool:
    return math.hypot(robot.vx, robot.vy) >= STATIONARY_M_S


def _hands_of(robot: FloorEntity) -> LineString:
    """From a robot's centre to as far ahead as it holds."""
    return LineString([(robot.x, robot.y), out_of(HOLDS_WITHIN_M, 0.0, (robot.x, robot.y, robot.heading))])


def _disc_beside(other: FloorEntity, kept_free: Sequence[XY], radius_m: float) -> tuple[XY, ...]:
    """A polygon around a robot with CLEARANCE_M; smaller if a robot of `radius_m` at these points would overlap it."""
    nearest_m = min(math.dist((other.x, other.y), point) for point in kept_free)
    corner_m = (other.radius_m + CLEARANCE_M) / math.cos(math.pi / 16)
    corner_m = max(min(corner_m, nearest_m - radius_m - MIN_CLEARANCE_M), other.radius_m / 2)
    return _disc(other, corner_m)


def _disc(other: FloorEntity, corner_m: float) -> tuple[XY, ...]:
    """A polygon of 16 corners around a robot."""
    angles = [math.tau * corner / 16 for corner in range(16)]
    return tuple((other.x + corner_m * math.cos(angle), other.y + corner_m * math.sin(angle)) for angle in angles)
