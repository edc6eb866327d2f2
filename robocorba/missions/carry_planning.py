"""Plans a carry: the path of an object and its carriers as one body.

The formations of the carriers are tried in turn. On each floor the whole body passes walls, objects and doors; in an
elevator it must fit into the cabin."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.places import metres
from robocorba.errors.robots import ImpossibleCarry, InvalidPlan
from robocorba.map_editor.model import Building, Elevator, Floor
from robocorba.map_editor.movable import movables, not_found, object_outline
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions.blocked_carry import FailedLeg, FailedSearch, why_impossible, why_not_free
from robocorba.missions.formation import ARMS_WIDTH_M, BACK_OFF_M, MARGIN_M, Formation, formations
from robocorba.missions.obstacles import Blocked, BuildingObstacles, FloorObstacles, placed
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
from robocorba.robot.kinematics.smartpal import RADIUS_M


class CarryLeg(NamedTuple):
    """The path on one floor: poses (k, 3) of the object, x, y [m], unwrapped heading [rad], joined by straight
    segments. elevator_after: the elevator in which the leg ends, empty at the goal."""

    floor: str
    poses: Floats
    elevator_after: str


class CarryPlan(NamedTuple):
    """How robots carry an object: their formation, and the path on each floor. outline: of the object in its own
    frame. back_off_m: distance from their places at which the carriers gather, and to which they back off."""

    formation: Formation
    legs: tuple[CarryLeg, ...]
    outline: Polygon
    back_off_m: float = BACK_OFF_M

    def footprint(self) -> BaseGeometry:
        """The outline of object, carriers and arms, in the object's frame."""
        return self.formation.footprint(self.outline)


def plan_carries(
    building: Building,
    carried: str | Polygon,
    start: Pose | tuple[str, float, float, float] | None,
    goal: Pose | tuple[str, float, float, float],
    count: int,
    blocked: Blocked | None = None,
) -> Iterator[CarryPlan]:
    """Plan how `count` robots carry an object from the pose `start` to the pose `goal`, both met exactly: the best
    plan, then others with the same formation and as many rides, by other elevators.

    carried: name of a movable object (see `maps.movable.movables`), or an outline in its own frame. start: None for the
    pose of the map. blocked: additional obstacles; see BuildingObstacles. Elevator doors are open for the carriers that
    ride, and where the object is between them or in the cabin at the start. Carriers have room to approach their places
    at the start, and to back off at the goal, on straight lines of BACK_OFF_M, or shorter ones if no formation has so
    much room. Raises InvalidPlan, ImpossibleCarry."""
    name = carried if isinstance(carried, str) else ""
    outline, known = _outline_and_pose(building, carried)
    if start is None and known is None:
        raise InvalidPlan("start", "required for an object that is not on the map")
    start, goal = Pose(*(start or known or ())), Pose(*goal)
    for field, pose in (("start", start), ("goal", goal)):
        if pose.floor not in building.floors:
            raise InvalidPlan(field, f"there is no floor {pose.floor[:80]!r}")
        if not all(map(math.isfinite, pose[1:])) or max(abs(pose.x), abs(pose.y)) > MAX_COORDINATE_M:
            raise InvalidPlan(field, f"{pose[1:]} is not finite or beyond {metres(MAX_COORDINATE_M)} m")
    obstacles = BuildingObstacles(building, name, blocked or {})
    held_open = obstacles.held_open(start.floor, outline, start[1:])
    routes = list(_elevator_routes(building, start, goal))
    if not routes:
        raise ImpossibleCarry(f"no elevator leads from {start.floor} to {goal.floor}")

    attempts: list[FailedLeg] = []
    collisions: list[ImpossibleCarry] = []
    bodies = [_FormationBody(formation, outline) for formation in formations(outline, count)]
    # Shorter ones for where there is less room, such as in a door in which a mission had to put its object down.
    for back_off_m in (BACK_OFF_M, 0.2, 0.1):
        for body in bodies:
            if collision := _collision_at_ends(obstacles, body, start, goal, held_open, back_off_m):
                collisions.append(collision)
                continue
            found_rides: int | None = None
            for route in routes:
                if found_rides in (None, len(route)) and (
                    legs := _plan_legs(obstacles, body, route, start, goal, held_open, attempts)
                ):
                    found_rides = len(route)
                    yield CarryPlan(body.formation, tuple(legs), outline, back_off_m)
            if found_rides is not None:
                return
        if attempts:
            raise why_impossible(obstacles, attempts)
    raise collisions[0]


def warm_up() -> None:
    """Compile or load the kernels of the planner."""
    outline = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0))
    room = Building("none").with_element("", Floor(name="L1", level=1, elevation=0.0, outline=outline))
    next(plan_carries(room, shapely.box(-0.3, -0.2, 0.3, 0.2), ("L1", 2.0, 3.0, 0.0), ("L1", 4.0, 3.0, 1.0), 2))


class _FormationBody:
    """Object, carriers and arms as shapes, and as a body for the search."""

    def __init__(self, formation: Formation, outline: Polygon) -> None:
        self.formation, self.outline = formation, outline
        self.footprint = formation.footprint(outline)
        rounded = []
        for (x, y, _), grip in zip(formation.carrier_poses(), formation.grips, strict=True):
            rounded.append((x, y, x, y, RADIUS_M))
            # Both sides of the arms: an obstacle between carrier and object crosses one of them.
            across = ARMS_WIDTH_M / 2 * -math.sin(grip.facing), ARMS_WIDTH_M / 2 * math.cos(grip.facing)
            for side in (-1, 1):
                dx, dy = side * across[0], side * across[1]
                rounded.append((x + dx, y + dy, grip.x + dx, grip.y + dy, 0.0))
        self.search_body = body_of(outline, rounded)
        middle = Point(0.0, 0.0)
        #: Radius of the largest disc around the origin within the object [m]; -inf if the origin is outside.
        self.core_m = outline.exterior.distance(middle) if outline.contains(middle) else -math.inf

    def approach_areas(self, back_off_m: float) -> list[BaseGeometry]:
        """Where the carriers approach and back off."""
        lines = zip(self.formation.carrier_poses(), self.formation.carrier_poses(back_off_m), strict=True)
        # The polygon contains the circle around a carrier's base.
        quarter_segments = 16
        outer_m = RADIUS_M / math.cos(math.pi / (4 * quarter_segments))
        return [LineString([here[:2], back[:2]]).buffer(outer_m, quad_segs=quarter_segments) for here, back in lines]


def _outline_and_pose(building: Building, carried: str | Polygon) -> tuple[Polygon, Pose | None]:
    if isinstance(carried, Polygon):
        return carried, None
    known = movables(building)
    if carried not in known:
        raise InvalidPlan("object", not_found(carried, known))
    entry, floor = known[carried]
    return object_outline(entry), Pose(floor, *entry.at, entry.heading)


def _collision_at_ends(
    obstacles: BuildingObstacles,
    body: _FormationBody,
    start: Pose,
    goal: Pose,
    held_open: frozenset[str],
    back_off_m: float,
) -> ImpossibleCarry | None:
    """The error if the object or a carrier collides at the start or at the goal, else None. held_open: elevators whose
    doors are open at the start."""
    parts = [("the object", body.outline, MARGIN_M), ("its carriers", body.footprint, MARGIN_M)]
    parts += [("an approaching or leaving carrier", area, 0.0) for area in body.approach_areas(back_off_m)]
    ends = (("start", start, held_open), ("goal", goal, frozenset[str]()))
    for (which, pose, open_elevators), (part, shape, margin_m) in product(ends, parts):
        if near := obstacles.on_floor(pose.floor, open_elevators).nearest(placed(shape, pose[1:]), margin_m):
            return why_not_free(which, pose, part, near, margin_m)
    return None


# ---- legs and elevators ----


def _elevator_routes(building: Building, start: Pose, goal: Pose) -> Iterator[tuple[tuple[str, str], ...]]:
    """Sequences of at most two rides (elevator, destination floor): the fewest rides first, then the nearest first
    elevator."""
    if start.floor == goal.floor:
        yield ()
        return
    routes: list[tuple[tuple[str, str], ...]] = [()]
    for _ in range(2):
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
    body: _FormationBody,
    rides: Sequence[tuple[str, str]],
    start: Pose,
    goal: Pose,
    held_open: frozenset[str],
    attempts: list[FailedLeg],
) -> list[CarryLeg] | None:
    """The legs of a carry with these rides; None if there is no path: then the failure is appended to `attempts`.
    held_open: elevators whose doors are open at the start."""
    elevators = [obstacles.building.elevators[name] for name, _ in rides]
    ridden = [frozenset(elevator.name for elevator in elevators[max(i - 1, 0) : i + 1]) for i in range(len(rides) + 1)]
    ridden[0] |= held_open
    floors = [
        obstacles.on_floor(floor, open_elevators)
        for floor, open_elevators in zip([start.floor, *(floor for _, floor in rides)], ridden, strict=True)
    ]
    sources = np.array([[*start[1:], 0.0]])
    routes: list[list[LatticeRoute]] = []
    for i, (floor, cabin) in enumerate(zip(floors, [*elevators, None], strict=True)):
        goals = _cabin_poses(cabin, body) if cabin else np.array([goal[1:]])
        if not len(goals):
            attempts.append(FailedLeg(i, body.formation, body.footprint, floor, cabin, None))
            return None
        anchor = np.array([*cabin.at, cabin.heading]) if cabin else goals[0]
        box = floor.box(*map(tuple, sources[:, :3].tolist()), *map(tuple, goals.tolist()))
        lattice = lay_lattice(floor.grid, box, anchor, body.search_body.reach + 1.0)
        core_m = body.core_m + MARGIN_M
        to_goal_m = distances_to_goal(lattice, goals, core_m)
        found, reached = find_routes(floor.grid, body.search_body, lattice, to_goal_m, sources, goals, MARGIN_M)
        if not found:
            from_xy = (float(sources[0, 0]), float(sources[0, 1]))
            search = FailedSearch(lattice, to_goal_m, core_m, reached, from_xy, goals)
            attempts.append(FailedLeg(i, body.formation, body.footprint, floor, cabin, search))
            return None
        routes.append(found)
        sources = np.array([[*goals[route.goal], route.cost] for route in found])
    return _cheapest_legs(body, routes, floors, elevators)


def _cheapest_legs(
    body: _FormationBody,
    routes: Sequence[Sequence[LatticeRoute]],
    floors: Sequence[FloorObstacles],
    elevators: Sequence[Elevator],
) -> list[CarryLeg]:
    """The paths with the least total cost, one for each floor, traced back from the goal and shortened."""
    legs: list[CarryLeg] = []
    index = 0
    for i in reversed(range(len(floors))):
        route = routes[i][index]
        preferred_m = 0.15  # clearance where there is room
        poses = shorten(floors[i].grid, body.search_body, route.route, MARGIN_M, preferred_m)
        legs.insert(0, CarryLeg(floors[i].floor, poses, elevators[i].name if i < len(elevators) else ""))
        index = route.source
    return legs


def _cabin_poses(elevator: Elevator, body: _FormationBody) -> Floats:
    """Poses (n, 3) at which the whole body fits into a cabin, one for each heading of the lattice, roomiest first."""
    corners = shapely.get_coordinates(body.footprint.convex_hull)
    half = np.array(elevator.size) / 2
    cabin = (*elevator.at, elevator.heading)
    found = []
    for heading_index in range(HEADINGS):
        turn = math.tau * heading_index / HEADINGS
        cos, sin = math.cos(turn), math.sin(turn)
        box = corners @ np.array([[cos, sin], [-sin, cos]])
        offset = -(box.min(axis=0) + box.max(axis=0)) / 2
        offset = np.round(offset / STEP_M) * STEP_M
        room = (half - np.abs(box + offset)).min()
        if room >= MARGIN_M:
            found.append((-room, (*out_of(offset[0], offset[1], cabin), elevator.heading + turn)))
    return np.array([pose for _, pose in sorted(found)]).reshape(-1, 3)
