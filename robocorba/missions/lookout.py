"""What comes into the way of a carried body, seen by the data pool of the leader."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import shapely
import shapely.affinity
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory

#: How far ahead the body's path is watched, and how far ahead it must be free for the body to go on [s of its
#: trajectory].
LOOK_S, STOP_S = 4.0, 2.0
#: Distance between the poses that are examined [s].
STEP_S = 0.25
#: Others move on as now for this time [s].
PREDICTED_S = 1.0
#: What is nearer to the body than this is in its way [m]; plans keep more from what they know.
GAP_M = 0.02


class Seen(NamedTuple):
    """A robot or an object: where it stands [m], and its velocity along the floor's axes [m/s]. number: its identity
    while edits of the map change names; 0 if it has none."""

    name: str
    is_robot: bool
    shape: BaseGeometry
    vx: float
    vy: float
    number: int = 0

    @property
    def swept(self) -> BaseGeometry:
        """What it covers within PREDICTED_S."""
        if self.vx == self.vy == 0.0:
            return self.shape
        there = shapely.affinity.translate(self.shape, self.vx * PREDICTED_S, self.vy * PREDICTED_S)
        return shapely.union_all([self.shape, there]).convex_hull


#: Returns the robots and movable objects on the floor. Raises NotReachable while they are unknown.
Look = Callable[[], Sequence[Seen]]


class Ahead(NamedTuple):
    """What is in the way. after_s: time until the body is there, 0 if it is now."""

    name: str
    is_robot: bool
    x: float
    y: float
    after_s: float


class Lookout:
    """Watches the way of a body along its trajectory. footprint: of the body, its carriers included, in its frame [m].
    team: names of the robots and of the object that move with it."""

    def __init__(self, trajectory: Trajectory, footprint: BaseGeometry, team: Collection[str], look: Look) -> None:
        self._trajectory, self._footprint, self._team, self._look = trajectory, footprint, team, look
        #: Numbers of those of the team that have been seen, by name.
        self._numbers: dict[str, int] = {}
        self._reach_m = max(math.hypot(x, y) for x, y in shapely.get_coordinates(footprint).tolist())

    def ahead(self, trajectory_s: float) -> Ahead | None:
        """The first thing in the way within LOOK_S after this time of the trajectory; None if the way is free.

        Raises NotReachable."""
        others = self._others()
        if not others:
            return None
        end_s = min(trajectory_s + LOOK_S, self._trajectory.duration)
        count = max(1, math.ceil((end_s - trajectory_s) / STEP_S))
        for number in range(count + 1):
            after_s = number / count * max(0.0, end_s - trajectory_s)
            pose = self._trajectory.at(trajectory_s + after_s)[0]
            near = [seen for seen in others if seen.shape.distance(Point(pose[:2])) < self._reach_m + 2.0]
            body = placed(self._footprint, pose) if near else Polygon()
            for seen in near:
                if seen.swept.distance(body) < GAP_M:
                    at = seen.shape.centroid
                    return Ahead(seen.name, seen.is_robot, at.x, at.y, after_s)
        return None

    def _others(self) -> list[Seen]:
        """What is not of the team, also under other names than at first. Raises NotReachable."""
        found = self._look()
        self._numbers.update((seen.name, seen.number) for seen in found if seen.name in self._team and seen.number)
        named = {seen.name for seen in found}
        renamed = {number for name, number in self._numbers.items() if name not in named}
        return [seen for seen in found if seen.name not in self._team and seen.number not in renamed]
