"""Gathering of robots around an object: who gathers where, their paths, and the order in which they drive."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import combinations, permutations

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import PathError
from robocorba.errors.robots import InTheWay, MissionFailed
from robocorba.map_editor.spatial.pose import XY, Pose2D
from robocorba.missions.clearing import Way, in_the_way, lane, places_aside, united
from robocorba.missions.obstacles import placed
from robocorba.missions.world import MovableObject, StandingRobot, World
from robocorba.planning.request import MAX_AREAS, Path, PathRequest, Place, RouteMode
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Wanted gap between gathering robots [m].
SPACING_M = 0.12
#: Time limits of gathering, and of each step near by: confirming areas, approaching, gripping, backing off [s].
GATHER_LIMIT_S, NEAR_LIMIT_S = 240.0, 30.0


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
        request = self._obstacles.added_to(PathRequest(start, goal, RADIUS_M))
        with contextlib.suppress(PathError):
            return self._world.paths(request._replace(mode=RouteMode.SMOOTHED))[0]
        return self._world.paths(request._replace(mode=RouteMode.GEOMETRIC))[0]

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


def clear_way(
    world: World,
    carried: MovableObject | None,
    areas: Iterable[tuple[str, BaseGeometry]],
    drives: Sequence[tuple[Place, Place]],
    others: Sequence[StandingRobot],
    staying: Collection[str],
) -> Way:
    """The way of a mission: the floors and areas that it needs, and the lanes of its robots' drives from start to goal
    where `others` stand in them and there is no short way around. The lanes lead around those that stay where they are.

    Raises InTheWay for the others that stand in it and don't stay; PathError, NotReachable."""
    stay = [robot for robot in others if robot.name in staying]
    direct, around = GatheringPaths(world, carried, stay), GatheringPaths(world, carried, others)
    needed = list(areas)
    for start, goal in drives:
        path = direct.path(start, goal)
        if in_the_way(united(lane(path)), others):
            length_m = around.length_m(start, goal)
            # A way around is short if it is at most 1.3 times as long, plus 2 m.
            if length_m is None or length_m > 1.3 * path.distance + 2.0:
                needed += lane(path)
    way = united(needed)
    if blocking := in_the_way(way, [robot for robot in others if robot.name not in staying]):
        raise InTheWay(places_aside(world, way, blocking, carried))
    return way


def assign_places(
    robots: Mapping[str, Place], places: Sequence[Place], leader: str, length_m: Callable[[Place, Place], float | None]
) -> list[str]:
    """The robot for each of the places, in their order, with the least sum of squared path lengths. The leader always
    gets a place. Squares avoid that a robot has to pass another one at a nearer place: that one moves on instead.

    length_m: path length from one place to another, None if there is no path. Raises MissionFailed if there are too
    few robots, or if no robot can reach a place."""
    import networkx as nx  # takes long to load; only leaders need it

    names = sorted(robots, key=lambda name: (name != leader, name))
    if len(names) < len(places):
        raise MissionFailed(f"{len(places)} robots are needed; {', '.join(names)} are free")
    lengths = [[length_m(robots[name], place) for place in places] for name in names]
    # In m²: a place that a robot can't reach costs more than a plan without the leader, names[0].
    costs = [[1e12 if length is None else length**2 for length in row] for row in lengths]
    costs[0] = [cost - 1e10 for cost in costs[0]]
    graph: nx.Graph[int] = nx.Graph()  # places are below zero; whole numbers, since it computes exactly with these only
    for row, of_robot in enumerate(costs):
        graph.add_weighted_edges_from((row, ~column, -round(1e6 * cost)) for column, cost in enumerate(of_robot))
    pairs = [sorted(pair) for pair in nx.max_weight_matching(graph, maxcardinality=True)]
    found = {~place: row for place, row in pairs}
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
    for _ in range(50):  # enough for the carriers of one object
        for i, k in combinations(range(len(found)), 2):
            (ax, ay), (bx, by) = found[i], found[k]
            distance = math.dist(found[i], found[k])
            if 0.0 < distance < apart_m:
                share = (apart_m - distance) / distance / 2
                dx, dy = share * (bx - ax), share * (by - ay)
                found[i], found[k] = (ax - dx, ay - dy), (bx + dx, by + dy)
    return [(x, y, heading) for (x, y), (_, _, heading) in zip(found, places, strict=True)]


def driving_groups(drives: Sequence[tuple[Place, Place]], paths: Sequence[Sequence[XY]]) -> list[frozenset[int]]:
    """Groups of robots, by index, that drive simultaneously, one group after another. A robot drives later than a robot
    whose path leads past its goal, or whose start blocks its path. Robots in a cycle drive together.

    drives: start and goal of each. paths: of each, on the floor of the goals."""
    before: dict[int, set[int]] = {number: set() for number in range(len(drives))}
    for number, other in permutations(before, 2):
        start, (_, goal) = drives[other][0], drives[number]
        is_in_path = start.floor == goal.floor and _passes(paths[number], start)
        if is_in_path or _passes(paths[other], goal):
            before[number].add(other)
    remaining, found = set(before), []
    while remaining:
        group = frozenset(number for number in remaining if not before[number] & remaining) or frozenset(remaining)
        found.append(group)
        remaining -= group
    return found


def _passes(path: Sequence[XY], place: Place) -> bool:
    """Whether a robot on this path would leave less than 6 cm to another one at this place."""
    line = shapely.LineString(path) if len(path) > 1 else shapely.MultiPoint(path)
    return bool(line.distance(shapely.Point(place.x, place.y)) < 2 * RADIUS_M + 0.06)


def _corners(part: shapely.Polygon) -> tuple[XY, ...]:
    return tuple((float(x), float(y)) for x, y in shapely.get_coordinates(part.exterior)[:-1])
