"""Structs of the IDL to values of the domain and back, and domain errors to IDL exceptions.

The only module that knows both sides; servants and commands call it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, NoReturn

from omniORB import CORBA

from robocorba import errors
from robocorba.maps.changes import Change, Key
from robocorba.maps.model import (
    XY,
    Area,
    BoxShape,
    CircleShape,
    Door,
    DoorKind,
    Element,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    PolygonShape,
    SegmentShape,
    Shape,
    Side,
    Wall,
)
from robocorba.planning.request import Criterion, Names, Path, PathRequest, Place, PointKind, RouteMode
from robocorba.stubs import RoboCorba

# ---- enums ----

_KINDS = dict(zip(ElementKind, (
    RoboCorba.FLOOR_ELEMENT, RoboCorba.WALL_ELEMENT, RoboCorba.OBJECT_ELEMENT, RoboCorba.DOOR_ELEMENT,
    RoboCorba.AREA_ELEMENT, RoboCorba.NODE_ELEMENT, RoboCorba.EDGE_ELEMENT, RoboCorba.ELEVATOR_ELEMENT,
), strict=True))  # fmt: skip
_KIND_OF = {struct: kind for kind, struct in _KINDS.items()}
_DOOR_KINDS = {kind: getattr(RoboCorba, kind.name) for kind in DoorKind}
_DOOR_KIND_OF = {struct: kind for kind, struct in _DOOR_KINDS.items()}
_SIDES = {side: getattr(RoboCorba, side.name) for side in Side}
_SIDE_OF = {struct: side for side, struct in _SIDES.items()}
_POINT_KINDS = {kind: getattr(RoboCorba, kind.name) for kind in PointKind}
_POINT_KIND_OF = {struct: kind for kind, struct in _POINT_KINDS.items()}
_POINT_KIND_BY_VALUE = [_POINT_KINDS[kind] for kind in PointKind]
_MODES = {mode: getattr(RoboCorba, mode.name) for mode in RouteMode}
_MODE_OF = {struct: mode for mode, struct in _MODES.items()}
_CRITERIA = {best: getattr(RoboCorba, best.name) for best in Criterion}
_CRITERION_OF = {struct: best for best, struct in _CRITERIA.items()}


# ---- elements ----


def xy(point: XY) -> Any:
    """An XY struct."""
    return RoboCorba.XY(*point)


def xy_of(struct: Any) -> XY:
    """The point of an XY struct."""
    return (struct.x, struct.y)


def element(value: Element) -> Any:
    """An Element union."""
    if isinstance(value, Floor):
        outline = [xy(p) for p in value.outline]
        return RoboCorba.Element(
            aFloor=RoboCorba.Floor(value.name, value.level, value.elevation, value.height, outline)
        )
    if isinstance(value, Wall):
        return RoboCorba.Element(aWall=RoboCorba.Wall(value.name, xy(value.a), xy(value.b), value.height))
    if isinstance(value, MapObject):
        thing = RoboCorba.MapObject(
            value.name, _shape(value.shape), xy(value.at), value.heading, value.height, value.movable
        )
        return RoboCorba.Element(anObject=thing)
    if isinstance(value, Door):
        door = RoboCorba.Door(value.name, xy(value.a), xy(value.b), _DOOR_KINDS[value.kind], value.locked)
        return RoboCorba.Element(aDoor=door)
    if isinstance(value, Area):
        return RoboCorba.Element(anArea=RoboCorba.Area(value.name, [xy(p) for p in value.polygon], value.subnet))
    if isinstance(value, PathNode):
        return RoboCorba.Element(aNode=RoboCorba.PathNode(value.name, xy(value.at), value.elevator))
    if isinstance(value, PathEdge):
        edge = RoboCorba.PathEdge(
            value.name, value.a, value.b, value.one_way, value.speed_limit, value.clearance, list(value.graphs)
        )
        return RoboCorba.Element(anEdge=edge)
    doors = [RoboCorba.ElevatorDoor(d.floor, _SIDES[d.side], d.width, d.offset) for d in value.doors]
    elevator = RoboCorba.Elevator(
        value.name, xy(value.at), value.heading, xy(value.size), doors, value.speed, value.door_time
    )
    return RoboCorba.Element(anElevator=elevator)


def element_of(union: Any) -> Element:
    """The element in an Element union. Raises CORBA.BAD_PARAM for a union that holds none."""
    value = union._v
    kind = _KIND_OF.get(union._d)
    if kind is ElementKind.FLOOR:
        return Floor(
            name=value.name,
            level=value.level,
            elevation=value.elevation,
            height=value.height,
            outline=tuple(map(xy_of, value.outline)),
        )
    if kind is ElementKind.WALL:
        return Wall(name=value.name, a=xy_of(value.fromPoint), b=xy_of(value.toPoint), height=value.height)
    if kind is ElementKind.OBJECT:
        return MapObject(
            name=value.name,
            shape=_shape_of(value.footprint),
            at=xy_of(value.at),
            heading=value.heading,
            height=value.height,
            movable=bool(value.movable),
        )
    if kind is ElementKind.DOOR:
        return Door(
            name=value.name,
            a=xy_of(value.fromPoint),
            b=xy_of(value.toPoint),
            kind=_DOOR_KIND_OF[value.kind],
            locked=bool(value.locked),
        )
    if kind is ElementKind.AREA:
        return Area(name=value.name, polygon=tuple(map(xy_of, value.polygon)), subnet=value.subnet)
    if kind is ElementKind.NODE:
        return PathNode(name=value.name, at=xy_of(value.at), elevator=value.inElevator)
    if kind is ElementKind.EDGE:
        return PathEdge(
            name=value.name,
            a=value.fromNode,
            b=value.toNode,
            one_way=bool(value.directed),
            speed_limit=value.speedLimit,
            clearance=value.clearance,
            graphs=tuple(value.graphs),
        )
    if kind is ElementKind.ELEVATOR:
        return Elevator(
            name=value.name,
            at=xy_of(value.at),
            size=xy_of(value.size),
            doors=tuple(
                ElevatorDoor(floor=d.onFloor, side=_SIDE_OF[d.side], width=d.width, offset=d.offset)
                for d in value.doors
            ),
            heading=value.heading,
            speed=value.speed,
            door_time=value.doorTime,
        )
    raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)


def _shape(shape: Shape) -> Any:
    if isinstance(shape, SegmentShape):
        return RoboCorba.Shape(length=shape.length)
    if isinstance(shape, BoxShape):
        return RoboCorba.Shape(size=xy(shape.size))
    if isinstance(shape, CircleShape):
        return RoboCorba.Shape(radius=shape.radius)
    return RoboCorba.Shape(points=[xy(p) for p in shape.points])


def _shape_of(union: Any) -> Shape:
    if union._d == RoboCorba.SEGMENT_SHAPE:
        return SegmentShape(length=union._v)
    if union._d == RoboCorba.BOX_SHAPE:
        return BoxShape(size=xy_of(union._v))
    if union._d == RoboCorba.CIRCLE_SHAPE:
        return CircleShape(radius=union._v)
    return PolygonShape(points=tuple(map(xy_of, union._v)))


def kind_of(struct: Any) -> ElementKind:
    """The kind behind an ElementKind enumerator."""
    return _KIND_OF[struct]


def key_of(struct: Any) -> Key:
    """The key behind an ElementId."""
    return Key(_KIND_OF[struct.kind], struct.onFloor, struct.name)


def element_id(kind: str, floor: str, name: str) -> Any:
    """An ElementId."""
    return RoboCorba.ElementId(_KINDS[ElementKind(kind)], floor, name)


def record(floor: str, value: Element, changed_at: int) -> Any:
    """An ElementRecord."""
    return RoboCorba.ElementRecord(floor, element(value), changed_at)


def changes(found: Iterable[Change]) -> list[Any]:
    """A ChangeSeq."""
    return [
        RoboCorba.Change(change.version, getattr(RoboCorba, change.kind.name), change.floor, element(change.element))
        for change in found
    ]


# ---- paths ----


def place_of(point: Any) -> Place:
    """The place behind a Point."""
    return Place(point.floor, point.x, point.y)


def point(place: Place) -> Any:
    """A Point."""
    return RoboCorba.Point(*place)


class _Position(NamedTuple):
    floor: str
    x: float
    y: float


class _PathPoint(NamedTuple):
    kind: Any
    node: str
    position: _Position
    heading: float
    distance: float
    time: float
    elevator: str


def path_points(found: Path) -> list[Any]:
    """A PathPointSeq. Runs for every getPath: straight from the path's rows, and as tuples with the members'
    names, which omniORBpy sends as well as the generated classes and which are made in a third of the time."""
    kinds, (floors, nodes, lifts) = _POINT_KIND_BY_VALUE, found.names
    new, make, at = tuple.__new__, _PathPoint, _Position
    return [
        new(
            make,
            (
                kinds[int(kind)],
                nodes[int(node)],
                new(at, (floors[int(floor)], x, y)),
                heading,
                distance,
                time,
                lifts[int(lift)],
            ),
        )
        for kind, node, floor, x, y, heading, distance, time, lift in found.rows
    ]


def path(found: Path) -> Any:
    """A Path struct."""
    return RoboCorba.Path(path_points(found), found.distance, found.duration, found.version)


def path_of(struct: Any) -> Path:
    """The path behind a Path struct."""
    floors, nodes, elevators = _Index(), _Index(), _Index()
    rows = [
        [
            _POINT_KIND_OF[s.kind].value,
            nodes(s.node),
            floors(s.position.floor),
            *(s.position.x, s.position.y, s.heading, s.distance, s.time),
            elevators(s.elevator),
        ]
        for s in struct.points
    ]
    return Path(rows, Names(list(floors), list(nodes), list(elevators)), struct.mapVersion)


class _Index(dict[str, int]):
    """Numbers names in the order in which they first come."""

    def __call__(self, name: str) -> int:
        return self.setdefault(name, len(self))


def request(wanted: PathRequest) -> Any:
    """A PathRequest struct."""
    return RoboCorba.PathRequest(
        point(wanted.start),
        point(wanted.goal),
        wanted.radius,
        wanted.speed,
        _MODES[wanted.mode],
        _CRITERIA[wanted.best],
        sorted(wanted.avoid_elevators),
        [f"{floor}/{area}" for floor, area in wanted.avoid_areas],
        [RoboCorba.ForbiddenArea(floor, [xy(p) for p in polygon]) for floor, polygon in wanted.forbidden_areas],
        wanted.graph,
        wanted.alternatives,
    )


def request_of(struct: Any) -> PathRequest:
    """The request behind a PathRequest struct. Raises InvalidRequest for an area not of the form FLOOR/NAME."""
    areas = []
    for text in struct.avoidAreas:
        floor, slash, area = text.partition("/")
        if not slash:
            raise errors.InvalidRequest("avoidAreas", f"{text[:80]!r} is not of the form FLOOR/NAME")
        areas.append((floor, area))
    return PathRequest(
        place_of(struct.start),
        place_of(struct.goal),
        struct.robotRadius,
        struct.robotSpeed,
        _MODE_OF[struct.mode],
        _CRITERION_OF[struct.best],
        frozenset(struct.avoidElevators),
        tuple(areas),
        tuple((area.onFloor, tuple(map(xy_of, area.polygon))) for area in struct.forbiddenAreas),
        struct.navigationGraph,
        struct.alternatives,
    )


# ---- errors ----


def _raise_idl(error: errors.RoboCorbaError) -> NoReturn:
    """Raise the IDL exception that says what a domain error says."""
    make = _EXCEPTIONS.get(type(error))
    if make is None:
        # The store failed: nothing was changed. Anything else would be a fault of the servant.
        raise CORBA.PERSIST_STORE(0, CORBA.COMPLETED_NO) from error
    raise make(error) from error


def _id(error: Any) -> Any:
    return element_id(error.kind, error.floor, error.name)


_EXCEPTIONS: dict[type, Callable[[Any], Exception]] = {
    errors.InvalidElement: lambda e: RoboCorba.InvalidElement(_id(e), e.reason),
    errors.UnknownElement: lambda e: RoboCorba.UnknownElement(_id(e)),
    errors.DuplicateElement: lambda e: RoboCorba.DuplicateElement(_id(e)),
    errors.StaleEdit: lambda e: RoboCorba.StaleEdit(_id(e), e.expected, e.current),
    errors.StaleVersion: lambda e: RoboCorba.StaleVersion(e.expected, e.current),
    errors.NothingToUndo: lambda e: RoboCorba.NothingToUndo(),
    errors.NothingToRedo: lambda e: RoboCorba.NothingToRedo(),
    errors.VersionUnavailable: lambda e: RoboCorba.VersionUnavailable(e.version, e.oldest, e.current),
    errors.TransactionClosed: lambda e: RoboCorba.TransactionClosed(),
    errors.TooManyTransactions: lambda e: RoboCorba.TooManyTransactions(e.limit),
    errors.InvalidPoint: lambda e: RoboCorba.InvalidPoint(e.which, e.field, e.reason),
    errors.InvalidRequest: lambda e: RoboCorba.InvalidRequest(e.field, e.reason),
    errors.UnknownFloor: lambda e: RoboCorba.UnknownFloor(e.which, e.floor, list(e.known)),
    errors.NotFree: lambda e: RoboCorba.NotFree(
        e.which, RoboCorba.Point(e.floor, e.x, e.y), e.obstacle, e.clearance_m, e.required_m
    ),
    errors.NoPath: lambda e: RoboCorba.NoPath(
        e.reason, [RoboCorba.Blocker(element_id(b.kind, b.floor, b.name), b.reason) for b in e.blockers]
    ),
}


def translating(method: Callable[..., Any]) -> Callable[..., Any]:
    """A servant's method whose domain errors reach the caller as IDL exceptions."""

    @functools.wraps(method)
    def call(*arguments: Any) -> Any:
        try:
            return method(*arguments)
        except errors.RoboCorbaError as error:
            _raise_idl(error)

    return call


def error_of(exception: Any) -> str:
    """One sentence for a person about an IDL exception."""
    make = _SENTENCES.get(type(exception))
    return str(make(exception)) if make else f"{type(exception).__name__}: {exception}"


_SENTENCES: dict[type, Callable[[Any], Exception]] = {
    RoboCorba.InvalidElement: lambda e: errors.InvalidElement(*_words(e.id), e.reason),
    RoboCorba.UnknownElement: lambda e: errors.UnknownElement(*_words(e.id)),
    RoboCorba.DuplicateElement: lambda e: errors.DuplicateElement(*_words(e.id)),
    RoboCorba.StaleEdit: lambda e: errors.StaleEdit(*_words(e.id), e.expected, e.current),
    RoboCorba.StaleVersion: lambda e: errors.StaleVersion(e.expected, e.current),
    RoboCorba.InvalidMap: lambda e: errors.MapFileError("map", e.line, e.key, e.reason),
    RoboCorba.InvalidPoint: lambda e: errors.InvalidPoint(e.which, e.field, e.reason),
    RoboCorba.InvalidRequest: lambda e: errors.InvalidRequest(e.field, e.reason),
    RoboCorba.UnknownFloor: lambda e: errors.UnknownFloor(e.which, e.floorName, e.known),
    RoboCorba.NotFree: lambda e: errors.NotFree(e.which, *place_of(e.position), e.obstacle, e.clearance, e.required),
    RoboCorba.NoPath: lambda e: errors.NoPath(e.reason, [errors.Blocker(*_words(b.id), b.reason) for b in e.blockers]),
}


def _words(struct: Any) -> tuple[str, str, str]:
    return _KIND_OF[struct.kind].value, struct.onFloor, struct.name
