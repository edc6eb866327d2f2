"""A query on the compiled roadmap: connect both ends to it, search with A*, cut corners.

The estimated cost to go is the straight line on the goal's floor. Elsewhere it is the least cost over a cabin of the
node's floor and on from there. It never exceeds the true cost, so the route found is the cheapest one.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.heuristics import COST_IN_METRES, HeuristicTables, continues_ride, read_heuristics, step_cost
from robocorba.planning.packing import Packed
from robocorba.planning.road_rules import (
    RoadRules,
    breaks_rule,
    is_slowed,
    lanes_on,
    limits_along,
    slowed_length,
    tie_lanes,
)
from robocorba.planning.roads import CLEARANCE, DRIVEN, SPEED_LIMIT, TRAVEL, WAIT, RoadmapArrays
from robocorba.planning.route import (
    COLUMNS,
    ELEVATOR,
    FLOOR,
    LIMIT,
    NODE,
    OFF_ROAD,
    ON_FIXED_ROAD,
    ON_ROAD,
    ROAD,
    TRAVELS,
    WAITS,
    X,
    Y,
    measure,
)
from robocorba.planning.space import TOUCH_M, detour_bound, line_free
from robocorba.planning.triangulation import doubled
from robocorba.planning.world import floor_grid, floor_point_is_free, packed_rules, unpack
from robocorba.system.kernels import inner_kernel, kernel

#: Statuses of `find_route`.
FOUND, NOT_FREE, NOT_CONNECTED = range(3)

#: Maximum number of nodes in sight that a place is connected to.
MAX_CONNECTIONS = 8
#: Such a node is at most this much farther than the nearest one in sight [m].
CONNECTION_REACH_M = 6.0
#: Number of nearest nodes that are tested for sight.
MAX_CANDIDATES = 256
#: A place nearer to a node than this is on the node [m].
ON_NODE_M = 0.01
#: A drive along the roadmap is replaced by one through free space if it is more than DETOUR times as long and at least
#: DETOUR_M [m] longer; path_planner.idl states both. A smaller factor makes every second query search free space as
#: well.
DETOUR, DETOUR_M = 2.5, 1.0


@inner_kernel
def _can_drive(
    grid: Grid, lanes: Floats, ax: float, ay: float, bx: float, by: float, radius: float, outbound: bool
) -> bool:
    """Whether a robot can drive straight from a to b or, if not `outbound`, from b to a: the line is free and breaks no
    rule of `lanes`."""
    if not line_free(grid, ax, ay, bx, by, radius):
        return False
    if outbound:
        return not breaks_rule(lanes, ax, ay, bx, by, radius)
    return not breaks_rule(lanes, bx, by, ax, ay, radius)


@kernel
def roadmap_connections(
    grid: Grid, lanes: Floats, xy: Floats, low: int, high: int, x: float, y: float, radius: float, outbound: bool
) -> tuple[Longs, Floats]:
    """The nodes of low..high-1 that a robot can reach in a straight line from (x, y) or, if not `outbound`, from
    which it can reach (x, y): indices, nearest first, and distances [m]. A place on a node is connected to that node
    only, so that the robot obeys its edges."""
    lanes = tie_lanes(lanes, x, y, radius)
    nodes = np.empty(MAX_CONNECTIONS, np.int64)
    lengths = np.empty(MAX_CONNECTIONS)
    distances = np.empty(high - low)
    for i in range(high - low):
        distances[i] = math.hypot(xy[low + i, 0] - x, xy[low + i, 1] - y)
    count = 0
    for _ in range(min(high - low, MAX_CANDIDATES)):
        nearest = 0
        for i in range(high - low):
            if distances[i] < distances[nearest]:
                nearest = i
        length, node = distances[nearest], low + nearest
        distances[nearest] = np.inf
        if count and length > lengths[0] + CONNECTION_REACH_M:
            break
        nx, ny = xy[node]
        if not _can_drive(grid, lanes, x, y, nx, ny, radius, outbound):
            continue
        nodes[count], lengths[count] = node, length
        count += 1
        if count == MAX_CONNECTIONS or length < ON_NODE_M:
            break
    return nodes[:count], lengths[:count]


@kernel
def component_connections(
    grid: Grid,
    lanes: Floats,
    xy: Floats,
    order: Longs,
    component: Longs,
    x: float,
    y: float,
    radius: float,
    outbound: bool,
) -> Longs:
    """Like roadmap_connections, but the first node in sight of each component (n,) of the roadmap, at any distance.
    order: the nodes of the floor, nearest first."""
    done = np.zeros(component.shape[0], np.bool_)
    nodes, count = np.empty(order.shape[0], np.int64), 0
    for node in order:
        nx, ny = xy[node]
        if not done[component[node]] and _can_drive(grid, lanes, x, y, nx, ny, radius, outbound):
            done[component[node]] = True
            nodes[count] = node
            count += 1
    return nodes[:count]


@inner_kernel
def cheapest_route(
    roads: RoadmapArrays,
    heuristics: HeuristicTables,
    starts: Longs,
    start_lengths: Floats,
    goals: Longs,
    goal_lengths: Floats,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    radius: float,
    speed_m_s: float,
    factor: Floats,
) -> tuple[float, Longs, Longs]:
    """The cheapest route from any of `starts` to any of `goals`: cost, nodes, and the edges between them.

    Costs are seconds at `speed_m_s`, or metres with COST_IN_METRES. `factor` (m,) multiplies the costs of edges; inf
    closes an edge, and an empty array changes nothing. Without a route the cost is infinite."""
    if heuristics.cost.shape[0] and not factor.shape[0]:
        found, nodes, edges = _route_from_table(
            roads, heuristics, starts, start_lengths, goals, goal_lengths, speed_m_s
        )
        if found >= 0.0:
            return found, nodes, edges
    first, count = roads.first, roads.xy.shape[0]
    metres_per_cost = speed_m_s if speed_m_s != COST_IN_METRES else 1.0
    cabin_bounds = _cabin_bounds(roads, heuristics, goal_floor, goal_x, goal_y, metres_per_cost)
    cost = np.full(count, np.inf)
    parent = np.empty(count, np.int64)  # parent and via are valid only where the cost is finite:
    via = np.empty(count, np.int64)  # filling them would take longer than many searches
    done = np.zeros(count, np.bool_)
    best, last = np.inf, -1
    queue = [(0.0, -1) for _ in range(0)]
    for i in range(starts.shape[0]):
        node = starts[i]
        cost[node] = start_lengths[i] / metres_per_cost
        parent[node] = via[node] = -1
        estimate = _cost_to_go(roads, heuristics, cabin_bounds, node, goal_floor, goal_x, goal_y, metres_per_cost)
        if estimate < np.inf:
            heapq.heappush(queue, (cost[node] + estimate, node))
    while queue:
        total, node = heapq.heappop(queue)
        if total >= best:
            break
        if done[node]:
            continue
        done[node] = True
        for i in range(goals.shape[0]):
            if goals[i] == node and cost[node] + goal_lengths[i] / metres_per_cost < best:
                best, last = cost[node] + goal_lengths[i] / metres_per_cost, node
        for edge in range(first[node], first[node + 1]):
            other = roads.to[edge]
            if (
                done[other]
                or roads.measures[edge, CLEARANCE] < radius - TOUCH_M
                or continues_ride(roads, via[node], edge)
            ):
                continue
            step = step_cost(roads, edge, speed_m_s)
            if factor.shape[0]:
                step *= factor[edge]
            if cost[node] + step < cost[other]:
                estimate = _cost_to_go(
                    roads, heuristics, cabin_bounds, other, goal_floor, goal_x, goal_y, metres_per_cost
                )
                if estimate < np.inf:
                    cost[other] = cost[node] + step
                    parent[other], via[other] = node, edge
                    heapq.heappush(queue, (cost[other] + estimate, other))
    nodes, edges = _traced_back(parent, via, last)
    return best, nodes, edges


@inner_kernel
def _cabin_bounds(
    roads: RoadmapArrays,
    heuristics: HeuristicTables,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    metres_per_cost: float,
) -> Floats:
    """Lower bounds (c,) of the cost from the nodes in cabins to the goal."""
    bounds = np.full(heuristics.node.shape[0], np.inf)
    for c in range(bounds.shape[0]):
        for g in range(heuristics.start[goal_floor], heuristics.start[goal_floor + 1]):
            x, y = roads.xy[heuristics.node[g]]
            rest = math.hypot(x - goal_x, y - goal_y) / metres_per_cost
            bounds[c] = min(bounds[c], heuristics.bound[c, g] + rest)
    return bounds


@inner_kernel
def _traced_back(parent: Longs, via: Longs, last: int) -> tuple[Longs, Longs]:
    """The nodes of the route that ends at node `last`, none for -1, and the edges between them."""
    steps, node = 0, last
    while node >= 0:
        steps += 1
        node = parent[node]
    nodes, edges = np.empty(steps, np.int64), np.empty(max(steps - 1, 0), np.int64)
    node = last
    for i in range(steps - 1, -1, -1):
        nodes[i] = node
        if i > 0:
            edges[i - 1] = via[node]
        node = parent[node]
    return nodes, edges


@inner_kernel
def _route_from_table(
    roads: RoadmapArrays,
    heuristics: HeuristicTables,
    starts: Longs,
    start_lengths: Floats,
    goals: Longs,
    goal_lengths: Floats,
    speed_m_s: float,
) -> tuple[float, Longs, Longs]:
    """The cheapest route from the table of all costs; a cost of -1 if the table cannot give the route."""
    metres_per_cost = speed_m_s if speed_m_s != COST_IN_METRES else 1.0
    best, here, goal = np.inf, -1, -1
    for i in range(starts.shape[0]):
        for k in range(goals.shape[0]):
            cost = heuristics.cost[starts[i], goals[k]] + (start_lengths[i] + goal_lengths[k]) / metres_per_cost
            if cost < best:
                best, here, goal = cost, starts[i], goals[k]
    nodes = np.empty(roads.xy.shape[0], np.int64)
    edges = np.empty(roads.xy.shape[0], np.int64)
    if here < 0:
        return best, nodes[:0], edges[:0]
    steps = 0
    nodes[0] = here
    while here != goal:
        edge = heuristics.edge[here, goal]
        if steps and continues_ride(roads, edges[steps - 1], edge):
            return -1.0, nodes[:0], edges[:0]  # the table mixes two routes of the same cost
        here = roads.to[edge]
        edges[steps] = edge
        steps += 1
        nodes[steps] = here
    return best, nodes[: steps + 1], edges[:steps]


@inner_kernel
def _cost_to_go(
    roads: RoadmapArrays,
    heuristics: HeuristicTables,
    cabin_bounds: Floats,
    node: int,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    metres_per_cost: float,
) -> float:
    """Lower bound of the cost from a node to the goal; `cabin_bounds` (c,) is that bound for the nodes in cabins."""
    x, y = roads.xy[node]
    here = roads.floor[node]
    if here == goal_floor:
        return math.hypot(x - goal_x, y - goal_y) / metres_per_cost
    least = np.inf
    for c in range(heuristics.start[here], heuristics.start[here + 1]):
        stop = heuristics.node[c]
        least = min(least, math.hypot(x - roads.xy[stop, 0], y - roads.xy[stop, 1]) / metres_per_cost + cabin_bounds[c])
    return least


@inner_kernel
def cut_corners(grid: Grid, lanes: Floats, points: Floats, road: Floats, radius: float) -> Longs:
    """Indices of the points (k, 2) that remain when every corner that can be cut is cut.

    ON_FIXED_ROAD in road[i] keeps the line from point i to i + 1. No cut breaks a rule of `lanes` or follows one with a
    speed limit."""
    kept = np.empty(points.shape[0], np.int64)
    count, at, last = 0, 0, points.shape[0] - 1
    while at < last:
        kept[count] = at
        count += 1
        far = at + 1
        if road[at] != ON_FIXED_ROAD:
            while far < last and road[far] != ON_FIXED_ROAD:
                far += 1
        while far > at + 1:
            ax, ay = points[at]
            bx, by = points[far]
            if _can_drive(grid, lanes, ax, ay, bx, by, radius, True) and not is_slowed(lanes, ax, ay, bx, by, radius):
                break
            far -= 1
        at = far
    kept[count] = last
    return kept[: count + 1]


@kernel
def find_path(
    world_longs: Longs,
    world_floats: Floats,
    heuristics_longs: Longs,
    heuristics_floats: Floats,
    start_floor: int,
    start_x: float,
    start_y: float,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    radius: float,
    speed: float,
) -> tuple[bool, Floats]:
    """The shortest route if both ends see the roadmap, with corners cut: (True, route) if one of its drives may be a
    detour, else (False, points). The points are empty where this search finds nothing; `topological.routes` then
    searches further or explains. Few parameters, because every argument costs time."""
    world, heuristics = Packed(world_longs, world_floats), Packed(heuristics_longs, heuristics_floats)
    rules = packed_rules(world)
    nodes, lengths = np.empty(0, np.int64), np.empty(0)
    start, goal = (start_floor, start_x, start_y), (goal_floor, goal_x, goal_y)
    status, route = find_route(
        world, heuristics, rules, start, nodes, lengths, goal, nodes, lengths, radius, COST_IN_METRES, bool(1), lengths
    )
    if status != FOUND:
        return False, route
    route = smoothed(world, rules, route, radius)
    if may_be_detour(world, route):
        return True, route
    return False, points_of(world, with_limits(rules, route, radius), radius, speed)


@kernel
def points_of(world: Packed, route: Floats, radius: float, speed: float) -> Floats:
    """The points of a route driven at `speed` [m/s], as in route.measure; empty if a drive comes nearer to an obstacle
    than the radius. Every answer must pass this check."""
    ground, _ = unpack(world)
    for i in range(route.shape[0] - 1):
        if route[i, ELEVATOR] >= 0.0:
            continue
        grid, ax, ay = floor_grid(ground, int(route[i, FLOOR])), route[i, X], route[i, Y]
        is_free = line_free(grid, ax, ay, route[i + 1, X], route[i + 1, Y], radius)
        if not is_free or route[i, FLOOR] != route[i + 1, FLOOR]:
            return measure(route[:0], ground.elevations, speed)
    return measure(route, ground.elevations, speed)


@kernel
def may_be_detour(world: Packed, route: Floats) -> bool:
    """Whether a path through free space may be much shorter than one of the drives of a route."""
    at = np.int64(0)
    for i in range(route.shape[0]):
        if i + 1 < route.shape[0] and route[i, ELEVATOR] < 0.0:
            continue
        if max_free_length(world, route, at, i) > 0.0:
            return True
        at = i + 1
    return False


@kernel
def max_free_length(world: Packed, route: Floats, first: int, last: int) -> float:
    """Maximum length of a path through free space that replaces the drive between two rows of a floor [m]; 0 if no
    path can be that short, because a wall between the two is too long."""
    length = 0.0
    for i in range(first, last):
        length += math.hypot(route[i + 1, X] - route[i, X], route[i + 1, Y] - route[i, Y])
    max_length = min(length / DETOUR, length - DETOUR_M)
    ax, ay, bx, by = route[first, X], route[first, Y], route[last, X], route[last, Y]
    if math.hypot(bx - ax, by - ay) >= max_length:
        return 0.0
    ground, _ = unpack(world)
    bound = detour_bound(floor_grid(ground, int(route[first, FLOOR])), ax, ay, bx, by)
    return max_length if bound < max_length else 0.0


@kernel
def find_route(
    world: Packed,
    heuristics: Packed,
    rules: RoadRules,
    start: tuple[int, float, float],
    starts: Longs,
    start_lengths: Floats,
    goal: tuple[int, float, float],
    goals: Longs,
    goal_lengths: Floats,
    radius: float,
    speed_m_s: float,
    straight: bool,
    factor: Floats,
) -> tuple[int, Floats]:
    """A status (FOUND or the reason of the failure) and the route (see route.py) from start to goal, both (floor, x,
    y).

    The route is the fastest at `speed_m_s`, or the shortest with COST_IN_METRES; `straight` allows the line from
    start to goal. If `starts` or `goals` are empty, the search connects that end to the nodes in sight. Lengths of
    connections are metres at `speed_m_s`, see slowed_length."""
    ground, roads = unpack(world)
    no_rows, yes = np.empty((0, COLUMNS)), bool(1)
    start_floor, sx, sy = start
    goal_floor, gx, gy = goal
    if not floor_point_is_free(ground, start_floor, sx, sy, radius):
        return NOT_FREE, no_rows
    if not floor_point_is_free(ground, goal_floor, gx, gy, radius):
        return NOT_FREE, no_rows
    start_grid, start_lanes = floor_grid(ground, start_floor), lanes_on(rules, start_floor)
    nothing, straight_m = np.empty(0, np.int64), np.inf
    if straight and start_floor == goal_floor and _can_drive(start_grid, start_lanes, sx, sy, gx, gy, radius, True):
        straight_m = _slowed(start_lanes, sx, sy, gx, gy, radius, speed_m_s)
        if straight_m <= math.hypot(gx - sx, gy - sy):
            return FOUND, _route_over(roads, start, goal, nothing, nothing)
    if not starts.shape[0]:
        low, high = ground.first_node[start_floor], ground.first_node[start_floor + 1]
        starts, start_lengths = roadmap_connections(start_grid, start_lanes, roads.xy, low, high, sx, sy, radius, yes)
        for i in range(starts.shape[0]):
            nx, ny = roads.xy[starts[i]]
            start_lengths[i] = _slowed(start_lanes, sx, sy, nx, ny, radius, speed_m_s)
        if not starts.shape[0] and straight_m == np.inf:
            return NOT_CONNECTED, no_rows
    if not goals.shape[0]:
        low, high = ground.first_node[goal_floor], ground.first_node[goal_floor + 1]
        goal_grid, goal_lanes = floor_grid(ground, goal_floor), lanes_on(rules, goal_floor)
        goals, goal_lengths = roadmap_connections(goal_grid, goal_lanes, roads.xy, low, high, gx, gy, radius, not yes)
        for i in range(goals.shape[0]):
            nx, ny = roads.xy[goals[i]]
            goal_lengths[i] = _slowed(goal_lanes, nx, ny, gx, gy, radius, speed_m_s)
        if not goals.shape[0] and straight_m == np.inf:
            return NOT_CONNECTED, no_rows
    cost, nodes, edges = cheapest_route(
        roads,
        read_heuristics(heuristics, roads.xy.shape[0]),
        starts,
        start_lengths,
        goals,
        goal_lengths,
        goal_floor,
        gx,
        gy,
        radius,
        speed_m_s,
        factor,
    )
    if straight_m < np.inf and straight_m / speed_m_s <= cost:
        return FOUND, _route_over(roads, start, goal, nothing, nothing)
    if not cost < np.inf:
        return NOT_CONNECTED, no_rows
    return FOUND, _route_over(roads, start, goal, nodes, edges)


@inner_kernel
def _slowed(lanes: Floats, ax: float, ay: float, bx: float, by: float, radius: float, speed_m_s: float) -> float:
    """Length of the drive from a to b, see slowed_length; in metres with COST_IN_METRES."""
    if speed_m_s == COST_IN_METRES or not lanes.shape[0]:
        return math.hypot(bx - ax, by - ay)
    line = np.empty((2, 2))
    line[0, 0], line[0, 1], line[1, 0], line[1, 1] = ax, ay, bx, by
    return slowed_length(lanes, line, radius, speed_m_s)


@inner_kernel
def _route_over(
    roads: RoadmapArrays, start: tuple[int, float, float], goal: tuple[int, float, float], nodes: Longs, edges: Longs
) -> Floats:
    """The route from start over nodes and edges to goal. Between nodes at different places of a cabin the robot drives
    in it, after the ride or before."""
    count = nodes.shape[0] + 2
    for edge in edges:
        count += roads.measures[edge, DRIVEN] != 0.0
    route = np.zeros((count, COLUMNS))
    for i in range(count):
        route[i, NODE], route[i, ELEVATOR], route[i, LIMIT] = -1.0, -1.0, np.inf
    route[0, FLOOR], route[0, X], route[0, Y] = start
    at = 1
    for i in range(nodes.shape[0]):
        node = nodes[i]
        x, y = roads.xy[node]
        route[at, FLOOR], route[at, X], route[at, Y], route[at, NODE] = roads.floor[node], x, y, node
        if i < edges.shape[0]:
            edge, after = edges[i], nodes[i + 1]
            driven = roads.measures[edge, DRIVEN]
            if driven < 0.0:
                at += 1
                route[at, FLOOR] = roads.floor[node]
                route[at, X], route[at, Y] = roads.xy[after]
            route[at, LIMIT], route[at, ELEVATOR] = roads.measures[edge, SPEED_LIMIT], roads.elevator[edge]
            route[at, WAITS], route[at, TRAVELS] = roads.measures[edge, WAIT], roads.measures[edge, TRAVEL]
            route[at, ROAD] = ON_FIXED_ROAD if roads.fixed[edge] else ON_ROAD
            if driven > 0.0:
                at += 1
                route[at, FLOOR], route[at, X], route[at, Y] = roads.floor[after], x, y
        at += 1
    route[at, FLOOR], route[at, X], route[at, Y] = goal
    return route


@kernel
def with_limits(rules: RoadRules, route: Floats, radius: float) -> Floats:
    """The route with the drives off the road split where they begin or cease to follow edges that have a speed limit,
    which they obey there."""
    count = route.shape[0]
    is_any = False
    for i in range(count - 1):
        if route[i, ELEVATOR] < 0.0 and route[i, ROAD] == OFF_ROAD:
            lanes = lanes_on(rules, int(route[i, FLOOR]))
            is_any |= is_slowed(lanes, route[i, X], route[i, Y], route[i + 1, X], route[i + 1, Y], radius)
    if not is_any:
        return route
    found, size = np.empty((count, COLUMNS)), 0
    for i in range(count):
        if size == found.shape[0]:
            found = doubled(found)
        _copy_row(found, size, route, i)
        size += 1
        if i == count - 1 or route[i, ELEVATOR] >= 0.0 or route[i, ROAD] != OFF_ROAD:
            continue
        lanes = lanes_on(rules, int(route[i, FLOOR]))
        ax, ay, bx, by = route[i, X], route[i, Y], route[i + 1, X], route[i + 1, Y]
        if not is_slowed(lanes, ax, ay, bx, by, radius):
            continue
        ends, limits = limits_along(lanes, ax, ay, bx, by, radius)
        found[size - 1, LIMIT] = limits[0]
        for k in range(1, ends.shape[0]):
            if size == found.shape[0]:
                found = doubled(found)
            _copy_row(found, size, found, size - 1)
            found[size, X], found[size, Y] = ax + ends[k - 1] * (bx - ax), ay + ends[k - 1] * (by - ay)
            found[size, NODE], found[size, LIMIT] = -1.0, limits[k]
            size += 1
    return found[:size]


@kernel
def smoothed(world: Packed, rules: RoadRules, route: Floats, radius: float) -> Floats:
    """The route with the corners of each of its drives cut."""
    ground, _ = unpack(world)
    count = route.shape[0]
    kept = np.empty(count, np.int64)
    size, at = 0, 0
    while at < count:
        end = at
        while end < count - 1 and route[end, ELEVATOR] < 0.0:
            end += 1
        floor = int(route[at, FLOOR])
        grid, lanes = floor_grid(ground, floor), lanes_on(rules, floor)
        corners = cut_corners(grid, lanes, route[at : end + 1, X : Y + 1], route[at : end + 1, ROAD], radius)
        for corner in corners:
            kept[size] = at + corner
            size += 1
        at = end + 1
    rows = _picked(route, kept[:size])
    for k in range(size - 1):
        if kept[k + 1] != kept[k] + 1:
            rows[k, LIMIT], rows[k, ROAD] = np.inf, OFF_ROAD
    return _without_straight_stops(rules, rows, radius)


@inner_kernel
def _picked(route: Floats, kept: Longs) -> Floats:
    """Some rows of a route."""
    rows = np.empty((kept.shape[0], COLUMNS))
    for i in range(kept.shape[0]):
        _copy_row(rows, i, route, kept[i])
    return rows


@inner_kernel
def _copy_row(to: Floats, i: int, rows: Floats, k: int) -> None:
    for column in range(COLUMNS):
        to[i, column] = rows[k, column]


@inner_kernel
def _without_straight_stops(rules: RoadRules, route: Floats, radius: float) -> Floats:
    """The route without stops at which a drive neither turns nor changes its speed limit. A drive off the road remains
    two where both together would follow an edge that is closed or slow."""
    count = route.shape[0]
    kept = np.empty(count, np.int64)
    size = 0
    for i in range(count):
        if 0 < i < count - 1 and route[i, ELEVATOR] < 0.0 and route[i - 1, ELEVATOR] < 0.0:
            before = kept[size - 1]
            ax, ay = route[i, X] - route[before, X], route[i, Y] - route[before, Y]
            bx, by = route[i + 1, X] - route[i, X], route[i + 1, Y] - route[i, Y]
            straight = abs(ax * by - ay * bx) <= TOUCH_M * (math.hypot(ax, ay) + math.hypot(bx, by))
            if straight and ax * bx + ay * by >= 0.0 and route[i, LIMIT] == route[before, LIMIT]:
                if route[i, ROAD] != OFF_ROAD and route[before, ROAD] != OFF_ROAD:
                    continue
                lanes = lanes_on(rules, int(route[i, FLOOR]))
                ax, ay, bx, by = route[before, X], route[before, Y], route[i + 1, X], route[i + 1, Y]
                if not breaks_rule(lanes, ax, ay, bx, by, radius) and not is_slowed(lanes, ax, ay, bx, by, radius):
                    continue
        kept[size] = i
        size += 1
    return _picked(route, kept[:size])
