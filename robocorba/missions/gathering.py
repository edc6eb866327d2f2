"""How robots come together around an object: how far they have to go, and where they wait beside each other."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from itertools import combinations

import shapely

from robocorba.errors.paths import PathError
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.missions.formation import Pose
from robocorba.missions.surroundings import placed
from robocorba.missions.world import Thing, World
from robocorba.planning.request import MOST_AREAS, Path, PathRequest, Place, RouteMode
from robocorba.spatial.pose import XY

#: Who gathers stays so far from the others, m, where there is room.
ASIDE_M = 0.12
#: Who comes nearer to another one than this has to go around it, m.
PASS_M = 0.06
_ROUNDS = 50


class Ways:
    """From place to place as everything stands now, also what the map has somewhere else; thing: what is to be carried.

    Raises NotReachable."""

    def __init__(self, world: World, thing: Thing | None = None) -> None:
        self._world = world
        shapes = [(thing.floor, placed(thing.outline, (thing.x, thing.y, thing.heading)))] if thing else []
        others = world.others(thing.name if thing else "")
        shapes += [(floor, item.geometry) for floor, items in others.items() for item in items]
        areas = [(floor, _corners(part)) for floor, shape in shapes for part in shapely.get_parts(shape)]
        knows_all = len(areas) <= MOST_AREAS
        self._areas = tuple(areas) if knows_all else ()
        self._without = tuple(world.building().floors) if knows_all else ()

    def path(self, start: Place, goal: Place) -> Path:
        """Along the map, or across free ground where that leads nowhere. Raises PathError, NotReachable."""
        request = PathRequest(start, goal, RADIUS_M, forbidden_areas=self._areas, without_movables=self._without)
        try:
            return self._world.paths(request._replace(mode=RouteMode.SMOOTHED))[0]
        except PathError:
            return self._world.paths(request._replace(mode=RouteMode.GEOMETRIC))[0]

    def length_m(self, start: Place, goal: Place) -> float | None:
        """None where there is no way. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return self.path(start, goal).distance
        return None

    def points(self, start: Place, goal: Place) -> list[XY]:
        """Of a way, on the floor of its goal; nothing where there is none. Raises NotReachable."""
        with contextlib.suppress(PathError):
            return [(point.x, point.y) for point in self.path(start, goal).points if point.floor == goal.floor]
        return []


def loosened(places: Sequence[Pose], apart_m: float = 2 * RADIUS_M + ASIDE_M) -> list[Pose]:
    """The same places, those that are nearer to each other than `apart_m` moved apart."""
    found = [(x, y) for x, y, _ in places]
    for _ in range(_ROUNDS):
        for i, k in combinations(range(len(found)), 2):
            (ax, ay), (bx, by) = found[i], found[k]
            distance = math.dist(found[i], found[k])
            if 0.0 < distance < apart_m:
                share = (apart_m - distance) / distance / 2
                dx, dy = share * (bx - ax), share * (by - ay)
                found[i], found[k] = (ax - dx, ay - dy), (bx + dx, by + dy)
    return [(x, y, heading) for (x, y), (_, _, heading) in zip(found, places, strict=True)]


def waves(starts: Sequence[Place], goals: Sequence[Place], ways: Sequence[Sequence[XY]]) -> list[frozenset[int]]:
    """Who goes at the same time, by number, one after another: first whose way leads past where another one will stand,
    and who stands in another one's way. All who are left, where each of them had to wait for another one."""
    everybody = range(len(goals))
    before = {
        number: {
            other
            for other in everybody
            if other != number and (_passes(ways[other], goals[number]) or _is_in(starts[other], ways[number], goals))
        }
        for number in everybody
    }
    left, found = set(everybody), []
    while left:
        now = frozenset(number for number in left if not before[number] & left) or frozenset(left)
        found.append(now)
        left -= now
    return found


def _passes(way: Sequence[XY], place: Place) -> bool:
    line = shapely.LineString(way) if len(way) > 1 else shapely.MultiPoint(way)
    return bool(line.distance(shapely.Point(place.x, place.y)) < 2 * RADIUS_M + PASS_M)


def _is_in(start: Place, way: Sequence[XY], goals: Sequence[Place]) -> bool:
    return start.floor == goals[0].floor and _passes(way, start)


def _corners(part: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((float(x), float(y)) for x, y in shapely.get_coordinates(part.exterior)[:-1])
