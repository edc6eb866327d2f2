"""What stands in the way of a robot though it is not on the map: other robots, and objects that were moved."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.data_pool.entities import FloorEntity
from robocorba.robot.data_pool.snapshot import FloorSnapshot

#: A robot below this speed is stationary [m/s].
STATIONARY_M_S = 0.05
#: Robots farther away than this are no obstacles [m].
NEAR_M = 15.0
#: Clearance of paths to stationary robots [m]; less where the robot or its goal is nearer already.
CLEARANCE_M = 0.1
#: Minimum distance of the robot and of its goal outside such an area [m]. It leaves the path some clearance to other
#: obstacles.
MIN_CLEARANCE_M = 0.07
#: Corners of the polygon that represents a robot.
CORNERS = 16


def movable_objects(
    snapshot: FloorSnapshot, robot: str, held: str = "", policy: GivingWayPolicy = DEFAULT_POLICY
) -> TemporaryObstacles:
    """Movable objects on the floor of `robot` at their present poses, except `held`, which the robot holds."""
    own = snapshot.robot(robot)
    if own is None:
        return TemporaryObstacles()
    movable = (item for item in snapshot.objects() if item.is_movable and item.name != held)
    nearest_first = sorted(movable, key=lambda item: math.hypot(item.x - own.x, item.y - own.y))
    is_complete = len(nearest_first) <= policy.max_objects
    nearest = nearest_first[: policy.max_objects]
    areas, names = tuple((snapshot.floor, item.corners) for item in nearest), tuple(item.name for item in nearest)
    return TemporaryObstacles(areas, (snapshot.floor,) if is_complete else (), names)


def parked_robots(snapshot: FloorSnapshot, robot: str) -> TemporaryObstacles:
    """The other robots on the floor that stand still, at their full size."""
    others = [other for other in snapshot.robots if other.name != robot and not _drives(other)]
    areas = tuple((snapshot.floor, _disc(other, other.radius_m)) for other in others)
    return TemporaryObstacles(areas, names=tuple(other.name for other in others))


def temporary_obstacles(
    snapshot: FloorSnapshot,
    robot: str,
    also: str = "",
    goal: XY | None = None,
    held: str = "",
    policy: GivingWayPolicy = DEFAULT_POLICY,
) -> TemporaryObstacles:
    """Movable objects and stationary robots on the floor of `robot`.

    also: a robot that is included even if it moves. goal: a point [m] that stays outside the robots' areas if
    possible. held: the object that the robot holds."""
    own = snapshot.robot(robot)
    if own is None:
        return TemporaryObstacles()
    near = [found.robot for found in snapshot.robots_near(own.x, own.y, NEAR_M)]
    kept_free = [(own.x, own.y), *([goal] if goal else ())]
    blocking = [other for other in near if other.name == also or not _drives(other)][: policy.max_robots]
    objects = movable_objects(snapshot, robot, held, policy)
    discs = tuple((snapshot.floor, _disc_beside(other, kept_free, own.radius_m)) for other in blocking)
    names = tuple(other.name for other in blocking)
    return objects._replace(forbidden_areas=discs + objects.forbidden_areas, names=names + objects.names)


def _drives(robot: FloorEntity) -> bool:
    return math.hypot(robot.vx, robot.vy) >= STATIONARY_M_S


def _disc_beside(other: FloorEntity, kept_free: Sequence[XY], radius_m: float) -> tuple[XY, ...]:
    """A polygon around a robot with CLEARANCE_M; smaller if a robot of `radius_m` at these points would overlap it."""
    nearest_m = min(math.dist((other.x, other.y), point) for point in kept_free)
    corner_m = (other.radius_m + CLEARANCE_M) / math.cos(math.pi / CORNERS)
    corner_m = max(min(corner_m, nearest_m - radius_m - MIN_CLEARANCE_M), other.radius_m / 2)
    return _disc(other, corner_m)


def _disc(other: FloorEntity, corner_m: float) -> tuple[XY, ...]:
    angles = [math.tau * corner / CORNERS for corner in range(CORNERS)]
    return tuple((other.x + corner_m * math.cos(angle), other.y + corner_m * math.sin(angle)) for angle in angles)
