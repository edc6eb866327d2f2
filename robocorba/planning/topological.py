"""Routes along the topological map, with corners cut and detours replaced by free space where the request allows it.

What each mode makes of the rules of edges is in path_planner.idl, what it is to follow an edge in road_rules.py."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning import geometric
from robocorba.planning.heuristics import COST_IN_METRES
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from robocorba.planning.road_rules import slowed_length, tie_lanes
from robocorba.planning.route import ELEVATOR, FLOOR, LIMIT, NODE, OFF_ROAD, ROAD, X, Y, waypoints
from robocorba.planning.search import (
    FOUND,
    MAX_CONNECTIONS,
    NOT_FREE,
    component_connections,
    find_route,
    max_free_length,
    roadmap_connections,
    smoothed,
    with_limits,
)
from robocorba.planning.snapshot import BuildingSnapshot
from robocorba.planning.turns import Turn
from robocorba.planning.world import floor_grid, unpack

#: Number of nearest nodes that a place without a usable node in sight is connected to around corners, and the larger
#: number that is tried if none of them can be reached.
NEAR_NODES, MORE_NODES = 8, 256
#: Maximum number of components of the roadmap that such a place is connected to, the nearest first.
MAX_COMPONENTS = 32


class Connections:
    """How a place is connected to the roadmap: nodes, distance to each [m], and the corners in between."""

    def __init__(self, nodes: Sequence[int], lengths: Sequence[float], corners: Sequence[Floats] = ()) -> None:
        self.nodes, self.lengths = np.array(nodes, np.int64), np.array(lengths, float)
        self._corners = dict(zip(nodes, corners, strict=False))

    def corners(self, node: int) -> Floats:
        """Corners (k, 2) between the place and one of the nodes, in driving order."""
        return self._corners.get(node, np.empty((0, 2)))


#: No connections yet: find_route then connects the place to the nearest nodes in sight.
IN_SIGHT = Connections((), ())


def routes(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn) -> list[Floats]:
    """The best route and the requested alternatives, in the order found; empty if there is none."""
    smooth = request.mode is RouteMode.SMOOTHED and not request.graph
    factor = snapshot.factor(request.avoid_elevators, request.graph)
    best = _find_route(snapshot, request, factor, turn, smooth=smooth, straight=smooth)
    if best is None:
        found = _through_free_space(snapshot, request, turn) if smooth else []
    else:
        found = [best, *_alternatives(snapshot, request, factor, turn, best)] if request.alternatives else [best]
    rules = snapshot.rules(request.graph)
    return [with_limits(rules, route, request.radius) for route in found]


def _alternatives(
    snapshot: BuildingSnapshot, request: PathRequest, factor: Floats, turn: Turn, best: Floats
) -> list[Floats]:
    """Other routes than the best one, found by raising the cost of the edges of those found before."""
    smooth = request.mode is RouteMode.SMOOTHED and not request.graph
    found = {_stops(best): best}
    factor = factor.copy() if len(factor) else np.ones(len(snapshot.roads.roads.to))
    for _ in range(1 + 3 * request.alternatives):
        along = _find_route(snapshot, request, factor, turn, smooth=False)
        route = _find_route(snapshot, request, factor, turn, smooth=True) if smooth else along
        if along is None or route is None:
            break
        found.setdefault(_stops(route), route)
        if len(found) > request.alternatives:
            break
        _penalize_edges(snapshot, factor, along[along[:, NODE] >= 0.0, NODE].astype(np.int64).tolist())
    return list(found.values())[1:]


def _stops(route: Floats) -> tuple[float, ...]:
    return tuple(route[:, [FLOOR, X, Y, NODE]].ravel())


def _through_free_space(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn) -> list[Floats]:
    """The best route and alternatives where the roadmap has none. They obey the rules of edges: no drive follows a
    closed one. If that fails, no drive crosses one either, because routes in free space turn at walls only."""
    found = geometric.routes(snapshot, request, turn, obey_rules=True)
    if found:
        return found
    closed = snapshot.with_roads_closed(request)
    return geometric.routes(closed, request, turn) if closed else []


def _find_route(
    snapshot: BuildingSnapshot,
    request: PathRequest,
    factor: Floats,
    turn: Turn,
    *,
    smooth: bool,
    straight: bool = False,
) -> Floats | None:
    """The cheapest route; None if there is none.

    The ends are connected to the nearest nodes in sight. If these lead nowhere, the ends are connected to each
    component of the roadmap in sight, and then also around corners."""
    roads, start, goal, radius = snapshot.roads, request.start, request.goal, request.radius
    speed_m_s = request.speed if request.best is Criterion.SHORTEST_TIME else COST_IN_METRES
    heuristics = snapshot.heuristics_for(speed_m_s, radius, request.avoid_elevators)
    origin = (roads.floor_index[start.floor], start.x, start.y)
    target = (roads.floor_index[goal.floor], goal.x, goal.y)
    rules = snapshot.rules(request.graph)
    starts = goals = IN_SIGHT
    for attempt in range(3):
        if attempt == 1:
            starts = connect_in_sight(snapshot, request, start, outbound=True)
            goals = connect_in_sight(snapshot, request, goal, outbound=False)
        elif attempt == 2:
            starts = _merged(starts, connect_around_corners(snapshot, request, start, True, turn))
            goals = _merged(goals, connect_around_corners(snapshot, request, goal, False, turn))
        if attempt and not (len(starts.nodes) and len(goals.nodes)):
            continue
        ends = (origin, starts.nodes, starts.lengths, target, goals.nodes, goals.lengths)
        status, route = find_route(snapshot.world, heuristics, rules, *ends, radius, speed_m_s, straight, factor)
        if status == FOUND:
            route = _with_corners(route, starts.corners(int(route[1, NODE])), goals.corners(int(route[-2, NODE])))
            break
        if status == NOT_FREE:
            return None
    else:
        return None
    if not smooth:
        return route
    route = smoothed(snapshot.world, rules, route, radius)
    return without_detours(snapshot, request, route, turn)


def _with_corners(route: Floats, lead: Floats, tail: Floats) -> Floats:
    """The route with the corners between its ends and the roadmap."""
    return np.concatenate(
        [route[:1], waypoints(route[0, FLOOR], lead), route[1:-1], waypoints(route[-1, FLOOR], tail), route[-1:]]
    )


def without_detours(snapshot: BuildingSnapshot, request: PathRequest, route: Floats, turn: Turn) -> Floats:
    """The route with each drive replaced by a sufficiently shorter path through free space (see search.DETOUR),
    which obeys the rules of edges."""
    floors = snapshot.roads.floors
    parts: list[Floats] = []
    at = 0
    for i in range(len(route)):
        if i + 1 < len(route) and route[i, ELEVATOR] < 0.0:
            continue
        drive = route[at : i + 1]
        max_length_m = max_free_length(snapshot.world, route, at, i)
        if max_length_m > 0.0:
            floor = floors[int(route[i, FLOOR])]
            a, b = (float(route[at, X]), float(route[at, Y])), (float(route[i, X]), float(route[i, Y]))
            leg = snapshot.graph(floor, request.radius).legs(
                a, [b], max_length_m=max_length_m, lanes=snapshot.lanes(floor), turn=turn
            )[0]
            if math.isfinite(leg.length) and not _is_slower(request, drive, leg.points, snapshot.lanes(floor)):
                first = drive[:1].copy()
                first[0, LIMIT], first[0, ROAD] = math.inf, OFF_ROAD
                drive = np.concatenate([first, waypoints(route[i, FLOOR], leg.points[1:-1]), drive[-1:]])
        parts.append(drive)
        at = i + 1
    return np.concatenate(parts)


def _is_slower(request: PathRequest, drive: Floats, points: Floats, lanes: Floats) -> bool:
    """Whether the drive along these points (k, 2) takes longer than the one along the map, for the shortest time."""
    if request.best is not Criterion.SHORTEST_TIME:
        return False
    steps = np.hypot(*np.diff(drive[:, [X, Y]], axis=0).T)
    along_map_s = float((steps / np.minimum(drive[:-1, LIMIT], request.speed)).sum())
    return slowed_length(lanes, points, request.radius, request.speed) / request.speed > along_map_s


def connect_in_sight(snapshot: BuildingSnapshot, request: PathRequest, place: Place, outbound: bool) -> Connections:
    """The nearest nodes in sight of a place, and the nearest one in sight of each component of the roadmap."""
    ground, roads = unpack(snapshot.world)
    floor = snapshot.roads.floor_index[place.floor]
    low, high = int(ground.first_node[floor]), int(ground.first_node[floor + 1])
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    grid, lanes = floor_grid(ground, floor), snapshot.lanes(place.floor, request.graph)
    near, _ = roadmap_connections(grid, lanes, roads.xy, low, high, *place[1:], request.radius, outbound)
    ties, order = tie_lanes(lanes, *place[1:], request.radius), _by_distance(snapshot, place)
    each = component_connections(grid, ties, roads.xy, order, component, *place[1:], request.radius, outbound)
    found = list(dict.fromkeys([*each.tolist(), *near.tolist()]))
    straight = [np.array([place[1:], roads.xy[node]]) for node in found]
    return Connections(found, [_cost_m(request, lanes, points, outbound) for points in straight])


def _by_distance(snapshot: BuildingSnapshot, place: Place) -> Longs:
    """The nodes on the floor of a place, nearest first."""
    roads = snapshot.roads
    floor = roads.floor_index[place.floor]
    low, high = int(roads.offset[floor]), int(roads.offset[floor + 1])
    offset = roads.roads.xy[low:high] - place[1:]
    return low + np.argsort(np.hypot(offset[:, 0], offset[:, 1]), kind="stable").astype(np.int64)


def _cost_m(request: PathRequest, lanes: Floats, points: Floats, outbound: bool) -> float:
    """The length of a drive along points (k, 2), or back if not `outbound`; for the shortest time see slowed_length."""
    if request.best is Criterion.SHORTEST_TIME and len(lanes):
        return slowed_length(lanes, points if outbound else points[::-1].copy(), request.radius, request.speed)
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def connect_around_corners(
    snapshot: BuildingSnapshot, request: PathRequest, place: Place, outbound: bool, turn: Turn
) -> Connections:
    """Connect a free place around corners to the nearest nodes and to the nearest node of each component of the
    roadmap. `outbound`: drives lead away from the place. Raises PlanningTimeout after the deadline of `turn`."""
    roads, space = snapshot.roads, snapshot.spaces[place.floor]
    xy, order = roads.roads.xy, _by_distance(snapshot, place)
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    graph = snapshot.graph(place.floor, request.radius)
    lanes = tie_lanes(snapshot.lanes(place.floor, request.graph), *place[1:], request.radius)
    if not len(order):
        return IN_SIGHT
    for candidates in (_nearest(order, component), order[NEAR_NODES:MORE_NODES]):
        nodes = [
            int(node)
            for node in candidates
            if space.point_is_free(float(xy[node, 0]), float(xy[node, 1]), request.radius)
        ]
        targets: list[XY] = [(float(xy[node, 0]), float(xy[node, 1])) for node in nodes]
        legs = graph.legs(place[1:], targets, lanes=lanes, outbound=outbound, turn=turn)
        near = sorted((leg.length, i) for i, leg in enumerate(legs) if math.isfinite(leg.length))
        if near:
            break
    else:
        return IN_SIGHT
    kept: list[int] = []
    components: set[int] = set()
    for _, i in near:
        number = int(component[nodes[i]])
        if len(kept) < MAX_CONNECTIONS or number not in components:
            kept.append(i)
            components.add(number)
    corners = [legs[i].points[1:-1] if outbound else legs[i].points[1:-1][::-1] for i in kept]
    lengths = [_cost_m(request, lanes, legs[i].points, outbound) for i in kept]
    return Connections([nodes[i] for i in kept], lengths, corners)


def _nearest(order: Longs, component: Longs) -> list[int]:
    """The nearest nodes and the nearest node of each component, from nodes sorted by distance."""
    first = np.unique(component[order], return_index=True)[1]
    of_each = order[np.sort(first)[:MAX_COMPONENTS]]
    return list(dict.fromkeys([*order[:NEAR_NODES].tolist(), *of_each.tolist()]))


def _merged(straight: Connections, around: Connections) -> Connections:
    """Both sets of connections; nodes in sight are connected straight."""
    in_sight = dict(zip(straight.nodes.tolist(), straight.lengths.tolist(), strict=True))
    lengths = in_sight | dict(zip(around.nodes.tolist(), around.lengths.tolist(), strict=True)) | in_sight
    corners = [np.empty((0, 2)) if node in in_sight else around.corners(node) for node in lengths]
    return Connections(list(lengths), list(lengths.values()), corners)


def _penalize_edges(snapshot: BuildingSnapshot, factor: Floats, nodes: list[int]) -> None:
    """Multiply the cost factor of the edges between these nodes, in both directions."""
    roads = snapshot.roads.roads
    on_route = set(nodes)
    for node in nodes[1:-1]:
        for edge in range(roads.first[node], roads.first[node + 1]):
            if int(roads.to[edge]) in on_route:
                factor[edge] *= 1.6
