"""What can be wrong with an element by itself, in plain words. Rules between elements: validation.py.

Nothing here computes with a number before it is known to be finite and of sensible size.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import shapely
from shapely import LineString, Polygon

from robocorba.maps.model import (
    Area,
    BoxShape,
    CircleShape,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    PolygonShape,
    SegmentShape,
    Side,
    Wall,
)
from robocorba.spatial.pose import XY

#: Longest name, characters.
MAX_NAME = 200
#: Largest coordinate, length, speed or time: m, m/s, s.
MAX_NUMBER = 1e6
#: Smallest length (m) or speed (m/s): below it two points are one, and times of travel lose all meaning.
MIN_LENGTH = 1e-3
#: Most points of a polygon, doors of an elevator, graphs of an edge.
MAX_POINTS, MAX_DOORS, MAX_GRAPHS = 10_000, 1_000, 100
#: Lengths that differ by less are equal, m.
SLACK_M = 1e-9
_INT32 = 2**31


def faults(element: Element) -> Iterator[str]:
    """Every reason why `element` is not acceptable, whatever else is in the building."""
    yield from name_faults("the name", element.name)
    yield from _RULES[type(element)](element)


def name_faults(what: str, text: str) -> Iterator[str]:
    """Reasons why `text` is no name: 1 to MAX_NAME printable characters are."""
    if not text:
        yield f"{what} is empty"
    elif len(text) > MAX_NAME:
        yield f"{what} has {len(text)} characters, at most {MAX_NAME} are allowed"
    elif not text.isprintable():
        wrong = next(letter for letter in text if not letter.isprintable())
        yield f"{what} holds the unprintable character U+{ord(wrong):04X}"


def _floor(floor: Floor) -> Iterator[str]:
    yield from (f"the name of a floor must not hold {mark!r}" for mark in ":/" if mark in floor.name)
    if not -_INT32 <= floor.level < _INT32:
        yield f"level must be from {-_INT32} to {_INT32 - 1}"
    yield from _number("elevation", floor.elevation)
    yield from _size("height", floor.height)
    if floor.outline:
        yield from _polygon("outline", floor.outline)


def _wall(wall: Wall) -> Iterator[str]:
    yield from _line(wall.a, wall.b)
    yield from _size("height", wall.height)


def _object(thing: MapObject) -> Iterator[str]:
    yield from _point("at", thing.at)
    yield from _number("heading", thing.heading)
    yield from _size("height", thing.height)
    shape = thing.shape
    if isinstance(shape, SegmentShape):
        yield from _size("length", shape.length)
    elif isinstance(shape, BoxShape):
        yield from _size("size x", shape.size[0])
        yield from _size("size y", shape.size[1])
    elif isinstance(shape, CircleShape):
        yield from _size("radius", shape.radius)
    else:
        yield from _polygon("the polygon", shape.points)


def _door(door: Door) -> Iterator[str]:
    yield from _line(door.a, door.b)


def _area(area: Area) -> Iterator[str]:
    yield from _polygon("the polygon", area.polygon)
    if area.subnet:
        yield from name_faults("subnet", area.subnet)


def _node(node: PathNode) -> Iterator[str]:
    yield from _point("at", node.at)
    if node.elevator:
        yield from name_faults("elevator", node.elevator)


def _edge(edge: PathEdge) -> Iterator[str]:
    yield from name_faults("from", edge.a)
    yield from name_faults("to", edge.b)
    if edge.a == edge.b:
        yield "it leads from a node to the same node"
    if edge.speed_limit:
        yield from _number("speed_limit", edge.speed_limit, MIN_LENGTH)
    yield from _number("clearance", edge.clearance, 0.0)
    if len(edge.graphs) > MAX_GRAPHS:
        yield f"it belongs to {len(edge.graphs)} graphs, at most {MAX_GRAPHS} are allowed"
    else:
        for graph in edge.graphs:
            yield from name_faults("the name of a graph", graph)


def _elevator(elevator: Elevator) -> Iterator[str]:
    yield from _point("at", elevator.at)
    yield from _number("heading", elevator.heading)
    yield from _size("size x", elevator.size[0])
    yield from _size("size y", elevator.size[1])
    yield from _number("speed", elevator.speed, MIN_LENGTH)
    yield from _number("door_time", elevator.door_time, 0.0)
    if not elevator.doors:
        yield "it serves no floor: it has no doors"
    elif len(elevator.doors) > MAX_DOORS:
        yield f"it has {len(elevator.doors)} doors, at most {MAX_DOORS} are allowed"
    else:
        yield from _elevator_doors(elevator)


def _elevator_doors(elevator: Elevator) -> Iterator[str]:
    sound: dict[tuple[str, Side], list[ElevatorDoor]] = {}
    for door in elevator.doors:
        wrong = [
            *name_faults("the floor of a door", door.floor),
            *_size("the width of a door", door.width),
            *_number("the offset of a door", door.offset),
        ]
        yield from wrong
        if not wrong:
            sound.setdefault((door.floor, door.side), []).append(door)
    for (floor, side), doors in sound.items():
        room = elevator.size[0 if side in (Side.FRONT, Side.BACK) else 1]
        for door in doors:
            if door.width > room + SLACK_M:
                yield f"its {side.value} door on {floor!r} is {door.width:g} m wide, the side {room:g} m"
            elif abs(door.offset) + door.width / 2 > room / 2 + SLACK_M:
                yield f"its {side.value} door on {floor!r} reaches beyond the side"
        doors.sort(key=lambda door: door.offset - door.width / 2)
        for left, right in pairwise(doors):
            if left.offset + left.width / 2 > right.offset - right.width / 2 + SLACK_M:
                yield f"two of its {side.value} doors on {floor!r} overlap"


def _number(what: str, value: float, low: float = -MAX_NUMBER, high: float = MAX_NUMBER) -> Iterator[str]:
    if low <= value <= high:
        return
    if math.isnan(value) or value in (math.inf, -math.inf):
        yield f"{what} is not a finite number"
    else:
        yield f"{what} must be from {low:g} to {high:g}, not {value}"


def _size(what: str, value: float) -> Iterator[str]:
    return _number(what, value, MIN_LENGTH)


def _point(what: str, point: XY) -> Iterator[str]:
    yield from _number(f"{what} x", point[0])
    yield from _number(f"{what} y", point[1])


def _line(a: XY, b: XY) -> Iterator[str]:
    wrong = [*_point("from", a), *_point("to", b)]
    yield from wrong
    if not wrong and math.dist(a, b) < MIN_LENGTH:
        yield "it has no length"


def _polygon(what: str, points: Sequence[XY]) -> Iterator[str]:
    if len(points) < 3:
        yield f"{what} has {len(points)} points, a polygon has 3 or more"
        return
    if len(points) > MAX_POINTS:
        yield f"{what} has {len(points)} points, at most {MAX_POINTS} are allowed"
        return
    for number, point in enumerate(points, 1):
        wrong = next(_point(f"{what}: point {number}", point), None)
        if wrong is not None:
            yield wrong
            return
    shape = Polygon(points)
    if LineString(points).convex_hull.area < MIN_LENGTH**2:
        yield f"{what} encloses no area"
    elif not shape.is_valid:
        spot = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(shape))
        yield f"{what} crosses or touches itself" + (f" near {float(spot[1]):g}, {float(spot[2]):g}" if spot else "")
    elif shape.area < MIN_LENGTH**2:
        yield f"{what} encloses no area"


_RULES: dict[type, Callable[[Any], Iterator[str]]] = {
    Floor: _floor,
    Wall: _wall,
    MapObject: _object,
    Door: _door,
    Area: _area,
    PathNode: _node,
    PathEdge: _edge,
    Elevator: _elevator,
}


def size_of(element: Element | None) -> int:
    """What an element counts where memory is bounded: one, and one for each point, door or graph it lists."""
    if isinstance(element, PathNode | Wall | Door):
        return 1
    if isinstance(element, PathEdge):
        return 1 + len(element.graphs)
    if isinstance(element, Floor):
        return 1 + len(element.outline)
    if isinstance(element, Area):
        return 1 + len(element.polygon)
    if isinstance(element, Elevator):
        return 1 + len(element.doors)
    if isinstance(element, MapObject) and isinstance(element.shape, PolygonShape):
        return 1 + len(element.shape.points)
    return 0 if element is None else 1
