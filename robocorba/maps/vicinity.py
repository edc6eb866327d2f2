"""The obstacles around a part of a floor, without the cost of the whole floor.

What an edit can do wrong is near to it, so a check of the edit cuts doors into the
walls nearby and leaves the other thousands alone.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Generic, NamedTuple, TypeVar

from robocorba.maps.geometry import CIRCLE_SIDES, DOOR_REACH_M, LANDING_REACH_M, Obstacle, blocking
from robocorba.maps.model import (
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
from robocorba.spatial.pose import XY

#: Up to so many boxes are compared one by one.
FEW = 50

T = TypeVar("T")


class Same(Generic[T]):
    """A cache key that is equal only for the very same object, and keeps it alive."""

    __slots__ = ("value",)

    def __init__(self, value: T) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.value is other.value


class Box(NamedTuple):
    """A rectangle along the axes, m."""

    x0: float
    y0: float
    x1: float
    y1: float

    def meets(self, other: Box) -> bool:
        """Whether the two share a point."""
        return self.x0 <= other.x1 and other.x0 <= self.x1 and self.y0 <= other.y1 and other.y0 <= self.y1


def around(building: Building, floor: str, box: Box) -> tuple[Obstacle, ...]:
    """The obstacles of a floor that reach into `box`, and maybe some more; within `box` their openings are cut.

    Raises KeyError for an unknown floor."""
    entry = building.floors[floor]
    plan = entry.geometrical
    local = GeometricalMap(
        walls={wall.name: wall for wall in walls_in(plan, box)},
        objects={thing.name: thing for thing in plan.objects.values() if object_box(thing).meets(box)},
        doors={door.name: door for door in plan.doors.values() if line_box(door, 2 * DOOR_REACH_M).meets(box)},
    )
    lifts = [lift for lift in building.elevators.values() if elevator_box(lift).meets(box)]
    return blocking(local, entry.floor, lifts)


def walls_in(plan: GeometricalMap, box: Box) -> Iterator[Wall]:
    """The walls whose boxes meet a box. Runs over all walls of a floor with each edit: so without a Box for each."""
    x0, y0, x1, y1 = box
    for wall in plan.walls.values():
        (ax, ay), (bx, by) = wall.a, wall.b
        if (ax >= x0 or bx >= x0) and (ax <= x1 or bx <= x1) and (ay >= y0 or by >= y0) and (ay <= y1 or by <= y1):
            yield wall


def named_obstacles(building: Building, floor: str, names: Collection[tuple[str, str]]) -> tuple[Obstacle, ...]:
    """Those obstacles of a floor that are in `names`, by kind and name. Raises KeyError for an unknown floor."""
    entry = building.floors[floor]
    plan = entry.geometrical
    local = GeometricalMap(
        walls={name: plan.walls[name] for kind, name in names if kind == "wall" and name in plan.walls},
        objects={name: plan.objects[name] for kind, name in names if kind == "object" and name in plan.objects},
        doors=plan.doors,
    )
    found = blocking(local, entry.floor, list(building.elevators.values()))
    return tuple(item for item in found if (item.kind, item.name) in names)


def enclose(boxes: Iterable[Box]) -> Box | None:
    """The smallest box around all, None for none."""
    sides = list(zip(*boxes, strict=True))
    return Box(min(sides[0]), min(sides[1]), max(sides[2]), max(sides[3])) if sides else None


def point_box(point: XY, grow_m: float) -> Box:
    """A square around a point, `grow_m` to each side."""
    return Box(point[0] - grow_m, point[1] - grow_m, point[0] + grow_m, point[1] + grow_m)


def line_box(line: Wall | Door, grow_m: float = 0.0) -> Box:
    """The box around a wall or a door."""
    (ax, ay), (bx, by) = line.a, line.b
    if ax > bx:
        ax, bx = bx, ax
    if ay > by:
        ay, by = by, ay
    return Box(ax - grow_m, ay - grow_m, bx + grow_m, by + grow_m)


def elevator_box(elevator: Elevator) -> Box:
    """A box around the shaft and all that its landing doors cut open."""
    return point_box(elevator.at, math.hypot(*elevator.size) / 2 + 2 * LANDING_REACH_M)


def object_box(thing: MapObject) -> Box:
    """A box around an object, however it is turned."""
    shape = thing.shape
    if isinstance(shape, SegmentShape):
        reach = shape.length / 2
    elif isinstance(shape, BoxShape):
        reach = math.hypot(*shape.size) / 2
    elif isinstance(shape, CircleShape):
        reach = shape.radius / math.cos(math.pi / CIRCLE_SIDES)
    else:
        reach = _reach(Same(shape))
    return point_box(thing.at, reach)


@lru_cache(maxsize=4096)
def _reach(shape: Same[PolygonShape]) -> float:
    return max(math.hypot(*point) for point in shape.value.points)


def walls_cut_by(building: Building, floor: str, openings: Sequence[Box]) -> Iterator[str]:
    """Names of the walls of a floor that reach into one of the boxes; of many boxes, into the box around all."""
    boxes = openings if len(openings) <= FEW else [box for box in [enclose(openings)] if box]
    reached = (wall.name for box in boxes for wall in walls_in(building.floors[floor].geometrical, box))
    yield from dict.fromkeys(reached)
