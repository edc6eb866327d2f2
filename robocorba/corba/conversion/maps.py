"""Conversion between elements of a building, their changes and findings, and IDL types."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from omniORB import CORBA

from robocorba.corba.conversion.errors import register, register_with
from robocorba.errors import maps as errors
from robocorba.maps.changes import Change, ElementKey
from robocorba.maps.model import (
    Area,
    BoxShape,
    CabinSide,
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
    Wall,
)
from robocorba.spatial.pose import XY
from robocorba.stubs import RoboCorba

if TYPE_CHECKING:
    from robocorba.maps.checking import MapFinding

_KINDS = dict(zip(ElementKind, (
    RoboCorba.FLOOR_ELEMENT, RoboCorba.WALL_ELEMENT, RoboCorba.OBJECT_ELEMENT, RoboCorba.DOOR_ELEMENT,
    RoboCorba.AREA_ELEMENT, RoboCorba.NODE_ELEMENT, RoboCorba.EDGE_ELEMENT, RoboCorba.ELEVATOR_ELEMENT,
), strict=True))  # fmt: skip
_KIND_OF = {struct: kind for kind, struct in _KINDS.items()}
_DOOR_KINDS = {kind: getattr(RoboCorba, kind.name) for kind in DoorKind}
_DOOR_KIND_OF = {struct: kind for kind, struct in _DOOR_KINDS.items()}
_SIDES = {side: getattr(RoboCorba, side.name) for side in CabinSide}
_SIDE_OF = {struct: side for side, struct in _SIDES.items()}


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
        map_object = RoboCorba.MapObject(
            value.name, _shape(value.shape), xy(value.at), value.heading, value.height, value.movable
        )
        return RoboCorba.Element(anObject=map_object)
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
    """The element in an Element union. Raises CORBA.BAD_PARAM for an empty union."""
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
    """The kind of an ElementKind enumerator."""
    return _KIND_OF[struct]


def key_of(struct: Any) -> ElementKey:
    """The key of an ElementId."""
    return ElementKey(_KIND_OF[struct.kind], struct.onFloor, struct.name)


def element_id(kind: str, floor: str, name: str) -> Any:
    """An ElementId."""
    return RoboCorba.ElementId(_KINDS[ElementKind(kind)], floor, name)


def record(floor: str, value: Element, changed_at: int) -> Any:
    """An ElementRecord."""
    return RoboCorba.ElementRecord(floor, element(value), changed_at)


def findings(found: Iterable[MapFinding]) -> list[Any]:
    """A FindingSeq."""
    return [
        RoboCorba.Finding(element_id(one.kind.value, one.floor, one.name), RoboCorba.Point(*one.where), one.reason)
        for one in found
    ]


def changes(found: Iterable[Change]) -> list[Any]:
    """A ChangeSeq."""
    return [
        RoboCorba.Change(change.version, getattr(RoboCorba, change.kind.name), change.floor, element(change.element))
        for change in found
    ]


def _element_words(struct: Any) -> tuple[str, str, str]:
    return kind_of(struct.kind).value, struct.onFloor, struct.name


def _element_id_of(error: Any) -> Any:
    return element_id(error.kind, error.floor, error.name)


register_with(
    errors.InvalidElement,
    RoboCorba.InvalidElement,
    lambda e: RoboCorba.InvalidElement(_element_id_of(e), e.reason),
    lambda e: errors.InvalidElement(*_element_words(e.id), e.reason),
)
register_with(
    errors.UnknownElement,
    RoboCorba.UnknownElement,
    lambda e: RoboCorba.UnknownElement(_element_id_of(e)),
    lambda e: errors.UnknownElement(*_element_words(e.id)),
)
register_with(
    errors.DuplicateElement,
    RoboCorba.DuplicateElement,
    lambda e: RoboCorba.DuplicateElement(_element_id_of(e)),
    lambda e: errors.DuplicateElement(*_element_words(e.id)),
)
register_with(
    errors.StaleEdit,
    RoboCorba.StaleEdit,
    lambda e: RoboCorba.StaleEdit(_element_id_of(e), e.expected, e.current),
    lambda e: errors.StaleEdit(*_element_words(e.id), e.expected, e.current),
)
register_with(
    errors.MapFileError,
    RoboCorba.InvalidMap,
    lambda e: RoboCorba.InvalidMap(e.line, e.key, e.reason),
    lambda e: errors.MapFileError("map", e.line, e.key, e.reason),
)
register(errors.StaleVersion, RoboCorba.StaleVersion, "expected", "current")
register(errors.NothingToUndo, RoboCorba.NothingToUndo)
register(errors.NothingToRedo, RoboCorba.NothingToRedo)
register(errors.VersionUnavailable, RoboCorba.VersionUnavailable, "version", "oldest", "current")
register(errors.TransactionClosed, RoboCorba.TransactionClosed)
register(errors.TooManyTransactions, RoboCorba.TooManyTransactions, "limit")
