"""Other robots and obstacles near a robot, by its data pool, extrapolated to the present."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from shapely import Polygon

from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.collision_avoidance.temporary_obstacles import (
    movable_objects,
    parked_robots,
    temporary_obstacles,
)
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.kinematics.smartpal import BASE_LIMITS

#: A driving robot ignores robots farther away than this [m].
RANGE_M = 6.0


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


class Nearby(Protocol):
    """The robot `name` among others: its surroundings, and its policy of giving way. Thread-safe."""

    name: str
    policy: GivingWayPolicy

    def others(self, x: float, y: float) -> list[OtherRobot]:
        """Robots within RANGE_M of a point [m]. Raises NotReachable if their positions are unknown."""

    def clearance_m(self, x: float, y: float) -> float:
        """Distance of a point from walls and objects [m]; infinite where there are none. Raises NotReachable."""

    def shaft(self, elevator: str) -> Polygon | None:
        """The shaft of an elevator on this floor [m]; None while the floor is not loaded."""

    def movable_objects(self, held: str) -> TemporaryObstacles:
        """As temporary_obstacles.movable_objects; empty while the floor is not loaded."""

    def temporary_obstacles(self, also: str = "", goal: XY | None = None, held: str = "") -> TemporaryObstacles:
        """As temporary_obstacles.temporary_obstacles; empty while the floor is not loaded."""


class PoolNearby:
    """Nearby by a data pool that a PoolFollower keeps up to date."""

    def __init__(self, pool: DataPool, name: str, policy: GivingWayPolicy = DEFAULT_POLICY) -> None:
        self._pool, self.name, self.policy = pool, name, policy

    def others(self, x: float, y: float) -> list[OtherRobot]:
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
            for _, other in snapshot.robots_near(x, y, RANGE_M)
        ]

    def clearance_m(self, x: float, y: float) -> float:
        near = self._pool.loaded_snapshot().nearest_non_robot(x, y)
        return near.distance_m if near else math.inf

    def shaft(self, elevator: str) -> Polygon | None:
        walls = self._pool.snapshot().walls
        return walls.shafts.get(elevator) if walls else None

    def movable_objects(self, held: str) -> TemporaryObstacles:
        return movable_objects(self._pool.snapshot(), self.name, held, self.policy)

    def parked_robots(self) -> TemporaryObstacles:
        """As temporary_obstacles.parked_robots; empty while the floor is not loaded."""
        return parked_robots(self._pool.snapshot(), self.name)

    def temporary_obstacles(self, also: str = "", goal: XY | None = None, held: str = "") -> TemporaryObstacles:
        return temporary_obstacles(self._pool.snapshot(), self.name, also, goal, held, self.policy)
