"""Admissible heuristics of the route search: least costs between elevators and, in small buildings, all costs."""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.planning.packing import Packed, pack
from robocorba.planning.roads import CLEARANCE, DRIVEN, LENGTH, SPEED_LIMIT, TRAVEL, WAIT, RoadMap, RoadmapArrays
from robocorba.planning.space import TOUCH_M
from robocorba.system.kernels import inner_kernel, kernel

#: Maximum number of nodes of a building that gets a table of all costs for the robot of getPath.
MAX_TABLE_NODES = 400
#: Value of `speed_m_s` with which costs are metres instead of seconds.
COST_IN_METRES = 0.0


class HeuristicTables(NamedTuple):
    """Lower bounds of costs for one speed and radius. `node` (c,) are the nodes in elevator cabins, those of floor f
    at start[f]:start[f + 1]; bound (c, c) is the least cost between two of them. cost (n, n) is the cost between any
    two nodes and edge (n, n) the first edge of that route; both are empty without a table."""

    node: Longs
    start: Longs
    bound: Floats
    cost: Floats
    edge: Longs


def make_heuristics(
    road_map: RoadMap, speed_m_s: float, avoid: frozenset[str] = frozenset(), radius: float | None = None
) -> Packed:
    """Heuristics for costs in seconds at `speed_m_s`, or in metres with COST_IN_METRES, without the elevators
    `avoid`. With `radius` [m] and a building of at most MAX_TABLE_NODES nodes they include the table of all costs."""
    roads, elevators = road_map.roads, road_map.elevators
    rides = np.flatnonzero(roads.elevator >= 0)
    rides = rides[[elevators[e] not in avoid for e in roads.elevator[rides].tolist()]]
    origins = np.searchsorted(roads.first, rides, side="right") - 1
    node = np.unique(np.concatenate([origins, roads.to[rides]]))
    start = np.searchsorted(roads.floor[node], np.arange(len(road_map.floors) + 1))
    offset = roads.xy[node, None] - roads.xy[None, node]
    direct = np.hypot(offset[..., 0], offset[..., 1]) / (1.0 if speed_m_s == COST_IN_METRES else speed_m_s)
    bound = np.where(roads.floor[node, None] == roads.floor[None, node], direct, np.inf)
    measures = roads.measures[rides]
    costs = measures[:, LENGTH]
    if speed_m_s != COST_IN_METRES:
        costs = measures[:, WAIT] + measures[:, TRAVEL] + np.abs(measures[:, DRIVEN]) / speed_m_s
    np.minimum.at(bound, (np.searchsorted(node, origins), np.searchsorted(node, roads.to[rides])), costs)
    for k in range(len(node)):
        np.minimum(bound, bound[:, k, None] + bound[None, k, :], out=bound)
    bound = np.maximum(bound - 1e-9, 0.0)  # rounding must not raise a bound above the true cost
    if radius is None or len(roads.xy) > MAX_TABLE_NODES:
        return pack([bound, np.empty(0)], [node, start, np.empty(0)])
    cost, edge = all_costs(roads, speed_m_s, radius)
    return pack([bound, cost], [node, start, edge])


@inner_kernel
def read_heuristics(heuristics: Packed, nodes: int) -> HeuristicTables:
    """Unpack heuristics for a roadmap with this number of nodes."""
    n, f = heuristics
    node, edge = n[n[3] : n[4]], n[n[5] : n[6]]
    cabins, in_table = node.shape[0], nodes if edge.shape[0] else 0
    bound, cost = f[n[0] : n[1]].reshape(cabins, cabins), f[n[1] : n[2]].reshape(in_table, in_table)
    return HeuristicTables(node, n[n[4] : n[5]], bound, cost, edge.reshape(in_table, in_table))


@inner_kernel
def step_cost(roads: RoadmapArrays, edge: int, speed_m_s: float) -> float:
    """Cost of an edge: seconds at `speed_m_s`, or metres with COST_IN_METRES."""
    length = roads.measures[edge, LENGTH]
    if speed_m_s == COST_IN_METRES:
        return length
    if roads.elevator[edge] >= 0:
        measures = roads.measures[edge]
        return measures[WAIT] + measures[TRAVEL] + abs(measures[DRIVEN]) / speed_m_s
    return length / min(speed_m_s, roads.measures[edge, SPEED_LIMIT])


@inner_kernel
def continues_ride(roads: RoadmapArrays, via: int, edge: int) -> bool:
    """Whether an edge is a second ride in the elevator of the previous edge, which no route contains."""
    return via >= 0 and roads.elevator[edge] >= 0 and roads.elevator[via] == roads.elevator[edge]


@kernel
def all_costs(roads: RoadmapArrays, speed_m_s: float, radius: float) -> tuple[Floats, Longs]:
    """Dijkstra from every node: costs (n, n), inf where there is no route, and first edges (n, n)."""
    count = roads.xy.shape[0]
    cost = np.full((count, count), np.inf)
    first = np.full((count, count), -1, np.int64)
    via = np.empty(count, np.int64)
    done = np.empty(count, np.bool_)
    for source in range(count):
        row = cost[source]
        via[:] = -1
        done[:] = False
        row[source] = 0.0
        queue = [(0.0, source)]
        while queue:
            so_far, node = heapq.heappop(queue)
            if done[node]:
                continue
            done[node] = True
            for edge in range(roads.first[node], roads.first[node + 1]):
                if roads.measures[edge, CLEARANCE] < radius - TOUCH_M or continues_ride(roads, via[node], edge):
                    continue
                other = roads.to[edge]
                total = so_far + step_cost(roads, edge, speed_m_s)
                if total < row[other]:
                    row[other] = total
                    via[other] = edge
                    first[source, other] = edge if node == source else first[source, node]
                    heapq.heappush(queue, (total, other))
    return cost, first
