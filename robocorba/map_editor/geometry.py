"""The obstacles of a floor as shapely geometry.

Only this module converts walls, doors, objects, elevator shafts and the outline into
obstacles. Validation, planning, drawing and the automatic topological map use it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.derived import Derived
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    Elevator,
    ElevatorDoor,
    Floor,
    GeometricalMap,
    MapObject,
    SegmentShape,
    Shape,
    Wall,
)
from robocorba.map_editor.spatial.frames import into
from robocorba.map_editor.spatial.pose import XY

#: Maximum distance between a door and a parallel wall into which it cuts an opening [m].
DOOR_REACH_M = 0.15
#: The same for the landing door of an elevator [m]: it also cuts building walls drawn in front of the shaft.
LANDING_REACH_M = 0.35
#: Maximum angle between a door and a wall into which it cuts an opening [rad].
PARALLEL_TOLERANCE_RAD = math.radians(15)
#: Sides of the regular polygon circumscribed about a circle (exceeds the radius by 0.5 % at most).
CIRCLE_SIDES = 32

Array = NDArray[np.float64]
_OBSTACLES: Derived[GeometricalMap, tuple[Obstacle, ...]] = Derived()


class Obstacle(NamedTuple):
    """An obstacle: kind and name as in the map, geometry a line or a (solid) polygon."""

    kind: str
    name: str
    geometry: BaseGeometry


def obstacles(building: Building, floor: str) -> tuple[Obstacle, ...]:
    """All obstacles of a floor, with openings cut into the walls at doors.

    Kept as long as the map: an unchanged floor gives the identical tuple.
    Raises KeyError if the floor is unknown."""
    entry, elevators = building.floors[floor], building.elevators_through(floor)
    plan = entry.geometrical
    blocking_parts = (plan.walls, plan.objects, plan.doors, entry.floor, *elevators)
    return _OBSTACLES.of(plan, blocking_parts, lambda: compute_obstacles(plan, entry.floor, elevators))


def compute_obstacles(plan: GeometricalMap, floor: Floor, elevators: Sequence[Elevator]) -> tuple[Obstacle, ...]:
    """The result of `obstacles`, not cached: for a map that is used once. elevators: those whose shaft passes the
    floor."""
    doors = _end_points(plan.doors.values())
    landings = [
        [landing_line(elevator, door) for door in elevator.doors if door.floor == floor.name] for elevator in elevators
    ]
    fronts = shapely.get_coordinates(list(chain.from_iterable(landings))).reshape(-1, 2, 2)
    reaches = np.repeat([DOOR_REACH_M, LANDING_REACH_M], [len(doors), len(fronts)])
    walls = _cut_open(_end_points(plan.walls.values()), np.concatenate([doors, fronts]), reaches)

    found = [Obstacle("wall", name, left) for name, left in zip(plan.walls, walls, strict=True) if not left.is_empty]
    found += [Obstacle("object", map_object.name, object_geometry(map_object)) for map_object in plan.objects.values()]
    found += [Obstacle("door", door.name, LineString([door.a, door.b])) for door in plan.doors.values() if door.locked]
    for elevator, lines in zip(elevators, landings, strict=True):
        shaft: BaseGeometry = shaft_polygon(elevator).exterior
        for line in lines:
            shaft = shaft.difference(line.buffer(1e-6, cap_style="square"))
        found.append(Obstacle("elevator", elevator.name, shaft))
    if floor.outline:
        found.append(Obstacle("floor", floor.name, Polygon(floor.outline).exterior))
    return tuple(found)


def _end_points(lines: Iterable[Wall | Door]) -> Array:
    return np.array([(line.a, line.b) for line in lines], dtype=float).reshape(-1, 2, 2)


def _cut_open(walls: Array, openings: Array, reaches: Array) -> list[BaseGeometry]:
    """Walls (n, 2, 2) less the openings (m, 2, 2) that reach `reaches` (m,): (multi)lines, possibly empty."""
    left = shapely.linestrings(walls)
    strips = shapely.buffer(shapely.linestrings(openings), reaches, cap_style="flat")
    by, which = STRtree(left).query(strips, predicate="intersects")
    along, across = (walls[:, 1] - walls[:, 0])[which], (openings[:, 1] - openings[:, 0])[by]
    sine = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    cosine = (along * across).sum(axis=1)
    parallel = np.abs(sine) <= math.tan(PARALLEL_TOLERANCE_RAD) * np.abs(cosine)
    for wall, strip in zip(which[parallel], by[parallel], strict=True):
        left[wall] = shapely.difference(left[wall], strips[strip])
    return left.tolist()


def object_geometry(map_object: MapObject) -> BaseGeometry:
    """An object's footprint in the floor's frame: a line for a segment, else a polygon."""
    corners = to_floor_frame(_corners(map_object.shape), map_object.at, map_object.heading)
    return shapely.linestrings(corners) if isinstance(map_object.shape, SegmentShape) else shapely.polygons(corners)


def _corners(shape: Shape) -> Sequence[XY] | Array:
    """The corners of a shape in the object's frame; of a segment, its ends."""
    if isinstance(shape, SegmentShape):
        return (-shape.length / 2, 0.0), (shape.length / 2, 0.0)
    if isinstance(shape, BoxShape):
        return _rectangle(shape.size)
    if isinstance(shape, CircleShape):
        angles = 2 * math.pi * (np.arange(CIRCLE_SIDES) + 0.5) / CIRCLE_SIDES
        reach = shape.radius / math.cos(math.pi / CIRCLE_SIDES)  # of the corners, so that the sides touch the circle
        return reach * np.column_stack([np.cos(angles), np.sin(angles)])
    return shape.points


def _rectangle(size: XY) -> Sequence[XY]:
    x, y = size[0] / 2, size[1] / 2
    return (-x, -y), (x, -y), (x, y), (-x, y)


def to_floor_frame(points: Sequence[XY] | Array, at: XY, heading: float) -> Array:
    """Points (n, 2) of the frame at pose (`at`, `heading`), in the floor's frame."""
    cos, sin = math.cos(heading), math.sin(heading)
    x, y = np.asarray(points, dtype=float).T
    return np.column_stack([at[0] + cos * x - sin * y, at[1] + sin * x + cos * y])


def shaft_polygon(elevator: Elevator) -> Polygon:
    """The shaft's footprint in the floor's frame."""
    return shapely.polygons(to_floor_frame(_rectangle(elevator.size), elevator.at, elevator.heading))


def is_in_shaft(elevator: Elevator, x: float, y: float) -> bool:
    """Whether a point of the floor lies inside of the shaft's footprint."""
    across, along = into(x, y, (*elevator.at, elevator.heading))
    return abs(across) < elevator.size[0] / 2 and abs(along) < elevator.size[1] / 2


def landing_line(elevator: Elevator, door: ElevatorDoor) -> LineString:
    """The doorway of an elevator door, as a line on the shaft's side."""
    x, y, half = elevator.size[0] / 2, elevator.size[1] / 2, door.width / 2
    low, high = door.offset - half, door.offset + half
    ends: dict[CabinSide, tuple[XY, XY]] = {
        CabinSide.FRONT: ((low, -y), (high, -y)),
        CabinSide.BACK: ((low, y), (high, y)),
        CabinSide.LEFT: ((-x, low), (-x, high)),
        CabinSide.RIGHT: ((x, low), (x, high)),
    }
    return shapely.linestrings(to_floor_frame(ends[door.side], elevator.at, elevator.heading))


def subnet_at(areas: Iterable[Area], at: XY) -> str:
    """The sub-network of the smallest of the areas around a point that name one; empty if none does."""
    shapes = [(Polygon(area.polygon), area.subnet) for area in areas if area.subnet]
    around = [(shape.area, subnet) for shape, subnet in shapes if shape.intersects(Point(at))]
    return min(around)[1] if around else ""


def bounds(building: Building, floor: str, margin_m: float = 1.0) -> tuple[float, float, float, float]:
    """(min x, min y, max x, max y) of all obstacles and nodes of a floor; a unit square if it is empty."""
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
    """The free configuration space of a round robot's centre: a (multi)polygon, on the safe side.

    Obstacles are inflated by `radius_m`, and by slightly more where chords approximate an arc:
    1.1 % of the radius with 8 sides per quarter circle (`arc_sides`), 0.5 % with 12."""
    found = obstacles(building, floor)
    outline = building.floors[floor].floor.outline
    space: BaseGeometry = Polygon(outline) if outline else shapely.box(*bounds(building, floor))
    # shapely rounds the number of sides of an arc, so a chord spans up to 1.5 sides.
    grown = radius_m / math.cos(1.5 * math.pi / (4 * arc_sides))
    solids = [item.geometry for item in found if item.geometry.geom_type == "Polygon"]
    if grown:
        blocked = shapely.union_all(shapely.buffer([item.geometry for item in found], grown, quad_segs=arc_sides))
    elif solids:
        blocked = shapely.union_all(solids)
    else:
        return space
    return space.difference(blocked)
