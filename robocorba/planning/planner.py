"""The path planning agent: requests in, paths out."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NoReturn

from robocorba.errors.paths import NoPath, NotFree
from robocorba.map_editor.model import Building, Floor, PathEdge, PathNode, Wall
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.planning import diagnosis, geometric, topological
from robocorba.planning.request import (
    SMARTPAL_SPEED_M_S,
    Criterion,
    Path,
    PathRequest,
    Place,
    RouteMode,
    check_request,
    is_in_range,
)
from robocorba.planning.route import off_road
from robocorba.planning.search import find_path, with_limits
from robocorba.planning.snapshot import BuildingSnapshot
from robocorba.planning.turns import Turn, Turns


class PathPlanner:
    """Plans on the latest building. Queries run in parallel, take turns where they are many, and never wait for an
    update."""

    def __init__(self, building: Building, version: int = 0, time_limit_s: float = 8.0) -> None:
        """A query raises PlanningTimeout after `time_limit_s`. Clients usually wait for 10 s; a shorter limit ends work
        whose result nobody awaits."""
        self._snapshot, self._time_limit_s = BuildingSnapshot(building, version), time_limit_s
        self._turns = Turns()

    @property
    def version(self) -> int:
        """Version of the building on which queries are planned."""
        return self._snapshot.version

    def update(self, building: Building, version: int) -> None:
        """Plan on another building; running queries finish on the previous one."""
        self._snapshot = BuildingSnapshot(building, version, self._snapshot)

    def warm_up(self) -> None:
        """Compile or load every kernel, so that the first query is not slower. Compiling may take half a minute."""
        planner = PathPlanner(_warm_up_room(), time_limit_s=math.inf)  # a query may compile for longer than its limit
        # No node is in sight of the start.
        start, goal, beside, hidden, blocked = (
            Place("L1", x, y) for x, y in ((1.6, 1.4), (9.0, 1.0), (5.0, 5.0), (2.0, 2.6), (3.0, 1.5))
        )
        for _ in range(2):  # after as many queries as nodes: the table of costs
            planner.shortest(beside, goal)
        planner.shortest(goal, start)
        planner.shortest(start, goal)
        planner.shortest(start, hidden)  # the roadmap is a detour
        for mode in RouteMode:
            planner.paths(PathRequest(start, goal, mode=mode))
        with contextlib.suppress(NotFree):
            planner.shortest(start, blocked)

    def shortest(self, start: Place, goal: Place) -> Path:
        """The paper's getPath for a SmartPal: the shortest path on the topological map with corners cut, and through
        free space where the map is a detour.

        Raises InvalidPoint, UnknownFloor, NotFree, NoPath, PlannerBusy or PlanningTimeout."""
        snapshot = self._snapshot
        floor_index = snapshot.roads.floor_index
        if start.floor in floor_index and goal.floor in floor_index and is_in_range(start) and is_in_range(goal):
            snapshot.count_query()
            # Most queries end here, without a PathRequest: Python's overhead is half of their time.
            may_be_detour, points = find_path(
                *snapshot.world,
                *snapshot.heuristics,
                floor_index[start.floor],
                float(start.x),  # kernels would compile again for whole numbers, for half a minute
                float(start.y),
                floor_index[goal.floor],
                float(goal.x),
                float(goal.y),
                SMARTPAL_RADIUS_M,
                SMARTPAL_SPEED_M_S,
            )
            if may_be_detour:
                request = PathRequest(start, goal)
                turn = Turn(self._deadline())  # too short to wait for others
                route = topological.without_detours(snapshot, request, points, turn)
                return snapshot.path(with_limits(snapshot.rules(""), route, request.radius), request)
            if len(points):
                return Path(points.tolist(), snapshot.roads.names, snapshot.version)
        return self.paths(PathRequest(start, goal))[0]

    def _turn(self, request: PathRequest) -> AbstractContextManager[Turn]:
        obstacles = len(request.forbidden_areas) + len(request.avoid_areas)
        expected_s = 0.001 * (1 + obstacles) * (1 + request.alternatives)  # 1 ms for each obstacle of its own
        return self._turns.take(self._deadline(), request.start.floor, expected_s)

    def _deadline(self) -> float:
        return time.monotonic() + self._time_limit_s

    def paths(self, request: PathRequest) -> list[Path]:
        """The best path and up to `request.alternatives` others, best first.

        Raises InvalidPoint, InvalidRequest, UnknownFloor, NotFree, NoPath, PlannerBusy or PlanningTimeout."""
        snapshot = self._snapshot
        check_request(snapshot.building, request)
        start, goal = (Place(place.floor, float(place.x), float(place.y)) for place in (request.start, request.goal))
        request = request._replace(start=start, goal=goal, radius=float(request.radius), speed=float(request.speed))
        with self._turn(request) as turn:
            on_map, snapshot = snapshot, snapshot.variant_for(request)
            is_geometric = request.mode is RouteMode.GEOMETRIC
            routes = (geometric if is_geometric else topological).routes(snapshot, request, turn)
            paths = [snapshot.path(route, request) for route in routes]
            if not paths:
                _explain(snapshot, on_map, request, turn)
            if is_geometric and len(paths[0].rows) > 2:
                paths[0] = min([paths[0], *_smoothed(snapshot, request, turn)], key=cost_of(request))
        return sorted(paths, key=cost_of(request))


def cost_of(request: PathRequest) -> Callable[[Path], float]:
    """What the request's best path minimizes: duration [s] or distance [m]."""
    by_time = request.best is Criterion.SHORTEST_TIME
    return lambda path: path.duration if by_time else path.distance


def _smoothed(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn) -> list[Path]:
    """The path for SMOOTHED, none without roads. Arcs around corners become lines outside of them, up to 0.33 % longer;
    a path along the roads may have fewer and be shorter."""
    if not len(snapshot.roads.roads.xy):
        return []
    smoothed = request._replace(mode=RouteMode.SMOOTHED, graph="", alternatives=0)
    return [snapshot.path(off_road(route), request) for route in topological.routes(snapshot, smoothed, turn)]


def _warm_up_room() -> Building:
    """A room in which a few queries use every kernel."""
    outline = ((0.0, 0.0), (10.0, 0.0), (10.0, 6.0), (0.0, 6.0))
    floor = Floor(name="L1", level=0, elevation=0.0, outline=outline)
    building = Building("warm-up").with_element("", floor)
    for element in (
        Wall(name="lid", a=(1.0, 2.0), b=(3.0, 2.0)),
        Wall(name="side", a=(3.0, 2.0), b=(3.0, 1.0)),
        PathNode(name="a", at=(7.0, 5.0)),
        PathNode(name="b", at=(9.0, 5.0)),
        PathEdge(name="a-b", a="a", b="b", one_way=True),
    ):
        building = building.with_element(floor.name, element)
    return building


def _explain(snapshot: BuildingSnapshot, on_map: BuildingSnapshot, request: PathRequest, turn: Turn) -> NoReturn:
    """Raise NotFree or NoPath with the reason why there is no path. `snapshot`: `on_map` for the request."""
    for which, place in (("start", request.start), ("goal", request.goal)):
        space = snapshot.spaces[place.floor]
        if not space.point_is_free(place.x, place.y, request.radius):
            obstacle, clearance = diagnosis.obstacle_at(snapshot, place, request.radius)
            raise NotFree(which, *place, obstacle, clearance, request.radius)
    if snapshot.avoided:
        without = request._replace(avoid_areas=(), forbidden_areas=(), alternatives=0)
        free = on_map.variant_for(without)
        if areas := diagnosis.areas_in_the_way(snapshot, free, without, turn):
            raise NoPath("areas that the request avoids block every path", areas)
        snapshot, request = free, without
    raise NoPath(*diagnosis.explain_no_path(snapshot, request, turn))
