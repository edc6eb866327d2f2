"""A building as the paper's map editor sees it.

Each floor has two maps: a geometrical map (outline, walls, objects, doors, areas)
and a topological map (path nodes and edges). Elevators tie the floors together.

Units: metres, seconds, radians counter-clockwise from +x. All values are immutable;
an edit returns a new building that shares all unchanged parts, so the building that a
reader holds stays consistent. The dictionaries are keyed by element name and must
never be changed in place.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Any, TypeAlias

import msgspec

from robocorba.map_editor.spatial.pose import XY


class ElementKind(str, Enum):
    """The kinds of elements that an edit creates, changes or removes."""

    FLOOR = "floor"
    WALL = "wall"
    OBJECT = "object"
    DOOR = "door"
    AREA = "area"
    NODE = "node"
    EDGE = "edge"
    ELEVATOR = "elevator"


class DoorKind(str, Enum):
    """How a door moves. An opening is a doorway without a leaf."""

    OPENING = "opening"
    HINGED = "hinged"
    DOUBLE_HINGED = "double_hinged"
    SLIDING = "sliding"
    DOUBLE_SLIDING = "double_sliding"


class CabinSide(str, Enum):
    """A side of an elevator cabin in its own frame: front is -y, back +y, left -x, right +x."""

    FRONT = "front"
    BACK = "back"
    LEFT = "left"
    RIGHT = "right"


class _Struct(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False):
    """Immutable, so never part of a reference cycle: the garbage collector need not visit hundreds of thousands of
    elements, which stopped all threads for a quarter of a second."""


class Floor(_Struct, frozen=True):
    """A storey. `level` orders the floors, `elevation` is the height of its ground [m],
    `outline` is the simple polygon that bounds it (empty: unbounded)."""

    name: str
    level: int
    elevation: float
    height: float = 3.0
    outline: tuple[XY, ...] = ()


class Wall(_Struct, frozen=True):
    """A straight wall from a to b, without thickness. `height` in m."""

    name: str
    a: XY = msgspec.field(name="from")
    b: XY = msgspec.field(name="to")
    height: float = 2.5


class SegmentShape(_Struct, frozen=True, tag_field="kind", tag="segment"):
    """A line segment along the object's x axis, centred on its pose. `length` in m."""

    length: float


class BoxShape(_Struct, frozen=True, tag_field="kind", tag="box"):
    """A rectangle centred on the object's pose. `size` [m] is along the object's x and y axes."""

    size: XY


class CircleShape(_Struct, frozen=True, tag_field="kind", tag="circle"):
    """A disc around the object's pose. `radius` in m."""

    radius: float


class PolygonShape(_Struct, frozen=True, tag_field="kind", tag="polygon"):
    """A simple polygon in the object's frame."""

    points: tuple[XY, ...]


Shape: TypeAlias = SegmentShape | BoxShape | CircleShape | PolygonShape


class MapObject(_Struct, frozen=True):
    """An object on the floor: table, shelf, column. Robots can push or carry movable objects. `mass` in kg, 0 for that
    of a table of its area, 9 kg/m^2."""

    name: str
    shape: Shape
    at: XY
    heading: float = 0.0
    height: float = 1.0
    movable: bool = False
    mass: float = 0.0


class Door(_Struct, frozen=True):
    """A doorway from a to b. It cuts an opening into a wall on which it lies. A locked door blocks like a wall."""

    name: str
    a: XY = msgspec.field(name="from")
    b: XY = msgspec.field(name="to")
    kind: DoorKind = DoorKind.HINGED
    locked: bool = False


class Area(_Struct, frozen=True):
    """A named polygon of a floor: a room, a zone to avoid. `subnet` names its sub-network, if it has one;
    `gateway` is the IP address of that one's gateway, if it is known."""

    name: str
    polygon: tuple[XY, ...]
    subnet: str = ""
    gateway: str = ""


class PathNode(_Struct, frozen=True):
    """A node of the topological map. `elevator` names the elevator whose cabin holds the node, if any."""

    name: str
    at: XY
    elevator: str = ""


class PathEdge(_Struct, frozen=True, kw_only=True):
    """A straight line that robots drive between two nodes of one floor. Its default name is from-to.

    `one_way`: only from a to b. `speed_limit` in m/s, 0 for none. `clearance` is the
    largest robot radius [m] that may use the edge, 0 for no limit beyond the obstacles.
    `graphs` names the navigation graphs of the edge (empty: all)."""

    name: str = ""
    a: str = msgspec.field(name="from")
    b: str = msgspec.field(name="to")
    one_way: bool = False
    speed_limit: float = 0.0
    clearance: float = 0.0
    graphs: tuple[str, ...] = ()


class ElevatorDoor(_Struct, frozen=True):
    """A door of an elevator on one floor: its `width` [m] and its `offset` [m] from the middle of its side."""

    floor: str
    side: CabinSide = CabinSide.FRONT
    width: float = 1.0
    offset: float = 0.0


class Elevator(_Struct, frozen=True):
    """An elevator: a rectangular shaft, and a door for each floor served.

    `size` is width (own x) and depth (own y) of the shaft in m, `speed` in m/s,
    `door_time` [s] is the time that its doors take to open or to close."""

    name: str
    at: XY
    size: XY
    doors: tuple[ElevatorDoor, ...]
    heading: float = 0.0
    speed: float = 1.0
    door_time: float = 3.0

    def floors(self) -> tuple[str, ...]:
        """Names of the served floors, without duplicates."""
        return tuple(dict.fromkeys(door.floor for door in self.doors))


Element: TypeAlias = Floor | Wall | MapObject | Door | Area | PathNode | PathEdge | Elevator

KIND_OF: dict[type, ElementKind] = {
    Floor: ElementKind.FLOOR,
    Wall: ElementKind.WALL,
    MapObject: ElementKind.OBJECT,
    Door: ElementKind.DOOR,
    Area: ElementKind.AREA,
    PathNode: ElementKind.NODE,
    PathEdge: ElementKind.EDGE,
    Elevator: ElementKind.ELEVATOR,
}
TYPE_OF: dict[ElementKind, type] = {kind: struct for struct, kind in KIND_OF.items()}


class GeometricalMap(msgspec.Struct, frozen=True, weakref=True):
    """The geometrical map of a floor: walls, objects, doors and areas by name."""

    walls: dict[str, Wall] = {}
    objects: dict[str, MapObject] = {}
    doors: dict[str, Door] = {}
    areas: dict[str, Area] = {}


class TopologicalMap(msgspec.Struct, frozen=True, weakref=True):
    """The topological map of a floor: path nodes and path edges by name."""

    nodes: dict[str, PathNode] = {}
    edges: dict[str, PathEdge] = {}


class FloorMap(msgspec.Struct, frozen=True):
    """A floor with its two maps."""

    floor: Floor
    geometrical: GeometricalMap = GeometricalMap()
    topological: TopologicalMap = TopologicalMap()

    @classmethod
    def of(cls, floor: Floor, elements: Mapping[ElementKind, dict[str, Any]]) -> FloorMap:
        """A floor with its elements, by kind and name."""
        layers: dict[str, dict[str, Any]] = {"geometrical": {}, "topological": {}}
        for kind, collection in elements.items():
            layers[COLLECTION_OF[kind][0]][COLLECTION_OF[kind][1]] = collection
        return cls(floor, GeometricalMap(**layers["geometrical"]), TopologicalMap(**layers["topological"]))


#: Where a floor stores each kind of element: attribute of FloorMap, attribute of that map.
COLLECTION_OF: dict[ElementKind, tuple[str, str]] = {
    ElementKind.WALL: ("geometrical", "walls"),
    ElementKind.OBJECT: ("geometrical", "objects"),
    ElementKind.DOOR: ("geometrical", "doors"),
    ElementKind.AREA: ("geometrical", "areas"),
    ElementKind.NODE: ("topological", "nodes"),
    ElementKind.EDGE: ("topological", "edges"),
}


class Building(msgspec.Struct, frozen=True):
    """Floors by name, in order of their level, and elevators by name."""

    name: str
    floors: dict[str, FloorMap] = {}
    elevators: dict[str, Elevator] = {}

    def elements(self, kind: ElementKind, floor: str = "") -> dict[str, Element]:
        """All elements of a kind by name, empty for an unknown floor. `floor` is ignored for floors and elevators."""
        if kind is ElementKind.FLOOR:
            return {name: entry.floor for name, entry in self.floors.items()}
        if kind is ElementKind.ELEVATOR:
            return dict(self.elevators)
        return _collection(self.floors[floor], kind) if floor in self.floors else {}

    def find(self, kind: ElementKind, floor: str, name: str) -> Element | None:
        """The element, or None."""
        return self.elements(kind, floor).get(name)

    def elevators_through(self, floor: str) -> tuple[Elevator, ...]:
        """The elevators whose shaft passes a floor: from the lowest floor that they serve to the highest.

        Raises KeyError for an unknown floor."""
        height = self.floors[floor].floor.elevation
        passing = []
        for elevator in self.elevators.values():
            served = [self.floors[name].floor.elevation for name in elevator.floors() if name in self.floors]
            if served and min(served) <= height <= max(served):
                passing.append(elevator)
        return tuple(passing)

    def with_element(self, floor: str, element: Element) -> Building:
        """A building with `element` added, or replaced if its kind and name exist.

        Raises KeyError if the floor does not exist."""
        return self.with_changes([(KIND_OF[type(element)], floor, element.name, element)])

    def without(self, kind: ElementKind, floor: str, name: str) -> Building:
        """A building without that element. Raises KeyError if it does not exist."""
        return self.with_changes([(kind, floor, name, None)])

    def with_changes(self, changes: Iterable[tuple[ElementKind, str, str, Element | None]]) -> Building:
        """A building with elements (kind, floor, name, element) added, replaced, or removed (None), in this order.

        Each dictionary is copied once, however many of its elements change. `floor` is ignored for floors and
        elevators. Raises KeyError if a floor or a removed element does not exist."""
        floors = dict(self.floors)
        copies: dict[tuple[ElementKind, str], dict[str, Any]] = {}
        for kind, floor, name, element in changes:
            if kind is ElementKind.FLOOR:
                if element is None:
                    del floors[name]
                    copies = {key: copy for key, copy in copies.items() if key[1] != name}
                else:
                    entry: Any = floors.get(name) or FloorMap(element)  # type: ignore[arg-type]
                    floors[name] = msgspec.structs.replace(entry, floor=element)
                continue
            key = kind, floor if kind in COLLECTION_OF else ""
            if key not in copies:
                copies[key] = dict(_collection(floors[floor], kind) if kind in COLLECTION_OF else self.elevators)
            if element is None:
                del copies[key][name]
            else:
                copies[key][name] = element
        elevators = copies.pop((ElementKind.ELEVATOR, ""), self.elevators)
        for (kind, floor), copy in copies.items():
            layer, collection = COLLECTION_OF[kind]
            changed = msgspec.structs.replace(getattr(floors[floor], layer), **{collection: copy})
            floors[floor] = msgspec.structs.replace(floors[floor], **{layer: changed})
        return Building(self.name, by_level(floors), elevators)


def _collection(entry: FloorMap, kind: ElementKind) -> dict[str, Any]:
    layer, collection = COLLECTION_OF[kind]
    return getattr(getattr(entry, layer), collection)


def with_topology(building: Building, floor: str, topology: TopologicalMap) -> Building:
    """A building with another topological map of a floor."""
    entry = msgspec.structs.replace(building.floors[floor], topological=topology)
    return msgspec.structs.replace(building, floors={**building.floors, floor: entry})


def by_level(floors: dict[str, FloorMap]) -> dict[str, FloorMap]:
    """Floors in the order of a building: by level."""
    return dict(sorted(floors.items(), key=lambda item: (item[1].floor.level, item[0])))
