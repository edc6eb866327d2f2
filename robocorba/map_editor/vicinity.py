"""The obstacles around a part of a floor, without the cost of the whole floor.

An edit affects only its surroundings, so its check cuts doors into nearby walls only,
not into the thousands of others.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Generic, NamedTuple, TypeVar

from robocorba.map_editor.geometry import CIRCLE_SIDES, DOOR_REACH_M, LANDING_REACH_M, Obstacle, compute_obstacles
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    CircleShape,
    Door,
    Elevator,
    GeometricalMap,
    MapObject,
    PolygonShape,
    SegmentShape,
    Wall,
)
from robocorba.map_editor.spatial.pose import XY

T = TypeVar("T")


class IdentityKey(Generic[T]):
    """A cache key that compares by the identity of `value`, and keeps it alive."""

    __slots__ = ("value",)

    def __init__(self, value: T) -> None:
        self.value = value

    def __hash__(self) -> int:
        return hash(id(self.value))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, IdentityKey) and self.value is other.value


class Box(NamedTuple):
    """An axis-aligned rectangle [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    def intersects(self, other: Box) -> bool:
        """Whether the two share a point."""
        return self.x0 <= other.x1 and other.x0 <= self.x1 and self.y0 <= other.y1 and other.y0 <= self.y1


def obstacles_near(building: Building, floor: str, box: Box) -> tuple[Obstacle, ...]:
    """The obstacles of a floor that reach into `box`, and possibly others. Within `box`, doors are cut into them.

    Raises KeyError if the floor is unknown."""
    plan = building.floors[floor].geometrical
    nearby = GeometricalMap(
        walls={wall.name: wall for wall in walls_in(plan, box)},
        objects={name: entry for name, entry in plan.objects.items() if object_box(entry).intersects(box)},
        doors={door.name: door for door in plan.doors.values() if line_box(door, 2 * DOOR_REACH_M).intersects(box)},
    )
    lifts = [lift for lift in building.elevators_through(floor) if elevator_box(lift).intersects(box)]
    return compute_obstacles(nearby, building.floors[floor].floor, lifts)


def walls_in(plan: GeometricalMap, box: Box) -> Iterator[Wall]:
    """The walls whose bounding boxes intersect a box. Every edit visits all walls of a floor, so no Box is created."""
    x0, y0, x1, y1 = box
    for wall in plan.walls.values():
        (ax, ay), (bx, by) = wall.a, wall.b
        if (ax >= x0 or bx >= x0) and (ax <= x1 or bx <= x1) and (ay >= y0 or by >= y0) and (ay <= y1 or by <= y1):
            yield wall


def named_obstacles(building: Building, floor: str, names: Collection[tuple[str, str]]) -> tuple[Obstacle, ...]:
    """The obstacles of a floor whose (kind, name) is in `names`. Raises KeyError if the floor is unknown."""
    entry = building.floors[floor]
    plan = entry.geometrical
    nearby = GeometricalMap(
        walls={name: plan.walls[name] for kind, name in names if kind == "wall" and name in plan.walls},
        objects={name: plan.objects[name] for kind, name in names if kind == "object" and name in plan.objects},
        doors=plan.doors,
    )
    found = compute_obstacles(nearby, entry.floor, building.elevators_through(floor))
    return tuple(item for item in found if (item.kind, item.name) in names)


def bounding_box(boxes: Iterable[Box]) -> Box | None:
    """The bounding box of boxes, None if there are none."""
    sides = list(zip(*boxes, strict=True))
    return Box(min(sides[0]), min(sides[1]), max(sides[2]), max(sides[3])) if sides else None


def point_box(point: XY, grow_m: float) -> Box:
    """A square around a point with sides of 2 * `grow_m`."""
    return Box(point[0] - grow_m, point[1] - grow_m, point[0] + grow_m, point[1] + grow_m)


def line_box(line: Wall | Door, grow_m: float = 0.0) -> Box:
    """The bounding box of a wall or door, grown by `grow_m`."""
    (ax, ay), (bx, by) = line.a, line.b
    if ax > bx:
        ax, bx = bx, ax
    if ay > by:
        ay, by = by, ay
    return Box(ax - grow_m, ay - grow_m, bx + grow_m, by + grow_m)


def elevator_box(elevator: Elevator) -> Box:
    """A box around the shaft and the openings of its landing doors."""
    return point_box(elevator.at, math.hypot(*elevator.size) / 2 + 2 * LANDING_REACH_M)


def object_box(map_object: MapObject) -> Box:
    """A box that contains an object at every heading."""
    shape = map_object.shape
    if isinstance(shape, SegmentShape):
        reach = shape.length / 2
    elif isinstance(shape, BoxShape):
        reach = math.hypot(*shape.size) / 2
    elif isinstance(shape, CircleShape):
        reach = shape.radius / math.cos(math.pi / CIRCLE_SIDES)
    else:
        reach = _polygon_reach(IdentityKey(shape))
    return point_box(map_object.at, reach)


@lru_cache(maxsize=4096)
def _polygon_reach(shape: IdentityKey[PolygonShape]) -> float:
    return max(math.hypot(*point) for point in shape.value.points)


def walls_intersecting(building: Building, floor: str, openings: Sequence[Box]) -> Iterator[str]:
    """Names of the walls of a floor that intersect one of the boxes (of more than 50: their common bounding
    box)."""
    boxes = openings if len(openings) <= 50 else [box for box in [bounding_box(openings)] if box]
    reached = (wall.name for box in boxes for wall in walls_in(building.floors[floor].geometrical, box))
    yield from dict.fromkeys(reached)
