"""Conversion of path requests, paths and their errors between the domain and IDL structs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.errors import paths as errors
from robocorba.map_editor.corba.maps import element_id, key_of, xy, xy_of
from robocorba.orb.exceptions import register, register_system, register_with
from robocorba.orb.structs import STRINGS, Converter, enumeration, sequence, struct_converter
from robocorba.planning.request import (
    Criterion,
    IndexedNames,
    Path,
    PathPoint,
    PathRequest,
    Place,
    PointKind,
    RouteMode,
)
from robocorba.stubs import RoboCorba

_POINT_KIND = enumeration(PointKind)
_POINT_KIND_BY_VALUE = [_POINT_KIND.to_idl(kind) for kind in PointKind]


def place_of(point: Any) -> Place:
    """The place of a Point struct."""
    return Place(point.floor, point.x, point.y)


def point(place: Place) -> Any:
    """The Point struct of a place."""
    return RoboCorba.Point(*place)


class _PointStruct(NamedTuple):
    floor: str
    x: float
    y: float


class _PathPointStruct(NamedTuple):
    kind: Any
    node: str
    position: _PointStruct
    heading: float
    distance: float
    time: float
    elevator: str


def path_point(value: PathPoint) -> Any:
    """The PathPoint struct of a point."""
    kind, node, floor, x, y, heading, distance, time, elevator = value
    return _PathPointStruct(
        _POINT_KIND.to_idl(kind), node, _PointStruct(floor, x, y), heading, distance, time, elevator
    )


def path_points(value: Path) -> list[Any]:
    """The PathPointSeq of a path.

    It runs for every getPath, and so makes named tuples with the members' names directly from the rows of the path:
    omniORBpy accepts them like the generated classes, and they take a third of the time."""
    kinds, (floors, nodes, elevators) = _POINT_KIND_BY_VALUE, value.names
    new, path_point, position = tuple.__new__, _PathPointStruct, _PointStruct
    return [
        new(
            path_point,
            (
                kinds[int(kind)],
                nodes[int(node)],
                new(position, (floors[int(floor)], x, y)),
                heading,
                distance,
                time,
                elevators[int(elevator)],
            ),
        )
        for kind, node, floor, x, y, heading, distance, time, elevator in value.rows
    ]


def path(value: Path) -> Any:
    """The Path struct of a path."""
    return RoboCorba.Path(path_points(value), value.distance, value.duration, value.version)


def path_of(struct: Any) -> Path:
    """The path of a Path struct."""
    floors: dict[str, int] = {}
    nodes: dict[str, int] = {}
    elevators: dict[str, int] = {}
    rows = [
        [
            _POINT_KIND.from_idl(s.kind).value,
            nodes.setdefault(s.node, len(nodes)),
            floors.setdefault(s.position.floor, len(floors)),
            *(s.position.x, s.position.y, s.heading, s.distance, s.time),
            elevators.setdefault(s.elevator, len(elevators)),
        ]
        for s in struct.points
    ]
    return Path(rows, IndexedNames(list(floors), list(nodes), list(elevators)), struct.mapVersion)


def _avoided_areas(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
    areas = []
    for text in texts:
        floor, slash, area = text.partition("/")
        if not slash:
            raise errors.InvalidRequest("avoidAreas", f"{text[:80]!r} is not of the form FLOOR/NAME")
        areas.append((floor, area))
    return tuple(areas)


_PLACE = Converter(point, place_of)
_FORBIDDEN_AREA = Converter(
    lambda area: RoboCorba.ForbiddenArea(area[0], [xy(corner) for corner in area[1]]),
    lambda found: (found.onFloor, tuple(map(xy_of, found.polygon))),
)
#: A PathRequest struct, and the request of one; raises InvalidRequest for an area that is not FLOOR/NAME.
request, request_of = struct_converter(
    *(PathRequest, RoboCorba.PathRequest),
    {"robotRadius": "radius", "robotSpeed": "speed", "navigationGraph": "graph"},
    start=_PLACE,
    goal=_PLACE,
    mode=enumeration(RouteMode),
    best=enumeration(Criterion),
    avoid_elevators=Converter(sorted, frozenset),
    avoid_areas=Converter(lambda areas: [f"{floor}/{area}" for floor, area in areas], _avoided_areas),
    forbidden_areas=sequence(_FORBIDDEN_AREA),
    without_movables=STRINGS,
).both


register(errors.InvalidPoint, RoboCorba.InvalidPoint, "which", "field", "reason")
register(errors.InvalidRequest, RoboCorba.InvalidRequest, "field", "reason")
register(errors.UnknownFloor, RoboCorba.UnknownFloor, "which", "floor", "known")
register_system(errors.PlanningTimeout, CORBA.TIMEOUT)
register_system(errors.PlannerBusy, CORBA.TRANSIENT)
register_with(
    errors.NotFree,
    RoboCorba.NotFree,
    lambda e: RoboCorba.NotFree(e.which, RoboCorba.Point(e.floor, e.x, e.y), e.obstacle, e.clearance_m, e.required_m),
    lambda e: errors.NotFree(e.which, *place_of(e.position), e.obstacle, e.clearance, e.required),
)
register_with(
    errors.NoPath,
    RoboCorba.NoPath,
    lambda e: RoboCorba.NoPath(
        e.reason, [RoboCorba.Blocker(element_id(b.kind, b.floor, b.name), b.reason) for b in e.blockers]
    ),
    lambda e: errors.NoPath(e.reason, [errors.Blocker(*key_of(b.id).words, b.reason) for b in e.blockers]),
)
