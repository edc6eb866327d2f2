"""Gathering of robots around an object: their paths, their places, and the order in which they drive."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from itertools import combinations

import shapely

from robocorba.errors.paths import PathError
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.missions.formation import Pose
from robocorba.missions.obstacles import placed
from robocorba.missions.world import MovableObject, World
from robocorba.planning.request import MAX_AREAS, Path, PathRequest, Place, RouteMode
from robocorba.spatial.pose import XY

#: Wanted gap between gathering robots [m].
SPACING_M = 0.12
#: A path that leaves a smaller gap to another robot is blocked by it [m].
PASSING_CLEARANCE_M = 0.06
#: Iterations of `spread_apart`.
_ITERATIONS = 50


class GatheringPaths:
    """Paths around the `carried` object and all other movable objects at their current poses, which may differ from the
    map. If there are more than MAX_AREAS of them, at the poses of the map.

    Raises NotReachable."""

    def __init__(self, world: World, carried: MovableObject | None = None) -> None:
        self._world = world
        shapes = []
        if carried:
            pose = (carried.x, carried.y, carried.heading)
            shapes.append((carried.floor, placed(carried.outline, pose)))
        others = world.others(carried.name if carried else "")
        shapes += [(floor, item.geometry) for floor, items in others.items() for item in items]
        areas = [(floor, _corners(part)) for floor, shape in shapes for part in shapely.get_parts(shape)]
        fits = len(areas) <= MAX_AREAS
        self._areas = tuple(areas) if fits else ()
        self._without = tuple(world.building().floors) if fits else ()

    def path(self, start: Place, goal: Place) -> Path:
        """A path on the roadmap, or else a geometric one. Raises PathError, NotReachable."""
        request = PathRequest(start, goal, RADIUS_M, forbidden_areas=self._areas, without_movables=self._without)
        try:
            return self._world.paths(request._replace(mode=RouteMode.SMOOTHED))[0]
        except PathError:
            return self._world.paths(request._replace(mode=RouteMode.GEOMETRIC))[0]

    def length_m(self, start: Place, goal: Place) -> float | None:
        """The length of the path, None if there is none. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return self.path(start, goal).distance
        return None

    def points(self, start: Place, goal: Place) -> list[XY]:
        """The points of the path on the goal's floor, empty if there is no path. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return [(point.x, point.y) for point in self.path(start, goal).points if point.floor == goal.floor]
        return []


def spread_apart(places: Sequence[Pose], apart_m: float = 2 * RADIUS_M + SPACING_M) -> list[Pose]:
    """The same places; those nearer to each other than `apart_m` are moved apart."""
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


def waves(starts: Sequence[Place], goals: Sequence[Place], paths: Sequence[Sequence[XY]]) -> list[frozenset[int]]:
    """Groups of robots, by index, that drive simultaneously, one group after another. A robot drives later than another
    one whose path leads past its goal, or whose start blocks its path. Robots in a cycle drive together."""
    indices = range(len(goals))
    before = {
        number: {
            other
            for other in indices
            if other != number
            and (_passes(paths[other], goals[number]) or _blocks(starts[other], paths[number], goals))
        }
        for number in indices
    }
    left, found = set(indices), []
    while left:
        now = frozenset(number for number in left if not before[number] & left) or frozenset(left)
        found.append(now)
        left -= now
    return found


def _passes(path: Sequence[XY], place: Place) -> bool:
    line = shapely.LineString(path) if len(path) > 1 else shapely.MultiPoint(path)
    return bool(line.distance(shapely.Point(place.x, place.y)) < 2 * RADIUS_M + PASSING_CLEARANCE_M)


def _blocks(start: Place, path: Sequence[XY], goals: Sequence[Place]) -> bool:
    return start.floor == goals[0].floor and _passes(path, start)


def _corners(part: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((float(x), float(y)) for x, y in shapely.get_coordinates(part.exterior)[:-1])
