"""Requests to the path planning agent, and the paths that it returns."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from robocorba.errors.paths import InvalidPoint, InvalidRequest, UnknownFloor
from robocorba.errors.places import metres
from robocorba.map_editor.model import Building
from robocorba.map_editor.polygons import MAX_COORDINATE_M, check_polygon
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M, XY, Limits

#: Maximum speed of SmartPal's base [m/s].
SMARTPAL_SPEED_M_S = Limits().speed

#: Maximum robot radius of a request; clearances are computed up to it [m].
MAX_RADIUS_M = 3.0
#: Maximum number of alternatives, and of areas to avoid, of a request.
MAX_ALTERNATIVES, MAX_AREAS = 9, 64


class PointKind(Enum):
    """Kind of a point of a path."""

    START = 0
    NODE = 1
    WAYPOINT = 2
    ELEVATOR_ENTRY = 3
    ELEVATOR_EXIT = 4
    GOAL = 5


class RouteMode(Enum):
    """TOPOLOGICAL: along the topological map. SMOOTHED: the same with corners cut, and through free space where the map
    is a detour. GEOMETRIC: the shortest path through free space."""

    TOPOLOGICAL = 0
    SMOOTHED = 1
    GEOMETRIC = 2


class Criterion(Enum):
    """What the best path minimizes."""

    SHORTEST_DISTANCE = 0
    SHORTEST_TIME = 1


class Place(NamedTuple):
    """A point on a floor [m]."""

    floor: str
    x: float
    y: float


class PathPoint(NamedTuple):
    """A point of a path: see the IDL's PathPoint for meanings and units."""

    kind: PointKind
    node: str
    floor: str
    x: float
    y: float
    heading: float
    distance: float
    time: float
    elevator: str


class IndexedNames(NamedTuple):
    """Names of floors, nodes and elevators by index; the last one is empty, for index -1."""

    floors: Sequence[str]
    nodes: Sequence[str]
    elevators: Sequence[str]


class Path(NamedTuple):
    """A path as the compiled search returns it. rows: for each point kind (PointKind's value), node, floor, x, y [m],
    heading [rad], distance [m], time [s], elevator; node, floor and elevator are indices into `names`. version: of the
    map."""

    rows: list[list[float]]
    names: IndexedNames
    version: int

    @property
    def points(self) -> list[PathPoint]:
        """The points of the path."""
        floors, nodes, lifts = self.names
        return [
            PathPoint(
                PointKind(kind), nodes[int(node)], floors[int(floor)], x, y, heading, distance, time, lifts[int(lift)]
            )
            for kind, node, floor, x, y, heading, distance, time, lift in self.rows
        ]

    @property
    def distance(self) -> float:
        """Distance driven and ridden [m]; a ride counts its height."""
        return self.rows[-1][6]

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.rows[-1][7]


class PathRequest(NamedTuple):
    """A query. Radius in m, speed in m/s; the defaults are SmartPal's.

    `avoid_areas` are (floor, area name), `forbidden_areas` (floor, polygon). On the floors `without_movables` the
    planner ignores the movable objects of the map; `forbidden_areas` can give their present places."""

    start: Place
    goal: Place
    radius: float = SMARTPAL_RADIUS_M
    speed: float = SMARTPAL_SPEED_M_S
    mode: RouteMode = RouteMode.SMOOTHED
    best: Criterion = Criterion.SHORTEST_DISTANCE
    avoid_elevators: frozenset[str] = frozenset()
    avoid_areas: tuple[tuple[str, str], ...] = ()
    forbidden_areas: tuple[tuple[str, tuple[XY, ...]], ...] = ()
    without_movables: tuple[str, ...] = ()
    graph: str = ""
    alternatives: int = 0


def is_in_range(place: Place) -> bool:
    """Whether both coordinates are numbers within MAX_COORDINATE_M."""
    return -MAX_COORDINATE_M <= place.x <= MAX_COORDINATE_M and -MAX_COORDINATE_M <= place.y <= MAX_COORDINATE_M


def check_place(building: Building, which: str, place: Place) -> None:
    """Raise InvalidPoint or UnknownFloor unless the place could be in the building."""
    for field, value in (("x", place.x), ("y", place.y)):
        if not abs(value) <= MAX_COORDINATE_M:
            raise InvalidPoint(which, field, f"{value!r} is not a number within {metres(MAX_COORDINATE_M)} m")
    _check_floor(building, which, place.floor)


def _check_floor(building: Building, which: str, floor: str) -> None:
    if floor not in building.floors:
        raise UnknownFloor(which, floor[:200], tuple(building.floors))


def check_request(building: Building, request: PathRequest) -> None:
    """Raise InvalidPoint, InvalidRequest or UnknownFloor unless the request is valid for the building."""
    check_place(building, "start", request.start)
    check_place(building, "goal", request.goal)
    if not 0.0 <= request.radius <= MAX_RADIUS_M:
        raise InvalidRequest("robotRadius", f"{request.radius!r} is not between 0 and {MAX_RADIUS_M:g} m")
    if not 0.001 <= request.speed <= 100.0:
        raise InvalidRequest("robotSpeed", f"{request.speed!r} is not between 0.001 and 100 m/s")
    if not 0 <= request.alternatives <= MAX_ALTERNATIVES:
        raise InvalidRequest("alternatives", f"{request.alternatives} is not between 0 and {MAX_ALTERNATIVES}")
    for name in sorted(request.avoid_elevators):
        if name not in building.elevators:
            raise InvalidRequest("avoidElevators", f"there is no elevator {name[:80]!r}")
    for floor, area in request.avoid_areas:
        _check_floor(building, "avoidAreas", floor)
        if area not in building.floors[floor].geometrical.areas:
            raise InvalidRequest("avoidAreas", f"there is no area {area[:80]!r} on {floor}")
    if len(request.avoid_areas) + len(request.forbidden_areas) > MAX_AREAS:
        raise InvalidRequest("forbiddenAreas", f"more than {MAX_AREAS} areas")
    for i, (floor, polygon) in enumerate(request.forbidden_areas):
        _check_floor(building, f"forbiddenAreas[{i}]", floor)
        check_polygon(f"forbiddenAreas[{i}].polygon", polygon, InvalidRequest)
    for floor in request.without_movables:
        _check_floor(building, "withoutMovables", floor)
    if request.graph and not any(
        request.graph in edge.graphs for entry in building.floors.values() for edge in entry.topological.edges.values()
    ):
        raise InvalidRequest("navigationGraph", f"no edge belongs to a graph {request.graph[:80]!r}")
