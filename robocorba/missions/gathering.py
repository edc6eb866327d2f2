"""Gathering of robots around an object: who gathers where, their paths, and the order in which they drive."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import PathError
from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.spatial.pose import XY, Pose2D
from robocorba.missions.clearing import in_the_way, lane, united
from robocorba.missions.obstacles import placed
from robocorba.missions.world import MovableObject, StandingRobot, World
from robocorba.planning.request import MAX_AREAS, Path, PathRequest, Place, RouteMode
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Wanted gap between gathering robots [m].
SPACING_M = 0.12
#: A path that leaves a smaller gap to another robot is blocked by it [m].
PASSING_CLEARANCE_M = 0.06
#: Robots drive around others that stand in their lanes if the path is at most this long: a factor of the direct one,
#: plus a distance [m].
DETOUR_FACTOR, DETOUR_M = 1.3, 2.0
#: Iterations of `spread_apart`.
_ITERATIONS = 50
#: Cost of a place that a robot cannot reach [m²].
_UNREACHABLE = 1e12
#: Cost of a plan without the leader [m²].
_NO_LEADER = 1e10


class GatheringPaths:
    """Finds paths around the `carried` object and all other movable objects at their present poses, which may differ
    from the map, and around `standing` robots. If there are more than MAX_AREAS of them, objects are taken from the
    map, and robots are ignored.

    Raises NotReachable."""

    def __init__(
        self, world: World, carried: MovableObject | None = None, standing: Sequence[StandingRobot] = ()
    ) -> None:
        self._world = world
        shapes = [(carried.floor, carried.name, placed(carried.outline, carried.pose))] if carried else []
        others = world.others(carried.name if carried else "")
        shapes += [(floor, item.name, item.geometry) for floor, items in others.items() for item in items]
        shapes += [(robot.floor, robot.name, robot.disc) for robot in standing]
        parts = [((floor, _corners(part)), name) for floor, name, shape in shapes for part in shapely.get_parts(shape)]
        areas, names = tuple(area for area, _ in parts), tuple(name for _, name in parts)
        fits = len(areas) <= MAX_AREAS
        self._obstacles = TemporaryObstacles(areas, tuple(world.building().floors), names) if fits else NO_OBSTACLES

    def path(self, start: Place, goal: Place) -> Path:
        """A path on the roadmap, or else a geometric one. Raises PathError, NotReachable."""
        try:
            return self._find(start, goal)
        except PathError as error:
            raise self._obstacles.explained(error) from None

    def _find(self, start: Place, goal: Place) -> Path:
        request = self._request(start, goal)
        with contextlib.suppress(PathError):
            return self._world.paths(request._replace(mode=RouteMode.SMOOTHED))[0]
        return self._world.paths(request._replace(mode=RouteMode.GEOMETRIC))[0]

    def _request(self, start: Place, goal: Place) -> PathRequest:
        return self._obstacles.added_to(PathRequest(start, goal, RADIUS_M))

    def length_m(self, start: Place, goal: Place) -> float | None:
        """The length of the path, None if there is none. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return self._find(start, goal).distance
        return None

    def points(self, start: Place, goal: Place) -> list[XY]:
        """The points of the path on the goal's floor, empty if there is no path. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return [(point.x, point.y) for point in self._find(start, goal).points if point.floor == goal.floor]
        return []


def blocked_lanes(
    world: World,
    carried: MovableObject | None,
    starts: Sequence[Place],
    goals: Sequence[Place],
    others: Sequence[StandingRobot],
    staying: Sequence[StandingRobot],
) -> list[tuple[str, BaseGeometry]]:
    """The lanes from starts to goals, as floors and areas, where `others` stand in them and there is no short way
    around. The lanes lead around those that stay where they are. Raises PathError, NotReachable."""
    direct, around = GatheringPaths(world, carried, staying), GatheringPaths(world, carried, others)
    found = []
    for start, goal in zip(starts, goals, strict=True):
        path = direct.path(start, goal)
        needed = lane(path)
        if in_the_way(united(needed), others):
            length_m = around.length_m(start, goal)
            if length_m is None or length_m > DETOUR_FACTOR * path.distance + DETOUR_M:
                found += needed
    return found


def assign_places(
    robots: Mapping[str, Place], places: Sequence[Place], leader: str, length_m: Callable[[Place, Place], float | None]
) -> list[str]:
    """The robot for each of the places, in their order, with the least sum of squared path lengths. The leader always
    gets a place. Squares avoid that a robot has to pass another one at a nearer place: that one moves on instead.

    length_m: path length from one place to another, None if there is no path. Raises MissionFailed if there are too
    few robots, or if no robot can reach a place."""
    from scipy.optimize import linear_sum_assignment  # takes long to load; only leaders need it

    names = sorted(robots, key=lambda name: (name != leader, name))
    if len(names) < len(places):
        raise MissionFailed(f"{len(places)} robots are needed; {', '.join(names)} are free")
    lengths = [[length_m(robots[name], place) for place in places] for name in names]
    costs = np.array([[_UNREACHABLE if length is None else length**2 for length in row] for row in lengths])
    costs[0] -= _NO_LEADER  # names[0] is the leader, which must take part
    rows, columns = linear_sum_assignment(costs)
    found = {int(column): int(row) for row, column in zip(rows, columns, strict=True)}
    for column, place in enumerate(places):
        row = found[column]
        if lengths[row][column] is None:
            reason = f"no robot can reach {place.floor} ({place.x:.2f}, {place.y:.2f}) beside the object"
            if elsewhere := [name for name in names if robots[name].floor != place.floor]:
                reason += f"; on other floors: {', '.join(elsewhere)}"
            raise MissionFailed(reason)
    return [names[found[column]] for column in range(len(places))]


def spread_apart(places: Sequence[Pose2D], apart_m: float = 2 * RADIUS_M + SPACING_M) -> list[Pose2D]:
    """The poses `places`, moved apart where they are nearer to each other than `apart_m`."""
    found = [(x, y) for x, y, _ in places]
    for _ in range(_ITERATIONS):
        for i, k in combinations(range(len(found)), 2):
            (ax, ay), (bx, by) = found[i], found[k]
            distance = math.dist(found[i], found[k])
            if 0.0 < distance < apart_m:
                share = (apart_m - distance) / distance / 2
                dx, dy = share * (bx - ax), share * (by - ay)
                found[i], found[k] = (ax - dx, ay - dy), (bx + dx, by + dy)
    return [(x, y, heading) for (x, y), (_, _, heading) in zip(found, places, strict=True)]


def driving_groups(
    starts: Sequence[Place], goals: Sequence[Place], paths: Sequence[Sequence[XY]]
) -> list[frozenset[int]]:
    """Groups of robots, by index, that drive simultaneously, one group after another. A robot drives later than a robot
    whose path leads past its goal, or whose start blocks its path. Robots in a cycle drive together."""
    before: dict[int, set[int]] = {number: set() for number in range(len(goals))}
    for number, other in permutations(before, 2):
        is_in_path = starts[other].floor == goals[0].floor and _passes(paths[number], starts[other])
        if is_in_path or _passes(paths[other], goals[number]):
            before[number].add(other)
    remaining, found = set(before), []
    while remaining:
        group = frozenset(number for number in remaining if not before[number] & remaining) or frozenset(remaining)
        found.append(group)
        remaining -= group
    return found


def _passes(path: Sequence[XY], place: Place) -> bool:
    line = shapely.LineString(path) if len(path) > 1 else shapely.MultiPoint(path)
    return bool(line.distance(shapely.Point(place.x, place.y)) < 2 * RADIUS_M + PASSING_CLEARANCE_M)


def _corners(part: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((float(x), float(y)) for x, y in shapely.get_coordinates(part.exterior)[:-1])
