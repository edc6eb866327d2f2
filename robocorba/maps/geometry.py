"""What blocks a robot on a floor, as shapely geometry.

This is the one place that says how walls, doors, objects, elevator shafts and the
outline turn into obstacles; validation, planning, drawing and the automatic
topological map all read it from here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.maps.model import (
    BoxShape,
    Building,
    CircleShape,
    Door,
    Elevator,
    ElevatorDoor,
    Floor,
    GeometricalMap,
    MapObject,
    SegmentShape,
    Shape,
    Side,
    Wall,
)
from robocorba.spatial.pose import XY

#: A door cuts the walls along it that lie within this distance, m.
DOOR_REACH_M = 0.15
#: The landing door of an elevator also cuts building walls drawn in front of the shaft, m.
LANDING_REACH_M = 0.35
#: A wall runs along a door where the two directions differ by no more than this; one that meets it at an angle stays.
ALONG_RAD = math.radians(15)
#: A circle counts as a regular polygon around it with this many sides (0.5 % of its radius outside).
CIRCLE_SIDES = 32

Array = NDArray[np.float64]
_TURNS = 2 * math.pi * (np.arange(CIRCLE_SIDES) + 0.5) / CIRCLE_SIDES
#: The polygon around the circle of radius 1.
_DISC: Array = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)]) / math.cos(math.pi / CIRCLE_SIDES)


class Obstacle(NamedTuple):
    """A thing that blocks: kind and name as in the map, geometry a line or a polygon (solid)."""

    kind: str
    name: str
    geometry: BaseGeometry


def obstacles(building: Building, floor: str) -> tuple[Obstacle, ...]:
    """Everything that blocks on a floor, walls already cut open where doors are.

    As long as nothing on the floor changes the answer is the very same tuple, while the
    floor is among the last 64 asked for. Raises KeyError for an unknown floor."""
    entry = building.floors[floor]
    return _obstacles(_Key(entry.geometrical, entry.floor, tuple(building.elevators.values())))


class _Key:
    """Equal for maps that are the very same objects: what an edit did not touch is shared, so identity tells."""

    def __init__(self, geometrical: GeometricalMap, floor: Floor, elevators: tuple[Elevator, ...]) -> None:
        self.geometrical, self.floor, self.elevators = geometrical, floor, elevators
        blocking_parts = (geometrical.walls, geometrical.objects, geometrical.doors, floor, *elevators)
        self.ids = tuple(map(id, blocking_parts))

    def __hash__(self) -> int:
        return hash(self.ids)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.ids == other.ids


@lru_cache(maxsize=64)
def _obstacles(key: _Key) -> tuple[Obstacle, ...]:
    return blocking(key.geometrical, key.floor, key.elevators)


def blocking(plan: GeometricalMap, floor: Floor, elevators: Sequence[Elevator]) -> tuple[Obstacle, ...]:
    """What `obstacles` says, computed anew and not remembered: for a map that is asked for once."""
    doors = _ends(plan.doors.values())
    landings = [
        [landing_line(elevator, door) for door in elevator.doors if door.floor == floor.name] for elevator in elevators
    ]
    fronts = shapely.get_coordinates(list(chain.from_iterable(landings))).reshape(-1, 2, 2)
    reaches = np.repeat([DOOR_REACH_M, LANDING_REACH_M], [len(doors), len(fronts)])
    walls = _cut_open(_ends(plan.walls.values()), np.concatenate([doors, fronts]), reaches)

    found = [Obstacle("wall", name, left) for name, left in zip(plan.walls, walls, strict=True) if not left.is_empty]
    found += [Obstacle("object", thing.name, object_geometry(thing)) for thing in plan.objects.values()]
    found += [Obstacle("door", door.name, LineString([door.a, door.b])) for door in plan.doors.values() if door.locked]
    for elevator, lines in zip(elevators, landings, strict=True):
        shaft: BaseGeometry = shaft_polygon(elevator).exterior
        for line in lines:
            shaft = shaft.difference(line.buffer(1e-6, cap_style="square"))
        found.append(Obstacle("elevator", elevator.name, shaft))
    if floor.outline:
        found.append(Obstacle("floor", floor.name, Polygon(floor.outline).exterior))
    return tuple(found)


def _ends(lines: Iterable[Wall | Door]) -> Array:
    return np.array([(line.a, line.b) for line in lines], dtype=float).reshape(-1, 2, 2)


def _cut_open(walls: Array, openings: Array, reaches: Array) -> list[BaseGeometry]:
    """What openings (m, 2, 2) that reach so far (m,) leave of walls (n, 2, 2), each a line or several, maybe empty."""
    left = shapely.linestrings(walls)
    strips = shapely.buffer(shapely.linestrings(openings), reaches, cap_style="flat")
    by, which = STRtree(left).query(strips, predicate="intersects")
    along, across = (walls[:, 1] - walls[:, 0])[which], (openings[:, 1] - openings[:, 0])[by]
    sine = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    cosine = (along * across).sum(axis=1)
    parallel = np.abs(sine) <= math.tan(ALONG_RAD) * np.abs(cosine)
    for wall, strip in zip(which[parallel], by[parallel], strict=True):
        left[wall] = shapely.difference(left[wall], strips[strip])
    return left.tolist()


def object_geometry(thing: MapObject) -> BaseGeometry:
    """An object's footprint in the floor's frame: a line for a segment, else a polygon."""
    corners = _placed(_corners(thing.shape), thing.at, thing.heading)
    return shapely.linestrings(corners) if isinstance(thing.shape, SegmentShape) else shapely.polygons(corners)


def _corners(shape: Shape) -> Sequence[XY] | Array:
    """The corners of a shape in the object's frame; of a segment, its ends."""
    if isinstance(shape, SegmentShape):
        return (-shape.length / 2, 0.0), (shape.length / 2, 0.0)
    if isinstance(shape, BoxShape):
        return _rectangle(shape.size)
    if isinstance(shape, CircleShape):
        return shape.radius * _DISC
    return shape.points


def _rectangle(size: XY) -> Sequence[XY]:
    x, y = size[0] / 2, size[1] / 2
    return (-x, -y), (x, -y), (x, y), (-x, y)


def _placed(points: Sequence[XY] | Array, at: XY, heading: float) -> Array:
    """Points (n, 2) of the frame that stands at `at`, turned by `heading`, in the floor's frame."""
    cos, sin = math.cos(heading), math.sin(heading)
    x, y = np.asarray(points, dtype=float).T
    return np.column_stack([at[0] + cos * x - sin * y, at[1] + sin * x + cos * y])


def shaft_polygon(elevator: Elevator) -> Polygon:
    """The shaft's footprint in the floor's frame."""
    return shapely.polygons(_placed(_rectangle(elevator.size), elevator.at, elevator.heading))


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
    return shapely.linestrings(_placed(ends[door.side], elevator.at, elevator.heading))


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
    """Where the centre of a round robot may be: a polygon or multipolygon, never too large.

    Obstacles grow by `radius_m`, and by a little more where an arc is drawn as chords:
    1.1 % of the radius with 8 sides a quarter (`arc_sides`), 0.5 % with 12."""
    found = obstacles(building, floor)
    outline = building.floors[floor].floor.outline
    space: BaseGeometry = Polygon(outline) if outline else shapely.box(*bounds(building, floor))
    # A chord spans up to one and a half sides: the number of sides on an arc is rounded to the nearest.
    grown = radius_m / math.cos(1.5 * math.pi / (4 * arc_sides))
    solids = [item.geometry for item in found if item.geometry.geom_type == "Polygon"]
    if grown:
        blocked = shapely.union_all(shapely.buffer([item.geometry for item in found], grown, quad_segs=arc_sides))
    elif solids:
        blocked = shapely.union_all(solids)
    else:
        return space
    return space.difference(blocked)
