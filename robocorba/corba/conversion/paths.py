"""Conversion of path requests, paths and their errors between the domain and IDL structs."""

from __future__ import annotations

from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.corba.conversion.errors import register, register_system, register_with
from robocorba.corba.conversion.maps import element_id, kind_of, xy, xy_of
from robocorba.errors import paths as errors
from robocorba.planning.request import Criterion, IndexedNames, Path, PathRequest, Place, PointKind, RouteMode
from robocorba.stubs import RoboCorba

_POINT_KINDS = {kind: getattr(RoboCorba, kind.name) for kind in PointKind}
_POINT_KIND_OF = {struct: kind for kind, struct in _POINT_KINDS.items()}
_POINT_KIND_BY_VALUE = [_POINT_KINDS[kind] for kind in PointKind]
_MODES = {mode: getattr(RoboCorba, mode.name) for mode in RouteMode}
_MODE_OF = {struct: mode for mode, struct in _MODES.items()}
_CRITERIA = {best: getattr(RoboCorba, best.name) for best in Criterion}
_CRITERION_OF = {struct: best for best, struct in _CRITERIA.items()}


def place_of(point: Any) -> Place:
    """The place of a Point struct."""
    return Place(point.floor, point.x, point.y)


def point(place: Place) -> Any:
    """The Point struct of a place."""
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
    """The PathPointSeq of a path. It runs for every getPath: directly from the rows of the path, and with tuples
    that have the names of the members, which omniORBpy accepts like the generated classes and which take a third of
    the time."""
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
    """The Path struct of a path."""
    return RoboCorba.Path(path_points(found), found.distance, found.duration, found.version)


def path_of(struct: Any) -> Path:
    """The path of a Path struct."""
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
    return Path(rows, IndexedNames(list(floors), list(nodes), list(elevators)), struct.mapVersion)


class _Index(dict[str, int]):
    """Numbers names in the order of their first use."""

    def __call__(self, name: str) -> int:
        return self.setdefault(name, len(self))


def request(wanted: PathRequest) -> Any:
    """The PathRequest struct of a request."""
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
        list(wanted.without_movables),
        wanted.graph,
        wanted.alternatives,
    )


def request_of(struct: Any) -> PathRequest:
    """The request of a PathRequest struct. Raises InvalidRequest for an area that is not FLOOR/NAME."""
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
        tuple(struct.withoutMovables),
        struct.navigationGraph,
        struct.alternatives,
    )


register(errors.InvalidPoint, RoboCorba.InvalidPoint, "which", "field", "reason")
register(errors.InvalidRequest, RoboCorba.InvalidRequest, "field", "reason")
register(errors.UnknownFloor, RoboCorba.UnknownFloor, "which", "floor", "known")
register_system(errors.PlanningTimeout, CORBA.TIMEOUT)
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
    lambda e: errors.NoPath(
        e.reason, [errors.Blocker(kind_of(b.id.kind).value, b.id.onFloor, b.id.name, b.reason) for b in e.blockers]
    ),
)
