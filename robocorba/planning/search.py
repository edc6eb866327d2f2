"""A query on the compiled road map: tie both ends to it, A*, cut corners.

The estimate of what is left is the straight line on the goal's floor and, elsewhere,
the best way over a cabin of this floor and the least cost from that cabin on; it never
exceeds the true cost, so the path found is the cheapest one.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from robocorba.kernels import kernel
from robocorba.planning.heuristics import Guide, read_guide, rides_on, step_cost
from robocorba.planning.packing import Packed
from robocorba.planning.roads import CLEARANCE, SPEED_LIMIT, TRAVEL, WAIT, Roads
from robocorba.planning.route import COLUMNS, ELEVATOR, FIXED, FLOOR, LIMIT, NODE, TRAVELS, WAITS, X, Y, measure
from robocorba.planning.space import TOUCH_M, against_one_way, least_around, line_free
from robocorba.planning.world import Ground, floor_grid, floor_lanes, floor_stands_free, unpack
from robocorba.spatial.grids import Floats, Grid, Longs

#: What `find_way` says beside a way.
FOUND, START_NOT_FREE, GOAL_NOT_FREE, START_SEES_NO_NODE, GOAL_SEES_NO_NODE, NO_WAY = range(6)
NO_ROWS = np.empty((0, COLUMNS))

#: A point joins the graph at the nearest nodes in straight free sight, at most so many ...
MOST_JOINTS = 8
#: ... none of them so much farther than the nearest in sight, m ...
JOINT_REACH_M = 6.0
#: ... and none that is not among so many nearest nodes, in sight or not.
MOST_LOOKS = 256
#: A place nearer to a node than this is on it, m.
ON_NODE_M = 0.01
#: A drive along the road map is left for free space where it is more than this many times as long, and at least
#: DETOUR_M longer; path_planner.idl states both. A smaller factor makes every second query search free space as well.
DETOUR, DETOUR_M = 2.5, 1.0


@kernel
def joints(
    grid: Grid,
    lanes: Floats,
    xy: Floats,
    low: int,
    high: int,
    x: float,
    y: float,
    radius: float,
    outbound: bool,
) -> tuple[Longs, Floats]:
    """Nodes low..high-1 that a robot can reach from (x, y) in a straight line (or from
    which it can reach it: not outbound), nearest first, and how far they are. A place
    on a node is tied to that node alone, so that it obeys its edges."""
    nodes = np.empty(MOST_JOINTS, np.int64)
    lengths = np.empty(MOST_JOINTS)
    away = np.empty(high - low)
    for i in range(high - low):
        away[i] = math.hypot(xy[low + i, 0] - x, xy[low + i, 1] - y)
    count = 0
    for _ in range(min(high - low, MOST_LOOKS)):
        nearest = 0
        for i in range(high - low):
            if away[i] < away[nearest]:
                nearest = i
        length, node = away[nearest], low + nearest
        away[nearest] = np.inf
        if count and length > lengths[0] + JOINT_REACH_M:
            break
        nx, ny = xy[node]
        if not line_free(grid, x, y, nx, ny, radius):
            continue
        if outbound:
            wrong_way = against_one_way(lanes, x, y, nx, ny, radius)
        else:
            wrong_way = against_one_way(lanes, nx, ny, x, y, radius)
        if wrong_way:
            continue
        nodes[count], lengths[count] = node, length
        count += 1
        if count == MOST_JOINTS or length < ON_NODE_M:
            break
    return nodes[:count], lengths[:count]


@kernel
def joints_of_each(
    grid: Grid,
    lanes: Floats,
    xy: Floats,
    low: int,
    high: int,
    component: Longs,
    x: float,
    y: float,
    radius: float,
    outbound: bool,
) -> tuple[Longs, Floats]:
    """The same, the nearest node of each component (n,) of the road map that is in sight, however far."""
    away = np.empty(high - low)
    for i in range(high - low):
        away[i] = math.hypot(xy[low + i, 0] - x, xy[low + i, 1] - y)
    done = np.zeros(component.max() + 1 if component.shape[0] else 0, np.bool_)
    nodes = np.empty(high - low, np.int64)
    count = 0
    for i in np.argsort(away):
        node = low + i
        if done[component[node]]:
            continue
        nx, ny = xy[node]
        if not line_free(grid, x, y, nx, ny, radius):
            continue
        if outbound:
            wrong_way = against_one_way(lanes, x, y, nx, ny, radius)
        else:
            wrong_way = against_one_way(lanes, nx, ny, x, y, radius)
        if not wrong_way:
            done[component[node]] = True
            nodes[count] = node
            count += 1
    return nodes[:count], away[nodes[:count] - low]


@kernel
def cheapest(
    roads: Roads,
    guide: Guide,
    starts: Longs,
    start_lengths: Floats,
    goals: Longs,
    goal_lengths: Floats,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    radius: float,
    pace: float,
    factor: Floats,
) -> tuple[float, Longs, Longs]:
    """Cheapest way from any of `starts` to any of `goals`: cost, nodes, and the edges between them.

    Costs are seconds at `pace` m/s, or metres where it is 0. `factor` (m,) multiplies
    what edges cost, inf closes them; it may be empty. Without a way the cost is infinite."""
    if guide.cost.shape[0] and not factor.shape[0]:
        found, nodes, edges = _looked_up(roads, guide, starts, start_lengths, goals, goal_lengths, pace)
        if found >= 0.0:
            return found, nodes, edges
    xy, first = roads.xy, roads.first
    count = xy.shape[0]
    speed = pace if pace > 0.0 else 1.0
    bounds = np.full(guide.node.shape[0], np.inf)
    for c in range(bounds.shape[0]):
        for g in range(guide.start[goal_floor], guide.start[goal_floor + 1]):
            node = guide.node[g]
            rest = math.hypot(xy[node, 0] - goal_x, xy[node, 1] - goal_y) / speed
            bounds[c] = min(bounds[c], guide.bound[c, g] + rest)

    cost = np.full(count, np.inf)
    parent = np.empty(count, np.int64)  # these two hold something only where the cost is finite:
    via = np.empty(count, np.int64)  # filling them would take longer than many a search
    done = np.zeros(count, np.bool_)
    best, last = np.inf, -1
    queue = [(0.0, -1) for _ in range(0)]
    for i in range(starts.shape[0]):
        node = starts[i]
        cost[node] = start_lengths[i] / speed
        parent[node] = via[node] = -1
        estimate = _left(roads, guide, bounds, node, goal_floor, goal_x, goal_y, speed)
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
            if goals[i] == node and cost[node] + goal_lengths[i] / speed < best:
                best, last = cost[node] + goal_lengths[i] / speed, node
        for edge in range(first[node], first[node + 1]):
            other = roads.to[edge]
            if done[other] or roads.measures[edge, CLEARANCE] < radius - TOUCH_M or rides_on(roads, via[node], edge):
                continue
            step = step_cost(roads, edge, pace)
            if factor.shape[0]:
                step *= factor[edge]
            if cost[node] + step < cost[other]:
                estimate = _left(roads, guide, bounds, other, goal_floor, goal_x, goal_y, speed)
                if estimate < np.inf:
                    cost[other] = cost[node] + step
                    parent[other], via[other] = node, edge
                    heapq.heappush(queue, (cost[other] + estimate, other))
    steps = 0
    node = last
    while node >= 0:
        steps += 1
        node = parent[node]
    nodes = np.empty(steps, np.int64)
    edges = np.empty(max(steps - 1, 0), np.int64)
    node = last
    for i in range(steps - 1, -1, -1):
        nodes[i] = node
        if i > 0:
            edges[i - 1] = via[node]
        node = parent[node]
    return best, nodes, edges


@kernel
def _looked_up(
    roads: Roads,
    guide: Guide,
    starts: Longs,
    start_lengths: Floats,
    goals: Longs,
    goal_lengths: Floats,
    pace: float,
) -> tuple[float, Longs, Longs]:
    """The same from the table of all costs; a cost of -1 where the table can't tell the way."""
    speed = pace if pace > 0.0 else 1.0
    best, here, goal = np.inf, -1, -1
    for i in range(starts.shape[0]):
        for k in range(goals.shape[0]):
            cost = guide.cost[starts[i], goals[k]] + (start_lengths[i] + goal_lengths[k]) / speed
            if cost < best:
                best, here, goal = cost, starts[i], goals[k]
    nodes = np.empty(roads.xy.shape[0], np.int64)
    edges = np.empty(roads.xy.shape[0], np.int64)
    if here < 0:
        return best, nodes[:0], edges[:0]
    steps = 0
    nodes[0] = here
    while here != goal:
        edge = guide.edge[here, goal]
        if steps and rides_on(roads, edges[steps - 1], edge):
            return -1.0, nodes[:0], edges[:0]  # two ways cost the same, and the table mixes them
        here = roads.to[edge]
        edges[steps] = edge
        steps += 1
        nodes[steps] = here
    return best, nodes[: steps + 1], edges[:steps]


@kernel
def _left(
    roads: Roads,
    guide: Guide,
    bounds: Floats,
    node: int,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    speed: float,
) -> float:
    """What the way from a node to the goal costs at least; `bounds` (c,) is that for the nodes in cabins."""
    x, y = roads.xy[node]
    here = roads.floor[node]
    if here == goal_floor:
        return math.hypot(x - goal_x, y - goal_y) / speed
    least = np.inf
    for c in range(guide.start[here], guide.start[here + 1]):
        stop = guide.node[c]
        least = min(least, math.hypot(x - roads.xy[stop, 0], y - roads.xy[stop, 1]) / speed + bounds[c])
    return least


@kernel
def cut_corners(grid: Grid, lanes: Floats, points: Floats, fixed: Floats, radius: float) -> Longs:
    """Indices of the points (k, 2) that remain when every corner that can be cut is cut.

    fixed[i] > 0 keeps the line from point i to i + 1 as it is."""
    kept = np.empty(points.shape[0], np.int64)
    count, at, last = 0, 0, points.shape[0] - 1
    while at < last:
        kept[count] = at
        count += 1
        far = at + 1
        if fixed[at] <= 0.0:
            while far < last and fixed[far] <= 0.0:
                far += 1
        while far > at + 1:
            ax, ay = points[at]
            bx, by = points[far]
            if line_free(grid, ax, ay, bx, by, radius) and not against_one_way(lanes, ax, ay, bx, by, radius):
                break
            far -= 1
        at = far
    kept[count] = last
    return kept[: count + 1]


@kernel
def find_path(
    world_longs: Longs,
    world_floats: Floats,
    guide_longs: Longs,
    guide_floats: Floats,
    start_floor: int,
    start_x: float,
    start_y: float,
    goal_floor: int,
    goal_x: float,
    goal_y: float,
    radius: float,
    speed: float,
) -> tuple[bool, Floats]:
    """The shortest way for ends in sight of the road map, with corners cut: whether one of its drives may be a detour,
    and the way itself if so, else its points; none where the way needs more than that, and `topological.ways` finds
    it, or why there is none. It takes no more than it needs, because every argument costs."""
    world, guide = Packed(world_longs, world_floats), Packed(guide_longs, guide_floats)
    nodes, lengths = np.empty(0, np.int64), np.empty(0)
    start, goal = (start_floor, start_x, start_y), (goal_floor, goal_x, goal_y)
    status, way = find_way(world, guide, start, nodes, lengths, goal, nodes, lengths, radius, 0.0, True, lengths)
    if status != FOUND:
        return False, way
    way = smoothed(world, way, radius)
    if is_detour(world, way):
        return True, way
    return False, points_of(world, way, radius, speed)


@kernel
def points_of(world: Packed, way: Floats, radius: float, speed: float) -> Floats:
    """The points of a way driven at `speed` m/s, as in route.measure; none where it is not clear, whatever found it."""
    ground, _ = unpack(world)
    return measure(way if is_clear(ground, way, radius) else NO_ROWS, ground.elevations, speed)


@kernel
def is_detour(world: Packed, way: Floats) -> bool:
    """Whether roads may have to be left on one of its drives."""
    at = 0
    for i in range(way.shape[0]):
        if i + 1 < way.shape[0] and way[i, ELEVATOR] < 0.0:
            continue
        if longest_free(world, way, at, i) > 0.0:
            return True
        at = i + 1
    return False


@kernel
def longest_free(world: Packed, way: Floats, first: int, last: int) -> float:
    """How long the way through free space is at most for which the roads between two rows of a floor are left, m; 0
    where no way is that short, because a wall between the two is too long."""
    length = 0.0
    for i in range(first, last):
        length += math.hypot(way[i + 1, X] - way[i, X], way[i + 1, Y] - way[i, Y])
    most = min(length / DETOUR, length - DETOUR_M)
    ax, ay, bx, by = way[first, X], way[first, Y], way[last, X], way[last, Y]
    if math.hypot(bx - ax, by - ay) >= most:
        return 0.0
    ground, _ = unpack(world)
    return most if least_around(floor_grid(ground, int(way[first, FLOOR])), ax, ay, bx, by) < most else 0.0


@kernel
def is_clear(ground: Ground, way: Floats, radius: float) -> bool:
    """Whether every drive of a way keeps the radius from everything that blocks: what no answer may fail."""
    for i in range(way.shape[0] - 1):
        if way[i, ELEVATOR] >= 0.0:
            continue
        if way[i, FLOOR] != way[i + 1, FLOOR]:
            return False
        grid = floor_grid(ground, int(way[i, FLOOR]))
        if not line_free(grid, way[i, X], way[i, Y], way[i + 1, X], way[i + 1, Y], radius):
            return False
    return True


@kernel
def find_way(
    world: Packed,
    guide: Packed,
    start: tuple[int, float, float],
    starts: Longs,
    start_lengths: Floats,
    goal: tuple[int, float, float],
    goals: Longs,
    goal_lengths: Floats,
    radius: float,
    pace: float,
    straight: bool,
    factor: Floats,
) -> tuple[int, Floats]:
    """FOUND or why not, and the way (see route.py) from start to goal, (floor, x, y) both.

    It is the fastest at `pace` m/s, or the shortest where pace is 0; `straight` allows the
    line from start to goal. Where `starts` or `goals` are empty, the nodes in sight are
    looked up."""
    ground, roads = unpack(world)
    start_floor, sx, sy = start
    goal_floor, gx, gy = goal
    if not floor_stands_free(ground, start_floor, sx, sy, radius):
        return START_NOT_FREE, NO_ROWS
    if not floor_stands_free(ground, goal_floor, gx, gy, radius):
        return GOAL_NOT_FREE, NO_ROWS
    start_grid, start_lanes = floor_grid(ground, start_floor), floor_lanes(ground, start_floor)
    if (
        straight
        and start_floor == goal_floor
        and line_free(start_grid, sx, sy, gx, gy, radius)
        and not against_one_way(start_lanes, sx, sy, gx, gy, radius)
    ):
        nothing = np.empty(0, np.int64)
        return FOUND, _way(roads, start, goal, nothing, nothing)
    if not starts.shape[0]:
        low, high = ground.first_node[start_floor], ground.first_node[start_floor + 1]
        starts, start_lengths = joints(start_grid, start_lanes, roads.xy, low, high, sx, sy, radius, True)
        if not starts.shape[0]:
            return START_SEES_NO_NODE, NO_ROWS
    if not goals.shape[0]:
        low, high = ground.first_node[goal_floor], ground.first_node[goal_floor + 1]
        goal_grid, goal_lanes = floor_grid(ground, goal_floor), floor_lanes(ground, goal_floor)
        goals, goal_lengths = joints(goal_grid, goal_lanes, roads.xy, low, high, gx, gy, radius, False)
        if not goals.shape[0]:
            return GOAL_SEES_NO_NODE, NO_ROWS
    cost, nodes, edges = cheapest(
        roads,
        read_guide(guide, roads.xy.shape[0]),
        starts,
        start_lengths,
        goals,
        goal_lengths,
        goal_floor,
        gx,
        gy,
        radius,
        pace,
        factor,
    )
    if not cost < np.inf:
        return NO_WAY, NO_ROWS
    return FOUND, _way(roads, start, goal, nodes, edges)


@kernel
def _way(
    roads: Roads, start: tuple[int, float, float], goal: tuple[int, float, float], nodes: Longs, edges: Longs
) -> Floats:
    """The way from start over nodes and edges to goal."""
    count = nodes.shape[0] + 2
    way = np.zeros((count, COLUMNS))
    for i in range(count):
        way[i, NODE], way[i, ELEVATOR], way[i, LIMIT] = -1.0, -1.0, np.inf
        if i == 0:
            way[i, FLOOR], way[i, X], way[i, Y] = start
        elif i == count - 1:
            way[i, FLOOR], way[i, X], way[i, Y] = goal
        else:
            node = nodes[i - 1]
            way[i, FLOOR], way[i, NODE] = roads.floor[node], node
            way[i, X], way[i, Y] = roads.xy[node]
        if 0 < i < count - 2:
            edge = edges[i - 1]
            way[i, LIMIT], way[i, ELEVATOR] = roads.measures[edge, SPEED_LIMIT], roads.elevator[edge]
            way[i, WAITS], way[i, TRAVELS] = roads.measures[edge, WAIT], roads.measures[edge, TRAVEL]
            way[i, FIXED] = roads.fixed[edge]
    return way


@kernel
def smoothed(world: Packed, way: Floats, radius: float) -> Floats:
    """The way with the corners of each of its drives cut."""
    ground, _ = unpack(world)
    count = way.shape[0]
    kept = np.empty(count, np.int64)
    size, at = 0, 0
    while at < count:
        end = at
        while end < count - 1 and way[end, ELEVATOR] < 0.0:
            end += 1
        floor = int(way[at, FLOOR])
        grid, lanes = floor_grid(ground, floor), floor_lanes(ground, floor)
        corners = cut_corners(grid, lanes, way[at : end + 1, X : Y + 1], way[at : end + 1, FIXED], radius)
        for corner in corners:
            kept[size] = at + corner
            size += 1
        at = end + 1
    left = _rows(way, kept, size)
    for k in range(size - 1):
        if kept[k + 1] != kept[k] + 1:
            left[k, LIMIT] = np.inf
    return _without_straight_stops(left)


@kernel
def _rows(way: Floats, kept: Longs, size: int) -> Floats:
    """The first `size` of the rows kept."""
    left = np.empty((size, COLUMNS))
    for k in range(size):
        for column in range(COLUMNS):
            left[k, column] = way[kept[k], column]
    return left


@kernel
def _without_straight_stops(way: Floats) -> Floats:
    """The way without the stops at which a drive neither turns nor changes its limit."""
    count = way.shape[0]
    kept = np.empty(count, np.int64)
    size = 0
    for i in range(count):
        if 0 < i < count - 1 and way[i, ELEVATOR] < 0.0 and way[i - 1, ELEVATOR] < 0.0:
            before = kept[size - 1]
            ax, ay = way[i, X] - way[before, X], way[i, Y] - way[before, Y]
            bx, by = way[i + 1, X] - way[i, X], way[i + 1, Y] - way[i, Y]
            straight = abs(ax * by - ay * bx) <= TOUCH_M * (math.hypot(ax, ay) + math.hypot(bx, by))
            if straight and ax * bx + ay * by >= 0.0 and way[i, LIMIT] == way[before, LIMIT]:
                continue
        kept[size] = i
        size += 1
    return _rows(way, kept, size)
