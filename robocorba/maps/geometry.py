"""What blocks a robot on a floor, as shapely geometry.

This is the one place that says how walls, doors, objects, elevator shafts and the
outline turn into obstacles; validation, planning, drawing and the automatic
topological map all read it from here.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import shapely
from shapely import LineString, Polygon
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

from robocorba.maps.model import (
    XY,
    BoxShape,
    Building,
    CircleShape,
    Elevator,
    ElevatorDoor,
    Floor,
    GeometricalMap,
    MapObject,
    SegmentShape,
    Side,
)

#: A door cuts the walls within this distance of it, m.
DOOR_REACH_M = 0.15
#: The landing door of an elevator also cuts building walls drawn in front of the shaft, m.
LANDING_REACH_M = 0.35
#: A circle counts as a regular polygon around it with this many sides (0.5 % of its radius outside).
CIRCLE_SIDES = 32


class Obstacle(NamedTuple):
    """A thing that blocks: kind and name as in the map, geometry a line or a polygon (solid)."""

    kind: str
    name: str
    geometry: BaseGeometry


def obstacles(building: Building, floor: str) -> tuple[Obstacle, ...]:
    """Everything that blocks on a floor, walls already cut open where doors are.

    Raises KeyError for an unknown floor."""
    entry = building.floors[floor]
    shafts = tuple(building.elevators.values())
    return _obstacles(_Key(entry.geometrical, entry.floor, shafts))


class _Key:
    """Equal for maps that are the very same objects: what an edit did not touch is shared, so identity tells."""

    def __init__(self, geometrical: GeometricalMap, floor: Floor, elevators: tuple[Elevator, ...]) -> None:
        self.geometrical, self.floor, self.elevators = geometrical, floor, elevators
        self.ids = (id(geometrical), id(floor), tuple(map(id, elevators)))

    def __hash__(self) -> int:
        return hash(self.ids)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.ids == other.ids


@lru_cache(maxsize=256)
def _obstacles(key: _Key) -> tuple[Obstacle, ...]:
    plan, floor = key.geometrical, key.floor
    doors = [LineString([door.a, door.b]) for door in plan.doors.values()]
    openings = [door.buffer(DOOR_REACH_M, cap_style="flat") for door in doors]
    landings = [
        (elevator, landing_line(elevator, door))
        for elevator in key.elevators
        for door in elevator.doors
        if door.floor == floor.name
    ]
    openings += [line.buffer(LANDING_REACH_M, cap_style="flat") for _, line in landings]
    cut = shapely.union_all(openings) if openings else None

    found = []
    for wall in plan.walls.values():
        line: BaseGeometry = LineString([wall.a, wall.b])
        if cut is not None and line.intersects(cut):
            line = line.difference(cut)
        if not line.is_empty:
            found.append(Obstacle("wall", wall.name, line))
    found += [Obstacle("object", thing.name, object_geometry(thing)) for thing in plan.objects.values()]
    found += [
        Obstacle("door", door.name, line) for door, line in zip(plan.doors.values(), doors, strict=True) if door.locked
    ]
    for elevator in key.elevators:
        shaft: BaseGeometry = shaft_polygon(elevator).exterior
        for owner, line in landings:
            if owner is elevator:
                shaft = shaft.difference(line.buffer(1e-6, cap_style="square"))
        found.append(Obstacle("elevator", elevator.name, shaft))
    if floor.outline:
        found.append(Obstacle("floor", floor.name, Polygon(floor.outline).exterior))
    return tuple(found)


def object_geometry(thing: MapObject) -> BaseGeometry:
    """An object's footprint in the floor's frame."""
    shape = thing.shape
    local: BaseGeometry
    if isinstance(shape, SegmentShape):
        local = LineString([(-shape.length / 2, 0.0), (shape.length / 2, 0.0)])
    elif isinstance(shape, BoxShape):
        x, y = shape.size[0] / 2, shape.size[1] / 2
        local = Polygon([(-x, -y), (x, -y), (x, y), (-x, y)])
    elif isinstance(shape, CircleShape):
        reach = shape.radius / math.cos(math.pi / CIRCLE_SIDES)
        turns = [2 * math.pi * (i + 0.5) / CIRCLE_SIDES for i in range(CIRCLE_SIDES)]
        local = Polygon([(reach * math.cos(turn), reach * math.sin(turn)) for turn in turns])
    else:
        local = Polygon(shape.points)
    return translate(rotate(local, thing.heading, origin=(0, 0), use_radians=True), *thing.at)


def shaft_polygon(elevator: Elevator) -> Polygon:
    """The shaft's footprint in the floor's frame."""
    x, y = elevator.size[0] / 2, elevator.size[1] / 2
    return Polygon([to_floor(elevator, corner) for corner in ((-x, -y), (x, -y), (x, y), (-x, y))])


def landing_line(elevator: Elevator, door: ElevatorDoor) -> LineString:
    """The doorway of an elevator on a floor, as a line on the shaft's side."""
    x, y, half = elevator.size[0] / 2, elevator.size[1] / 2, door.width / 2
    low, high = door.offset - half, door.offset + half
    ends: dict[Side, tuple[XY, XY]] = {
        Side.FRONT: ((low, -y), (high, -y)),
        Side.BACK: ((low, y), (high, y)),
        Side.LEFT: ((-x, low), (-x, high)),
        Side.RIGHT: ((x, low), (x, high)),
    }
    return LineString([to_floor(elevator, end) for end in ends[door.side]])


def to_floor(elevator: Elevator, point: XY) -> XY:
    """A point of the cabin's frame in the floor's frame."""
    cos, sin = math.cos(elevator.heading), math.sin(elevator.heading)
    return (
        elevator.at[0] + cos * point[0] - sin * point[1],
        elevator.at[1] + sin * point[0] + cos * point[1],
    )


def bounds(building: Building, floor: str, margin_m: float = 1.0) -> tuple[float, float, float, float]:
    """(min x, min y, max x, max y) of everything on a floor, nodes included; a square metre where it is empty."""
    entry = building.floors[floor]
    points = [node.at for node in entry.topological.nodes.values()]
    shapes = [obstacle.geometry for obstacle in obstacles(building, floor)]
    if points:
        shapes.append(shapely.multipoints(points))
    if not shapes:
        return -0.5, -0.5, 0.5, 0.5
    x0, y0, x1, y1 = shapely.total_bounds(shapes)
    return float(x0 - margin_m), float(y0 - margin_m), float(x1 + margin_m), float(y1 + margin_m)


def free_space(building: Building, floor: str, radius_m: float, arc_sides: int = 8) -> BaseGeometry:
    """Where the centre of a round robot may be: a polygon or multipolygon.

    Obstacles grow by `radius_m`; arcs are drawn outside the true arc with `arc_sides`
    sides a quarter, so that the result is never too large."""
    found = obstacles(building, floor)
    outline = building.floors[floor].floor.outline
    space: BaseGeometry = Polygon(outline) if outline else shapely.box(*bounds(building, floor))
    grown = radius_m / math.cos(math.pi / (4 * arc_sides)) if radius_m else 0.0
    solids = [item.geometry for item in found if item.geometry.geom_type == "Polygon"]
    if grown:
        blocked = shapely.union_all(shapely.buffer([item.geometry for item in found], grown, quad_segs=arc_sides))
    elif solids:
        blocked = shapely.union_all(solids)
    else:
        return space
    return space.difference(blocked)
