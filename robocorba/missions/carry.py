"""Plans how robots carry an object together: as one body, its outline with all carriers around it.

Each formation of the carriers is tried in turn. On every floor of the way the whole body is led among walls and
objects, through doors; where it rides, all of it stands in the cabin.
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
from robocorba.missions.blocked_carry import Attempt, Searched, why_impossible, why_not_free
from robocorba.missions.formation import ARMS_WIDTH_M, HAND_M, Formation, Pose, formations
from robocorba.missions.surroundings import Blocked, Surroundings, placed
from robocorba.planning.body import body_of
from robocorba.planning.body_search import (
    HEADINGS,
    STEP_M,
    Found,
    find_ways,
    lay_lattice,
    remaining,
    shorten,
)
from robocorba.planning.request import FARTHEST_M, SMARTPAL_RADIUS_M
from robocorba.spatial.grids import Floats

#: What stays free around the body, m; and what shall, where there is room.
MARGIN_M, WISHED_M = 0.05, 0.15
#: So far carriers come straight to their places, and back off from them, m.
BACK_M = 0.3
#: An object may be taken by so many elevators one after another.
MOST_RIDES = 2


class Stand(NamedTuple):
    """Where an object stands: m, rad."""

    floor: str
    x: float
    y: float
    heading: float

    @property
    def pose(self) -> Pose:
        return self.x, self.y, self.heading


class Leg(NamedTuple):
    """On one floor: poses (k, 3) of the object, x and y in m, headings in rad that never jump, with straight ways in
    between. elevator_after: in which it stands at the end, empty at the goal."""

    floor: str
    poses: Floats
    elevator_after: str


class CarryPlan(NamedTuple):
    """outline: of the object in its own frame."""

    formation: Formation
    legs: tuple[Leg, ...]
    outline: Polygon
    radius_m: float

    def footprint(self) -> BaseGeometry:
        """Object, carriers and arms, in the object's frame."""
        return self.formation.footprint(self.outline, self.radius_m)


def plan_carry(
    building: Building,
    thing: str | Polygon,
    start: Stand | tuple[str, float, float, float] | None,
    goal: Stand | tuple[str, float, float, float],
    count: int,
    radius_m: float = SMARTPAL_RADIUS_M,
    hand_m: float = HAND_M,
    blocked: Blocked | None = None,
    margin_m: float = MARGIN_M,
) -> CarryPlan:
    """How `count` robots carry `thing` from start to goal, both met exactly.

    thing: a movable object's name (that of `maps.movable.movables`), or an outline in its own frame. start: None for
    where the map has it. blocked: what stands on the floors besides; see Surroundings. The robots' places at the start
    can be come to, and those at the goal left, straight for BACK_M. Raises InvalidCarry, ImpossibleCarry."""
    name = thing if isinstance(thing, str) else ""
    outline, known = _object(building, thing)
    if start is None and known is None:
        raise InvalidCarry("start", "the map does not know where the object stands")
    start, goal = Stand(*(start or known or ())), Stand(*goal)
    for field, stand in (("start", start), ("goal", goal)):
        if stand.floor not in building.floors:
            raise InvalidCarry(field, f"there is no floor {stand.floor[:80]!r}")
        if not all(map(math.isfinite, stand.pose)) or max(abs(stand.x), abs(stand.y)) > FARTHEST_M:
            raise InvalidCarry(field, f"{stand.pose} is not a pose within {FARTHEST_M:g} m")
    surroundings = Surroundings(building, name, blocked or {})
    routes = list(_routes(building, start, goal))
    if not routes:
        raise ImpossibleCarry(f"no elevator leads from {start.floor} to {goal.floor}")

    attempts: list[Attempt] = []
    not_free: list[ImpossibleCarry] = []
    for formation in formations(outline, count, radius_m, hand_m):
        bodies = _Bodies(formation, outline, radius_m, margin_m)
        taken = _taken(surroundings, bodies, start, goal)
        if taken:
            not_free.append(taken)
            continue
        for route in routes:
            legs = _follow(surroundings, bodies, route, start, goal, attempts)
            if legs:
                return CarryPlan(formation, tuple(legs), outline, radius_m)
    if not attempts:
        raise not_free[0]
    raise why_impossible(surroundings, outline, attempts, margin_m)


def warm_up() -> None:
    """Compile what planning needs, or load it."""
    outline = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0))
    room = Building("none").with_element("", Floor(name="L1", level=1, elevation=0.0, outline=outline))
    plan_carry(room, shapely.box(-0.3, -0.2, 0.3, 0.2), ("L1", 2.0, 3.0, 0.0), ("L1", 4.0, 3.0, 1.0), 2)


class _Bodies:
    """A formation as the search sees it, and as shapes. room: with what the carriers need to come and go."""

    def __init__(self, formation: Formation, outline: Polygon, radius_m: float, margin_m: float) -> None:
        self.formation, self.outline, self.margin_m = formation, outline, margin_m
        self.footprint = formation.footprint(outline, radius_m)
        ways = zip(formation.places(), formation.places(BACK_M), strict=True)
        self.carriers = [LineString([here[:2], back[:2]]).buffer(radius_m, quad_segs=16) for here, back in ways]
        rounded = []
        for (x, y, _), grip in zip(formation.places(), formation.grips, strict=True):
            rounded.append((x, y, x, y, radius_m))
            # The arms' two sides: what comes between carrier and object crosses one of them.
            across = ARMS_WIDTH_M / 2 * -math.sin(grip.facing), ARMS_WIDTH_M / 2 * math.cos(grip.facing)
            for side in (-1, 1):
                dx, dy = side * across[0], side * across[1]
                rounded.append((x + dx, y + dy, grip.x + dx, grip.y + dy, 0.0))
        self.body = body_of(outline, rounded)
        middle = Point(0.0, 0.0)
        #: Of a disc around the origin that is part of the object; none where the origin is not.
        self.core_m = outline.exterior.distance(middle) if outline.contains(middle) else -math.inf


def _object(building: Building, thing: str | Polygon) -> tuple[Polygon, Stand | None]:
    if isinstance(thing, Polygon):
        return thing, None
    known = movables(building)
    if thing not in known:
        raise InvalidCarry("object", f"there is no movable {thing[:80]!r}; there are {', '.join(known) or 'none'}")
    entry, floor = known[thing]
    return outline_of(entry), Stand(floor, *entry.at, entry.heading)


def _taken(surroundings: Surroundings, bodies: _Bodies, start: Stand, goal: Stand) -> ImpossibleCarry | None:
    """Why the object, or a carrier beside it, can't be at the start or at the goal."""
    for which, stand in (("start", start), ("goal", goal)):
        ground = surroundings.ground(stand.floor)
        parts = [("the object", bodies.outline, bodies.margin_m), ("its carriers", bodies.footprint, bodies.margin_m)]
        parts += [("a carrier that comes or goes", carrier, 0.0) for carrier in bodies.carriers]
        for part, shape, margin_m in parts:
            near = ground.nearest(placed(shape, stand.pose), margin_m)
            if near:
                return why_not_free(which, stand.floor, stand.pose, part, near, margin_m)
    return None


# ---- over the floors ----


def _routes(building: Building, start: Stand, goal: Stand) -> Iterator[tuple[tuple[str, str], ...]]:
    """Elevators to take and where to, one after another: few rides first, then near ones."""
    if start.floor == goal.floor:
        yield ()
        return
    ways: list[tuple[tuple[str, str], ...]] = [()]
    for _ in range(MOST_RIDES):
        longer = []
        for way in ways:
            floors = [start.floor, *(floor for _, floor in way)]
            for name, elevator in building.elevators.items():
                served = elevator.floors()
                if floors[-1] in served and all(name != ridden for ridden, _ in way):
                    longer += [(*way, (name, floor)) for floor in served if floor not in floors]
        ways = longer
        at_goal = [way for way in ways if way[-1][1] == goal.floor]
        yield from sorted(at_goal, key=lambda way: math.dist(building.elevators[way[0][0]].at, (start.x, start.y)))


def _follow(
    surroundings: Surroundings,
    bodies: _Bodies,
    route: Sequence[tuple[str, str]],
    start: Stand,
    goal: Stand,
    attempts: list[Attempt],
) -> list[Leg] | None:
    """The legs along a route; None where there is no way, which is told to `attempts`."""
    elevators = [surroundings.building.elevators[name] for name, _ in route]
    floors = [start.floor, *(floor for _, floor in route)]
    sources = np.array([[*start.pose, 0.0]])
    done: list[list[Found]] = []
    for i, floor in enumerate(floors):
        is_last = i == len(floors) - 1
        goals = np.array([goal.pose]) if is_last else _cabin_poses(elevators[i], bodies)
        ridden = frozenset(elevator.name for elevator in elevators[max(i - 1, 0) : i + 1])
        ground = surroundings.ground(floor, ridden)
        cabin = None if is_last else elevators[i]
        if not len(goals):
            attempts.append(Attempt(i, bodies.formation, bodies.footprint, ground, cabin, None))
            return None
        anchor = goals[0] if is_last else np.array([*elevators[i].at, elevators[i].heading])
        box = ground.box(*map(tuple, sources[:, :3].tolist()), *map(tuple, goals.tolist()))
        lattice = lay_lattice(ground.grid, box, anchor, bodies.body.reach + 1.0)
        core_m = bodies.core_m + bodies.margin_m
        left = remaining(lattice, goals, core_m)
        found, reached = find_ways(ground.grid, bodies.body, lattice, left, sources, goals, bodies.margin_m)
        if not found:
            searched = Searched(lattice, left, core_m, reached, (float(sources[0, 0]), float(sources[0, 1])), goals)
            attempts.append(Attempt(i, bodies.formation, bodies.footprint, ground, cabin, searched))
            return None
        done.append(found)
        sources = np.array([[*goals[way.goal], way.cost] for way in found])
    return _legs(bodies, done, elevators, floors, surroundings)


def _legs(
    bodies: _Bodies,
    done: list[list[Found]],
    elevators: Sequence[Elevator],
    floors: Sequence[str],
    surroundings: Surroundings,
) -> list[Leg]:
    """The cheapest ways, one a floor, from the goal back; shortened."""
    legs: list[Leg] = []
    index = 0
    for i in reversed(range(len(floors))):
        way = done[i][index]
        ridden = frozenset(elevator.name for elevator in elevators[max(i - 1, 0) : i + 1])
        grid = surroundings.ground(floors[i], ridden).grid
        poses = shorten(grid, bodies.body, way.way, bodies.margin_m, max(WISHED_M, bodies.margin_m))
        legs.insert(0, Leg(floors[i], poses, elevators[i].name if i < len(elevators) else ""))
        index = way.source
    return legs


def _cabin_poses(elevator: Elevator, bodies: _Bodies) -> Floats:
    """Where the whole body stands in a cabin: for each heading of the lattice through its middle the best pose."""
    corners = shapely.get_coordinates(bodies.footprint.convex_hull)
    half = np.array(elevator.size) / 2
    found = []
    for layer in range(HEADINGS):
        turned = math.tau * layer / HEADINGS
        cos, sin = math.cos(turned), math.sin(turned)
        box = corners @ np.array([[cos, sin], [-sin, cos]])
        off = -(box.min(axis=0) + box.max(axis=0)) / 2
        off = np.round(off / STEP_M) * STEP_M
        room = (half - np.abs(box + off)).min()
        if room < bodies.margin_m:
            continue
        c, s = math.cos(elevator.heading), math.sin(elevator.heading)
        pose = (
            elevator.at[0] + c * off[0] - s * off[1],
            elevator.at[1] + s * off[0] + c * off[1],
            elevator.heading + turned,
        )
        found.append((-room, pose))
    return np.array([pose for _, pose in sorted(found)]).reshape(-1, 3)
