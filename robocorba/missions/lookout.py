"""What comes into the way of a carried body, seen by the data pool of the leader."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import shapely
import shapely.affinity
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory


class Seen(NamedTuple):
    """A robot or an object: where it stands [m], and its velocity along the floor's axes [m/s]. number: its identity
    while edits of the map change names; 0 if it has none."""

    name: str
    is_robot: bool
    shape: BaseGeometry
    vx: float
    vy: float
    number: int = 0

    def swept(self, seconds: float) -> BaseGeometry:
        """What it covers within this time if it moves on as now."""
        if self.vx == self.vy == 0.0:
            return self.shape
        there = shapely.affinity.translate(self.shape, self.vx * seconds, self.vy * seconds)
        return shapely.union_all([self.shape, there]).convex_hull


#: Returns the robots and movable objects on the floor. Raises NotReachable while they are unknown.
Look = Callable[[], Sequence[Seen]]


class Lookout:
    """Watches the way of a body along its trajectory. footprint: of the body, its carriers included, in its frame [m].
    team: names of the robots and of the object that move with it."""

    def __init__(
        self, trajectory: Trajectory, footprint: BaseGeometry, team: Collection[str], look: Look, policy: LeaderPolicy
    ) -> None:
        self._trajectory, self._footprint, self._team = trajectory, footprint, team
        self._look, self._policy = look, policy
        #: Numbers of those of the team that have been seen, by name.
        self._numbers: dict[str, int] = {}
        self._reach_m = max(math.hypot(x, y) for x, y in shapely.get_coordinates(footprint).tolist())

    def ahead(self, trajectory_s: float) -> tuple[Seen, float] | None:
        """The first thing in the way after this time of the trajectory, and the time until the body is there [s]; None
        if the way is free, as far as it is watched. Raises NotReachable."""
        others, policy = self._others(), self._policy
        if not others:
            return None
        end_s = min(trajectory_s + policy.look_ahead_s, self._trajectory.duration)
        count = max(1, math.ceil((end_s - trajectory_s) / policy.look_step_s))
        for number in range(count + 1):
            after_s = number / count * max(0.0, end_s - trajectory_s)
            pose = self._trajectory.at(trajectory_s + after_s)[0]
            near = [seen for seen in others if seen.shape.distance(Point(pose[:2])) < self._reach_m + 2.0]
            body = placed(self._footprint, pose) if near else Polygon()
            for seen in near:
                if seen.swept(policy.predicted_s).distance(body) < policy.way_gap_m:
                    return seen, after_s
        return None

    def _others(self) -> list[Seen]:
        """What is not of the team, also under other names than at first. Raises NotReachable."""
        found = self._look()
        self._numbers.update((seen.name, seen.number) for seen in found if seen.name in self._team and seen.number)
        named = {seen.name for seen in found}
        renamed = {number for name, number in self._numbers.items() if name not in named}
        return [seen for seen in found if seen.name not in self._team and seen.number not in renamed]
