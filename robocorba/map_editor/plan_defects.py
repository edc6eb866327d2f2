"""What is probably drawn wrong in a floor's plan, though it breaks no rule: walls through objects, doors beside all
walls, movable objects that are too heavy, rooms without a door."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import shapely
from shapely import LineString, Point, Polygon, STRtree

from robocorba.errors.maps import describe
from robocorba.errors.places import near
from robocorba.map_editor.collisions import TOUCH_M
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.geometry import (
    DOOR_REACH_M,
    PARALLEL_TOLERANCE_RAD,
    Obstacle,
    bounds,
    obstacles,
    shaft_polygon,
)
from robocorba.map_editor.model import Building, Door, ElementKind, FloorMap, Wall
from robocorba.map_editor.spatial.pose import MAX_CARRIERS, PAYLOAD_KG

#: A wall goes through an object from this depth on [m]; objects that only touch walls are common.
DEPTH_M = 0.05
#: Radius of the robot that must be able to leave a room [m]: small, so that only closed rooms are found.
ROOM_ROBOT_M = 0.3


def plan_defects(building: Building, floor: str, robot_m: float = ROOM_ROBOT_M) -> Iterator[Finding]:
    """The defects of a floor's plan. robot_m: radius of the robot that must be able to leave a room, if that is smaller
    than ROOM_ROBOT_M. Raises KeyError if the floor is unknown."""
    found = obstacles(building, floor)
    yield from _walls_through_objects(found, floor)
    plan = building.floors[floor].geometrical
    fixed = [item for item in found if not (item.kind == "object" and plan.objects[item.name].movable)]
    yield from _doors_beside_walls(building.floors[floor], fixed)
    yield from _too_heavy(building.floors[floor])
    yield from _closed_rooms(building, floor, fixed, min(robot_m, ROOM_ROBOT_M))


def _walls_through_objects(found: Sequence[Obstacle], floor: str) -> Iterator[Finding]:
    walls = [item for item in found if item.kind == "wall"]
    solids = [item for item in found if item.kind == "object" and item.geometry.geom_type == "Polygon"]
    cores = shapely.buffer([item.geometry for item in solids], -DEPTH_M)
    tree = STRtree([item.geometry for item in walls])
    for solid, wall in tree.query(cores, predicate="intersects").T:
        inside = walls[wall].geometry.intersection(solids[solid].geometry)
        yield _defect(
            ElementKind.WALL,
            walls[wall].name,
            (floor, inside.centroid.x, inside.centroid.y),
            f"it goes through {describe('object', '', solids[solid].name)}",
            f"walls of {floor} that go through objects",
        )


def _doors_beside_walls(entry: FloorMap, fixed: Sequence[Obstacle]) -> Iterator[Finding]:
    walls = list(entry.geometrical.walls.values())
    lines = STRtree([LineString([wall.a, wall.b]) for wall in walls])
    frames = STRtree([item.geometry for item in fixed if item.kind != "door"])
    for door in entry.geometrical.doors.values():
        line = LineString([door.a, door.b])
        reached = lines.query(line.buffer(DOOR_REACH_M, cap_style="flat"), predicate="intersects").tolist()
        ends = [Point(door.a), Point(door.b)]
        is_between = all(len(frames.query(end, predicate="dwithin", distance=DOOR_REACH_M)) for end in ends)
        if not is_between and not any(_are_parallel(door, walls[i]) for i in reached):
            yield _defect(
                ElementKind.DOOR,
                door.name,
                (entry.floor.name, line.centroid.x, line.centroid.y),
                "it lies neither on a wall nor between two walls",
                f"doors of {entry.floor.name} on no wall",
            )


def _too_heavy(entry: FloorMap) -> Iterator[Finding]:
    """Movable objects that no robots can carry, by the mass that the map gives."""
    for item in entry.geometrical.objects.values():
        needed = math.ceil(item.mass / PAYLOAD_KG - 1e-9) if item.movable else 0
        if needed > MAX_CARRIERS:
            yield _defect(
                ElementKind.OBJECT,
                item.name,
                (entry.floor.name, *item.at),
                f"its {item.mass:g} kg need {needed} robots of {PAYLOAD_KG:g} kg; at most {MAX_CARRIERS} carry it",
                f"movable objects of {entry.floor.name} that are too heavy for {MAX_CARRIERS} robots",
            )


def _are_parallel(one: Door, other: Wall) -> bool:
    """Whether a door cuts an opening into a wall that it reaches."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = one.a, one.b, other.a, other.b
    sine = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
    cosine = (bx - ax) * (dx - cx) + (by - ay) * (dy - cy)
    return abs(sine) <= math.tan(PARALLEL_TOLERANCE_RAD) * abs(cosine)


def _closed_rooms(building: Building, floor: str, fixed: Sequence[Obstacle], robot_m: float) -> Iterator[Finding]:
    """Regions that a robot can't leave, except the one that holds the floor's roadmap, those with an elevator, and
    those with a locked door."""
    entry = building.floors[floor]
    doors = entry.geometrical.doors.values()
    for part in _enclosed_regions(building, floor, fixed, robot_m):
        ways = [door for door in doors if LineString([door.a, door.b]).distance(part) <= robot_m + DOOR_REACH_M]
        if any(door.locked for door in ways):
            continue
        middle = part.representative_point()
        around = [area for area in entry.geometrical.areas.values() if Polygon(area.polygon).contains(middle)]
        name = min(around, key=lambda area: Polygon(area.polygon).area).name if around else ""
        room = "it" if name else f"the room of {part.buffer(robot_m, join_style='mitre').area:.0f} m² here"
        reason = f"{room} has no door"
        if ways:
            narrow = ", ".join(f"{door.name} of {math.dist(door.a, door.b):.2f} m" for door in ways)
            reason = f"a robot of radius {robot_m:.2f} m can't leave {room} through its doors: {narrow}"
        kind = ElementKind.AREA if name else ElementKind.FLOOR
        yield _defect(kind, name, (floor, middle.x, middle.y), reason, f"closed rooms of {floor}")


def _defect(kind: ElementKind, name: str, where: tuple[str, float, float], reason: str, group: str) -> Finding:
    """A finding. Without a `name` the element is the floor. group: what all defects of its kind are, as in "walls of L1
    that go through objects"."""
    floor, x, y = where
    on_floor = floor if name else ""
    subject = f"{name} {near(x, y)}".lstrip()
    return Finding(kind, on_floor, name or floor, where, reason, f"{group} ({{n}}): {{names}}", subject)


def _enclosed_regions(building: Building, floor: str, fixed: Sequence[Obstacle], robot_m: float) -> list[Polygon]:
    """Where the robot's middle can be, by region; without the floor's main region and those with an elevator."""
    outline = building.floors[floor].floor.outline
    frame = Polygon(outline) if outline else shapely.box(*bounds(building, floor, 1.0 + robot_m))
    # Chords within the arcs approximate round corners, so a gap appears up to 4 % wider.
    blocked = shapely.union_all(shapely.buffer([item.geometry for item in fixed], robot_m - TOUCH_M, quad_segs=3))
    # Smaller regions than 1 m² (for the robot's middle) are no rooms but gaps between furniture.
    parts: list[Polygon] = [part for part in shapely.get_parts(frame.difference(blocked)) if part.area >= 1.0]
    shafts = {lift.name: shaft_polygon(lift) for lift in building.elevators_through(floor)}
    parts = [part for part in parts if not any(shaft.contains(part) for shaft in shafts.values())]
    if len(parts) < 2:
        return []
    nodes = [Point(node.at) for node in building.floors[floor].topological.nodes.values()]
    tree = STRtree(nodes)
    counts = [len(tree.query(part, predicate="intersects")) for part in parts]
    is_outside = [not outline and part.intersects(frame.exterior) for part in parts]
    inside = [i for i in range(len(parts)) if not is_outside[i]]
    main = max(range(len(parts)) if any(counts) else inside, key=lambda i: (counts[i], parts[i].area), default=None)
    stops = [shafts[lift.name].centroid for lift in building.elevators_through(floor) if floor in lift.floors()]
    return [parts[i] for i in inside if i != main and not any(map(parts[i].intersects, stops))]
