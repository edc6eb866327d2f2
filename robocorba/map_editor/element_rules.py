"""The rules of a single element. Rules between elements: validation.py.

Every number is checked to be finite and of sensible size before it is used.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from ipaddress import ip_address
from itertools import pairwise
from typing import Any

import shapely
from shapely import LineString, Polygon

from robocorba.errors.places import metres, near
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    CabinSide,
    CircleShape,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    SegmentShape,
    Wall,
)
from robocorba.map_editor.spatial.pose import XY

#: Maximum length of a name [characters].
MAX_NAME = 200
#: Maximum coordinate, length [m], speed [m/s] or time [s].
MAX_NUMBER = 1e6
#: Minimum length [m] or speed [m/s]: closer points count as one, and lower speeds give meaningless travel times.
MIN_LENGTH = 1e-3
#: Tolerance of comparisons of lengths [m].
TOLERANCE_M = 1e-9


def violations(element: Element) -> Iterator[str]:
    """Every rule that `element` alone breaks."""
    yield from name_violations("the name", element.name)
    yield from _RULES[type(element)](element)


def name_violations(what: str, text: str) -> Iterator[str]:
    """Why `text` is not a valid name: 1 to MAX_NAME printable characters, no blank at its ends, and the one spelling of
    its characters that Unicode calls NFC, so that two names that look the same are the same. `what` names it in
    messages."""
    if not text:
        yield f"{what} is empty"
    elif len(text) > MAX_NAME:
        yield f"{what} has {len(text)} characters, at most {MAX_NAME} are allowed"
    elif not text.isprintable():
        wrong = next(letter for letter in text if not letter.isprintable())
        yield f"{what} holds the unprintable character U+{ord(wrong):04X}"
    elif text != text.strip():
        yield f"{what} {text[:80]!r} begins or ends with a blank; write {text.strip()[:80]!r}"
    elif not unicodedata.is_normalized("NFC", text):
        yield f"{what} {text[:80]!r} is not in Unicode's normal form NFC; compose its characters"


def _floor(floor: Floor) -> Iterator[str]:
    yield from (f"the name of a floor must not hold {mark!r}" for mark in ":/" if mark in floor.name)
    if not -(2**31) <= floor.level < 2**31:
        yield f"level must be from {-(2**31)} to {2**31 - 1}"
    yield from _number("elevation", floor.elevation)
    yield from _size("height", floor.height)
    if floor.outline:
        yield from _polygon("outline", floor.outline)


def _wall(wall: Wall) -> Iterator[str]:
    yield from _line(wall.a, wall.b)
    yield from _size("height", wall.height)


def _object(map_object: MapObject) -> Iterator[str]:
    yield from _point("at", map_object.at)
    yield from _number("heading", map_object.heading)
    yield from _size("height", map_object.height)
    if map_object.mass:
        yield from _number("mass", map_object.mass, 0.1, 10_000.0)
    shape = map_object.shape
    if isinstance(shape, SegmentShape):
        yield from _size("length", shape.length)
        if map_object.movable:
            yield "a segment has no width and no mass, so it can't be movable; make it a box or a polygon, or fixed"
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
        yield from name_violations("subnet", area.subnet)
    if area.gateway:
        try:
            ip_address(area.gateway)
        except ValueError:
            yield f"gateway {area.gateway[:80]!r} is not an IP address, such as 192.168.0.1"
        if not area.subnet:
            yield "it has a gateway, but no subnet"


def _node(node: PathNode) -> Iterator[str]:
    yield from _point("at", node.at)
    if node.elevator:
        yield from name_violations("elevator", node.elevator)


def _edge(edge: PathEdge) -> Iterator[str]:
    yield from name_violations("from", edge.a)
    yield from name_violations("to", edge.b)
    if edge.a == edge.b:
        yield "it leads from a node to the same node"
    if edge.speed_limit:
        yield from _number("speed_limit", edge.speed_limit, MIN_LENGTH)
    yield from _number("clearance", edge.clearance, 0.0)
    if len(edge.graphs) > 100:
        yield f"it belongs to {len(edge.graphs)} graphs, at most 100 are allowed"
    else:
        for graph in edge.graphs:
            yield from name_violations("the name of a graph", graph)


def _elevator(elevator: Elevator) -> Iterator[str]:
    yield from _point("at", elevator.at)
    yield from _number("heading", elevator.heading)
    yield from _size("size x", elevator.size[0])
    yield from _size("size y", elevator.size[1])
    yield from _number("speed", elevator.speed, MIN_LENGTH)
    yield from _number("door_time", elevator.door_time, 0.0)
    if not elevator.doors:
        yield "it serves no floor: it has no doors"
    elif len(elevator.doors) > 1000:
        yield f"it has {len(elevator.doors)} doors, at most 1000 are allowed"
    else:
        yield from _elevator_doors(elevator)


def _elevator_doors(elevator: Elevator) -> Iterator[str]:
    valid: dict[tuple[str, CabinSide], list[ElevatorDoor]] = {}
    for door in elevator.doors:
        wrong = [
            *name_violations("the floor of a door", door.floor),
            *_size("the width of a door", door.width),
            *_number("the offset of a door", door.offset),
        ]
        yield from wrong
        if not wrong:
            valid.setdefault((door.floor, door.side), []).append(door)
    for (floor, side), doors in valid.items():
        room = elevator.size[0 if side in (CabinSide.FRONT, CabinSide.BACK) else 1]
        for door in doors:
            if door.width > room + TOLERANCE_M:
                yield f"its {side.value} door on {floor!r} is {door.width:g} m wide, the side {room:g} m"
            elif abs(door.offset) + door.width / 2 > room / 2 + TOLERANCE_M:
                yield f"its {side.value} door on {floor!r} reaches beyond the side"
        doors.sort(key=lambda door: door.offset - door.width / 2)
        for left, right in pairwise(doors):
            if left.offset + left.width / 2 > right.offset - right.width / 2 + TOLERANCE_M:
                yield f"two of its {side.value} doors on {floor!r} overlap"


def _number(what: str, value: float, low: float = -MAX_NUMBER, high: float = MAX_NUMBER) -> Iterator[str]:
    if low <= value <= high:
        return
    if math.isnan(value) or value in (math.inf, -math.inf):
        yield f"{what} is not a finite number"
    else:
        yield f"{what} must be from {metres(low)} to {metres(high)}, not {value}"


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
    if len(points) > 10_000:
        yield f"{what} has {len(points)} points, at most 10000 are allowed"
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
        yield f"{what} crosses or touches itself" + (f" {near(float(spot[1]), float(spot[2]))}" if spot else "")
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
    """The size of an element in limits: 1, and 1 for each point, door or graph in it. 0 for None."""
    if element is None:
        return 0
    if isinstance(element, MapObject):
        return 1 + len(getattr(element.shape, "points", ()))
    parts = {PathEdge: "graphs", Floor: "outline", Area: "polygon", Elevator: "doors"}
    return 1 + len(getattr(element, parts.get(type(element), ""), ()))
