"""Plans a carry: the path of an object and its carriers as one body.

The formations of the carriers are tried in turn. On each floor the whole body passes walls, objects and doors; in an
elevator it must fit into the cabin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import ImpossibleCarry, InvalidCarry
from robocorba.maps.model import Building, Elevator, Floor
from robocorba.maps.movable import movables
from robocorba.maps.movable import outline as outline_of
from robocorba.missions.blocked_carry import Attempt, SearchResult, why_impossible, why_not_free
from robocorba.missions.formation import ARMS_WIDTH_M, HAND_M, Formation, Pose, formations
from robocorba.missions.obstacles import Blocked, BuildingObstacles, placed
from robocorba.planning.body import body_of
from robocorba.planning.body_search import (
    HEADINGS,
    STEP_M,
    LatticeRoute,
    distances_to_goal,
    find_routes,
    lay_lattice,
    shorten,
)
from robocorba.planning.request import MAX_COORDINATE_M
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import SMARTPAL_RADIUS_M

#: Least clearance of the body [m].
MARGIN_M = 0.05
#: Clearance that shortened paths keep if there is room [m].
PREFERRED_MARGIN_M = 0.15
#: Length of the straight line on which a carrier approaches its place and backs off [m].
BACK_M = 0.3
#: Largest number of elevator rides of a carry.
MAX_RIDES = 2


class ObjectPose(NamedTuple):
    """The pose of an object on a floor [m, rad]."""

    floor: str
    x: float
    y: float
    heading: float

    @property
    def pose(self) -> Pose:
        return self.x, self.y, self.heading


class CarryLeg(NamedTuple):
    """The path on one floor: poses (k, 3) of the object, x, y [m], unwrapped heading [rad], joined by straight
    segments. elevator_after: the elevator in which the leg ends, empty at the goal."""

    floor: str
    poses: Floats
    elevator_after: str


class CarryPlan(NamedTuple):
    """outline: of the object in its own frame."""

    formation: Formation
    legs: tuple[CarryLeg, ...]
    outline: Polygon
    radius_m: float

    def footprint(self) -> BaseGeometry:
        """The outline of object, carriers and arms, in the object's frame."""
        return self.formation.footprint(self.outline, self.radius_m)


def plan_carry(
    building: Building,
    carried: str | Polygon,
    start: ObjectPose | tuple[str, float, float, float] | None,
    goal: ObjectPose | tuple[str, float, float, float],
    count: int,
    radius_m: float = SMARTPAL_RADIUS_M,
    hand_m: float = HAND_M,
    blocked: Blocked | None = None,
    margin_m: float = MARGIN_M,
) -> CarryPlan:
    """Plan how `count` robots carry an object exactly from start to goal.

    carried: name of a movable object (see `maps.movable.movables`), or an outline in its own frame. start: None for the
    pose of the map. blocked: additional obstacles; see BuildingObstacles. Carriers have room to approach their places
    at the start, and to back off at the goal, on straight lines of BACK_M. Raises InvalidCarry, ImpossibleCarry."""
    name = carried if isinstance(carried, str) else ""
    outline, known = _outline_and_pose(building, carried)
    if start is None and known is None:
        raise InvalidCarry("start", "required for an object that is not on the map")
    start, goal = ObjectPose(*(start or known or ())), ObjectPose(*goal)
    for field, at in (("start", start), ("goal", goal)):
        if at.floor not in building.floors:
            raise InvalidCarry(field, f"there is no floor {at.floor[:80]!r}")
        if not all(map(math.isfinite, at.pose)) or max(abs(at.x), abs(at.y)) > MAX_COORDINATE_M:
            raise InvalidCarry(field, f"{at.pose} is not finite or beyond {MAX_COORDINATE_M:g} m")
    obstacles = BuildingObstacles(building, name, blocked or {})
    routes = list(_elevator_routes(building, start, goal))
    if not routes:
        raise ImpossibleCarry(f"no elevator leads from {start.floor} to {goal.floor}")

    attempts: list[Attempt] = []
    not_free: list[ImpossibleCarry] = []
    for formation in formations(outline, count, radius_m, hand_m):
        body = _CarriedBody(formation, outline, radius_m, margin_m)
        taken = _occupied_end(obstacles, body, start, goal)
        if taken:
            not_free.append(taken)
            continue
        for route in routes:
            legs = _plan_legs(obstacles, body, route, start, goal, attempts)
            if legs:
                return CarryPlan(formation, tuple(legs), outline, radius_m)
    if not attempts:
        raise not_free[0]
    raise why_impossible(obstacles, outline, attempts, margin_m)


def warm_up() -> None:
    """Compile or load the kernels of the planner."""
    outline = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0))
    room = Building("none").with_element("", Floor(name="L1", level=1, elevation=0.0, outline=outline))
    plan_carry(room, shapely.box(-0.3, -0.2, 0.3, 0.2), ("L1", 2.0, 3.0, 0.0), ("L1", 4.0, 3.0, 1.0), 2)


class _CarriedBody:
    """A formation as shapes, and as a body for the search. carriers: the areas in which they approach and back off."""

    def __init__(self, formation: Formation, outline: Polygon, radius_m: float, margin_m: float) -> None:
        self.formation, self.outline, self.margin_m = formation, outline, margin_m
        self.footprint = formation.footprint(outline, radius_m)
        lines = zip(formation.places(), formation.places(BACK_M), strict=True)
        self.carriers = [LineString([here[:2], back[:2]]).buffer(radius_m, quad_segs=16) for here, back in lines]
        rounded = []
        for (x, y, _), grip in zip(formation.places(), formation.grips, strict=True):
            rounded.append((x, y, x, y, radius_m))
            # Both sides of the arms: an obstacle between carrier and object crosses one of them.
            across = ARMS_WIDTH_M / 2 * -math.sin(grip.facing), ARMS_WIDTH_M / 2 * math.cos(grip.facing)
            for side in (-1, 1):
                dx, dy = side * across[0], side * across[1]
                rounded.append((x + dx, y + dy, grip.x + dx, grip.y + dy, 0.0))
        self.search_body = body_of(outline, rounded)
        middle = Point(0.0, 0.0)
        #: Radius of the largest disc around the origin within the object [m]; -inf if the origin is outside.
        self.core_m = outline.exterior.distance(middle) if outline.contains(middle) else -math.inf


def _outline_and_pose(building: Building, carried: str | Polygon) -> tuple[Polygon, ObjectPose | None]:
    if isinstance(carried, Polygon):
        return carried, None
    known = movables(building)
    if carried not in known:
        raise InvalidCarry("object", f"there is no movable {carried[:80]!r}; there are {', '.join(known) or 'none'}")
    entry, floor = known[carried]
    return outline_of(entry), ObjectPose(floor, *entry.at, entry.heading)


def _occupied_end(
    obstacles: BuildingObstacles, body: _CarriedBody, start: ObjectPose, goal: ObjectPose
) -> ImpossibleCarry | None:
    """The error if the object or a carrier collides at the start or at the goal, else None."""
    for which, at in (("start", start), ("goal", goal)):
        floor_obstacles = obstacles.on_floor(at.floor)
        parts = [("the object", body.outline, body.margin_m), ("its carriers", body.footprint, body.margin_m)]
        parts += [("an approaching or leaving carrier", carrier, 0.0) for carrier in body.carriers]
        for part, shape, margin_m in parts:
            near = floor_obstacles.nearest(placed(shape, at.pose), margin_m)
            if near:
                return why_not_free(which, at.floor, at.pose, part, near, margin_m)
    return None


# ---- across floors ----


def _elevator_routes(building: Building, start: ObjectPose, goal: ObjectPose) -> Iterator[tuple[tuple[str, str], ...]]:
    """Sequences of rides (elevator, destination floor): the fewest rides first, then the nearest first elevator."""
    if start.floor == goal.floor:
        yield ()
        return
    routes: list[tuple[tuple[str, str], ...]] = [()]
    for _ in range(MAX_RIDES):
        longer = []
        for route in routes:
            floors = [start.floor, *(floor for _, floor in route)]
            for name, elevator in building.elevators.items():
                served = elevator.floors()
                if floors[-1] in served and all(name != ridden for ridden, _ in route):
                    longer += [(*route, (name, floor)) for floor in served if floor not in floors]
        routes = longer
        at_goal = [route for route in routes if route[-1][1] == goal.floor]
        yield from sorted(at_goal, key=lambda route: math.dist(building.elevators[route[0][0]].at, (start.x, start.y)))


def _plan_legs(
    obstacles: BuildingObstacles,
    body: _CarriedBody,
    route: Sequence[tuple[str, str]],
    start: ObjectPose,
    goal: ObjectPose,
    attempts: list[Attempt],
) -> list[CarryLeg] | None:
    """The legs along a route; None if there is no path: then the failure is appended to `attempts`."""
    elevators = [obstacles.building.elevators[name] for name, _ in route]
    floors = [start.floor, *(floor for _, floor in route)]
    sources = np.array([[*start.pose, 0.0]])
    done: list[list[LatticeRoute]] = []
    for i, floor in enumerate(floors):
        is_last = i == len(floors) - 1
        goals = np.array([goal.pose]) if is_last else _cabin_poses(elevators[i], body)
        ridden = frozenset(elevator.name for elevator in elevators[max(i - 1, 0) : i + 1])
        floor_obstacles = obstacles.on_floor(floor, ridden)
        cabin = None if is_last else elevators[i]
        if not len(goals):
            attempts.append(Attempt(i, body.formation, body.footprint, floor_obstacles, cabin, None))
            return None
        anchor = goals[0] if is_last else np.array([*elevators[i].at, elevators[i].heading])
        box = floor_obstacles.box(*map(tuple, sources[:, :3].tolist()), *map(tuple, goals.tolist()))
        lattice = lay_lattice(floor_obstacles.grid, box, anchor, body.search_body.reach + 1.0)
        core_m = body.core_m + body.margin_m
        left = distances_to_goal(lattice, goals, core_m)
        found, reached = find_routes(
            floor_obstacles.grid, body.search_body, lattice, left, sources, goals, body.margin_m
        )
        if not found:
            searched = SearchResult(lattice, left, core_m, reached, (float(sources[0, 0]), float(sources[0, 1])), goals)
            attempts.append(Attempt(i, body.formation, body.footprint, floor_obstacles, cabin, searched))
            return None
        done.append(found)
        sources = np.array([[*goals[path.goal], path.cost] for path in found])
    return _cheapest_legs(body, done, elevators, floors, obstacles)


def _cheapest_legs(
    body: _CarriedBody,
    done: list[list[LatticeRoute]],
    elevators: Sequence[Elevator],
    floors: Sequence[str],
    obstacles: BuildingObstacles,
) -> list[CarryLeg]:
    """The cheapest paths, one a floor, traced back from the goal and shortened."""
    legs: list[CarryLeg] = []
    index = 0
    for i in reversed(range(len(floors))):
        path = done[i][index]
        ridden = frozenset(elevator.name for elevator in elevators[max(i - 1, 0) : i + 1])
        grid = obstacles.on_floor(floors[i], ridden).grid
        poses = shorten(grid, body.search_body, path.route, body.margin_m, max(PREFERRED_MARGIN_M, body.margin_m))
        legs.insert(0, CarryLeg(floors[i], poses, elevators[i].name if i < len(elevators) else ""))
        index = path.source
    return legs


def _cabin_poses(elevator: Elevator, body: _CarriedBody) -> Floats:
    """Poses (n, 3) at which the whole body fits into a cabin, one for each heading of the lattice, roomiest first."""
    corners = shapely.get_coordinates(body.footprint.convex_hull)
    half = np.array(elevator.size) / 2
    found = []
    for layer in range(HEADINGS):
        turned = math.tau * layer / HEADINGS
        cos, sin = math.cos(turned), math.sin(turned)
        box = corners @ np.array([[cos, sin], [-sin, cos]])
        off = -(box.min(axis=0) + box.max(axis=0)) / 2
        off = np.round(off / STEP_M) * STEP_M
        room = (half - np.abs(box + off)).min()
        if room < body.margin_m:
            continue
        c, s = math.cos(elevator.heading), math.sin(elevator.heading)
        pose = (
            elevator.at[0] + c * off[0] - s * off[1],
            elevator.at[1] + s * off[0] + c * off[1],
            elevator.heading + turned,
        )
        found.append((-room, pose))
    return np.array([pose for _, pose in sorted(found)]).reshape(-1, 3)
