"""Whom and what a robot has around itself, as its data pool knows it, and where the others are by now."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from robocorba.collision_avoidance.temporary_obstacles import Standing, objects, standing
from robocorba.data_pool.pool import DataPool
from robocorba.errors.services import NotReachable
from robocorba.kinematics.smartpal import BASE
from robocorba.spatial.pose import XY

#: Nobody farther away matters to a robot that drives, m.
RANGE_M = 6.0
#: What is known is taken on to now; what is older than this is not known, s.
STALE_S = 0.3


class Other(NamedTuple):
    """Another robot now: m, m/s along the floor's axes, and rad. It is within radius_m, whatever it has done since."""

    name: str
    x: float
    y: float
    vx: float
    vy: float
    heading: float
    radius_m: float


class Nearby(Protocol):
    """Around a robot called `name`. Any thread may ask."""

    name: str

    def others(self, x: float, y: float) -> list[Other]:
        """Robots that are near to a place. Raises NotReachable where that is not known."""

    def room_m(self, x: float, y: float) -> float:
        """How far walls and objects are from a place, m; infinite where there are none. Raises NotReachable."""

    def objects(self, held: str) -> Standing:
        """As `objects` of the floor; nothing where that is not known."""

    def standing(self, also: str = "", goal: XY | None = None, held: str = "") -> Standing:
        """As `standing` of the floor; nothing where that is not known."""


class PoolNearby:
    """By a data pool that somebody keeps following."""

    def __init__(self, pool: DataPool, name: str) -> None:
        self._pool, self.name = pool, name

    def others(self, x: float, y: float) -> list[Other]:
        lag_s = self._pool.lag_s
        if lag_s > STALE_S:
            raise NotReachable(f"nobody tells where other robots are: {self._pool.problem or 'the data pool lags'}")
        wider_m = BASE.acceleration * lag_s * lag_s / 2.0
        return [
            Other(
                one.name,
                one.x + one.vx * lag_s,
                one.y + one.vy * lag_s,
                one.vx,
                one.vy,
                one.heading,
                one.radius_m + wider_m,
            )
            for _, one in self._pool.robots_near(x, y, RANGE_M)
        ]

    def room_m(self, x: float, y: float) -> float:
        near = self._pool.nearest_thing(x, y)
        return near.distance_m if near else math.inf

    def objects(self, held: str) -> Standing:
        seen = self._pool.snapshot()
        return objects(seen, self.name, held) if seen.is_known else Standing()

    def standing(self, also: str = "", goal: XY | None = None, held: str = "") -> Standing:
        seen = self._pool.snapshot()
        return standing(seen, self.name, also, goal, held) if seen.is_known else Standing()
