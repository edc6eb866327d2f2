"""Clearing the way of a mission: which robots stand in it, where they step aside, and how they are asked to."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import shapely
from shapely import LineString, Point
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY
from robocorba.missions.messages import MakeWay, WayMade
from robocorba.missions.obstacles import Blocked, BuildingObstacles, FloorObstacles, placed
from robocorba.missions.world import MovableObject, StandingRobot, World
from robocorba.planning.body_search import distances_to_goal, lay_lattice
from robocorba.planning.request import Path, Place
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Gap between a robot and the way of others [m].
GAP_M = 0.05
#: The same where robots step aside, if there is room, and their gap to obstacles there [m].
ASIDE_GAP_M = 0.15
#: Gap to obstacles on the path to such a place [m]; less where the robot stands nearer.
PASSING_M = 0.02
#: Distance from a robot within which it steps aside, along each axis [m].
RANGE_M = 8.0
#: Distance from doors that robots keep where they step aside, if there is room [m].
DOOR_M = 0.6
#: Interval between requests to a robot [s].
REPEAT_S = 0.5
#: Time for a robot to answer [s]. One without an agent for missions does not.
ANSWER_S = 3.0
#: Time for all robots to step aside [s].
CLEAR_S = 30.0

#: The room that a mission needs on each floor.
Way = Mapping[str, BaseGeometry]


def united(areas: Iterable[tuple[str, BaseGeometry]]) -> dict[str, BaseGeometry]:
    """The way that consists of these areas."""
    found: dict[str, list[BaseGeometry]] = {}
    for floor, area in areas:
        found.setdefault(floor, []).append(area)
    return {floor: shapely.union_all(parts) for floor, parts in found.items()}


def lane(path: Path) -> list[tuple[str, BaseGeometry]]:
    """The floors and areas that a robot needs on a path."""
    points: dict[str, list[XY]] = {}
    for point in path.points:
        points.setdefault(point.floor, []).append((point.x, point.y))
    return [
        (floor, (LineString(line) if len(line) > 1 else Point(line[0])).buffer(RADIUS_M))
        for floor, line in points.items()
    ]


def in_the_way(way: Way, robots: Iterable[StandingRobot]) -> list[StandingRobot]:
    """The robots that stand in a way, or nearer to it than GAP_M."""
    return [
        robot
        for robot in robots
        if robot.floor in way and way[robot.floor].distance(Point(robot.x, robot.y)) < robot.radius_m + GAP_M
    ]


def places_aside(
    building: Building, objects: Blocked, way: Way, blocking: Sequence[StandingRobot], robots: Sequence[StandingRobot]
) -> dict[str, Place | None]:
    """The nearest place outside the way for each of the `blocking` robots, one after another; None where there is
    none.

    objects: movable objects at their present poses, by floor. robots: all."""
    places: dict[str, Place | None] = {}
    taken: list[StandingRobot] = []
    for robot in blocking:
        if robot.floor not in way:
            continue
        others = [other for other in robots if other.name != robot.name] + taken
        obstacles = [other.obstacle for other in others if other.floor == robot.floor]
        blocked = {**objects, robot.floor: [*objects.get(robot.floor, ()), *obstacles]}
        floor = BuildingObstacles(building, "", blocked).on_floor(robot.floor)
        doors = [
            LineString([door.a, door.b]).buffer(DOOR_M)
            for door in building.floors[robot.floor].geometrical.doors.values()
        ]
        place = _place_aside(floor, shapely.union_all([way[robot.floor], *doors]), robot, ASIDE_GAP_M)
        place = place or _place_aside(floor, way[robot.floor], robot, GAP_M)
        places[robot.name] = place
        if place:
            taken.append(robot._replace(x=place.x, y=place.y))
    return places


def places_beside(
    world: World,
    carried: MovableObject,
    way: Way,
    blocking: Sequence[StandingRobot],
    robots: Sequence[StandingRobot],
) -> dict[str, Place | None]:
    """`places_aside` from the way of a carried object, which stands in it now. Raises NotReachable."""
    objects = world.others(carried.name)
    body = Obstacle("object", carried.name, placed(carried.outline, carried.pose))
    objects[carried.floor] = [*objects.get(carried.floor, ()), body]
    return places_aside(world.building(), objects, way, blocking, robots)


def _place_aside(floor: FloorObstacles, area: BaseGeometry, robot: StandingRobot, gap_m: float) -> Place | None:
    """The place outside an area to which the robot has the shortest path."""
    x0, y0, x1, y1 = floor.box((robot.x, robot.y, 0.0))
    box = max(x0, robot.x - RANGE_M), max(y0, robot.y - RANGE_M), min(x1, robot.x + RANGE_M), min(y1, robot.y + RANGE_M)
    here = np.array([robot.x, robot.y, 0.0])
    lattice = lay_lattice(floor.grid, box, here, robot.radius_m + ASIDE_GAP_M + 0.1)
    low_x, low_y, step = lattice.x, lattice.y, lattice.step
    row, column = round((robot.y - low_y) / step), round((robot.x - low_x) / step)
    passing_m = min(robot.radius_m + PASSING_M, float(lattice.open_m[row, column]) - 1e-6)
    path_m = distances_to_goal(lattice, here[None], passing_m)
    rows, columns = np.nonzero(np.isfinite(path_m) & (lattice.open_m >= robot.radius_m + gap_m))
    points = shapely.points(low_x + columns * step, low_y + rows * step)
    is_outside = shapely.distance(area, points) >= robot.radius_m + gap_m
    if floor.outline is not None:
        is_outside &= shapely.contains(floor.outline.buffer(-robot.radius_m), points)
    if not is_outside.any():
        return None
    best = int(np.argmin(np.where(is_outside, path_m[rows, columns], np.inf)))
    return Place(robot.floor, float(points[best].x), float(points[best].y))


class Requests:
    """Requests to robots to step aside, until each has done so or stays. requests: by robot. staying: robots that stay,
    and why. publish: sends a request."""

    def __init__(
        self,
        requests: Mapping[str, MakeWay],
        staying: Mapping[str, str],
        publish: Callable[[MakeWay], object],
    ) -> None:
        self.staying = dict(staying)
        self._left, self._publish = dict(requests), publish
        self._answered: set[str] = set()
        self._began, self._sent_at = time.monotonic(), 0.0

    @property
    def robots(self) -> tuple[str, ...]:
        """Those that have not stepped aside yet."""
        return tuple(self._left)

    def update(self) -> None:
        """Repeat requests that are due, and give up those that are late."""
        now = time.monotonic()
        if now - self._began > CLEAR_S:
            self._give_up(self._left, f"did not step aside within {CLEAR_S:g} s")
        elif now - self._began > ANSWER_S:
            self._give_up(set(self._left) - self._answered, "does not answer")
        if now - self._sent_at > REPEAT_S:
            self._sent_at = now
            for request in self._left.values():
                self._publish(request)

    def receive(self, answer: WayMade) -> None:
        """Take an answer into account."""
        request = self._left.get(answer.robot)
        if request is None or request.mission != answer.mission:
            return
        self._answered.add(answer.robot)
        if answer.reason:
            self._give_up({answer.robot}, answer.reason)
        elif answer.is_done:
            del self._left[answer.robot]

    def _give_up(self, robots: Iterable[str], reason: str) -> None:
        for name in list(robots):
            self.staying[name] = reason
            del self._left[name]


NO_ROOM = "has no room to step aside"


def requests_for(
    aside: Mapping[str, tuple[str, float, float] | None],
    mission: str,
    leader: str,
    term: int,
    publish: Callable[[MakeWay], object],
) -> Requests:
    """Requests for the places of InTheWay or `places_aside`."""
    wanted = {
        name: MakeWay(mission=mission, leader=leader, term=term, robot=name, floor=place[0], x=place[1], y=place[2])
        for name, place in aside.items()
        if place
    }
    return Requests(wanted, {name: NO_ROOM for name, place in aside.items() if not place}, publish)
