"""Clearing the way of a mission: which robots stand in it, where they step aside, and how they are asked to."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import shapely
from shapely import LineString, Point
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.spatial.pose import XY
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.messages import MakeWay, WayMade
from robocorba.missions.obstacles import BuildingObstacles, FloorObstacles, placed
from robocorba.missions.transport import Transport
from robocorba.missions.world import MovableObject, StandingRobot, World
from robocorba.planning.body_search import distances_to_goal, lay_lattice
from robocorba.planning.request import Path, Place
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Gap between a robot and the way of others [m].
GAP_M = 0.05
#: The same where robots step aside, if there is room, and their gap to obstacles there [m].
ASIDE_GAP_M = 0.15
#: Distance from doors that robots keep where they step aside, if there is room [m].
DOOR_M = 0.6

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
    world: World, way: Way, blocking: Sequence[StandingRobot], carried: MovableObject | None = None
) -> dict[str, Place | None]:
    """The nearest place outside the way for each of the `blocking` robots, one after another; None where there is
    none. carried: the object for which the way is. Raises NotReachable."""
    building, robots = world.building(), world.robots()
    objects = world.others(carried.name if carried else "")
    if carried:
        body = Obstacle("object", carried.name, placed(carried.outline, carried.pose))
        objects[carried.floor] = [*objects.get(carried.floor, ()), body]
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


def place_aside(world: World, way: Way, robot: str, carried: MovableObject | None = None) -> Place | None:
    """The same for a robot by its name, where it is now."""
    blocking = [each for each in world.robots() if each.name == robot]
    return places_aside(world, way, blocking, carried).get(robot)


def _place_aside(floor: FloorObstacles, area: BaseGeometry, robot: StandingRobot, gap_m: float) -> Place | None:
    """The place outside an area to which the robot has the shortest path."""
    x0, y0, x1, y1 = floor.box((robot.x, robot.y, 0.0))
    range_m = 8.0  # along each axis
    box = max(x0, robot.x - range_m), max(y0, robot.y - range_m), min(x1, robot.x + range_m), min(y1, robot.y + range_m)
    here = np.array([robot.x, robot.y, 0.0])
    lattice = lay_lattice(floor.grid, box, here, robot.radius_m + ASIDE_GAP_M + 0.1)
    low_x, low_y, step = lattice.x, lattice.y, lattice.step
    row, column = round((robot.y - low_y) / step), round((robot.x - low_x) / step)
    # The gap to obstacles on the path is 2 cm, less where the robot stands nearer.
    passing_m = min(robot.radius_m + 0.02, float(lattice.open_m[row, column]) - 1e-6)
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
    """Requests to robots to step aside, until each has done so or stays. aside: the place for each of them, as of
    InTheWay or `places_aside`. term: of the leader. staying: robots that stay, and why."""

    def __init__(
        self,
        aside: Mapping[str, tuple[str, float, float] | None],
        mission: str,
        term: int,
        transport: Transport,
        policy: LeaderPolicy,
    ) -> None:
        self._transport, self._policy = transport, policy
        self.staying = {name: "has no room to step aside" for name, place in aside.items() if not place}
        self._left: dict[str, MakeWay] = {}
        for name, place in aside.items():
            if place:
                floor, x, y = place
                leader = transport.name
                request = MakeWay(mission=mission, leader=leader, term=term, robot=name, floor=floor, x=x, y=y)
                self._left[name] = request
        self._answered: set[str] = set()
        self._began, self._sent_at = time.monotonic(), 0.0

    @property
    def robots(self) -> tuple[str, ...]:
        """Those that have not stepped aside yet."""
        return tuple(self._left)

    def update(self) -> None:
        """Repeat requests that are due, and give up those that are late."""
        now, policy = time.monotonic(), self._policy
        if now - self._began > policy.aside_timeout_s:
            self._give_up(self._left, f"did not step aside within {policy.aside_timeout_s:g} s")
        elif now - self._began > policy.aside_answer_timeout_s:
            self._give_up(set(self._left) - self._answered, "does not answer")
        if now - self._sent_at > policy.repeat_interval_s:
            self._sent_at = now
            for request in self._left.values():
                self._transport.publish(request)

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
