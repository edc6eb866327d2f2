"""What a search knows before it begins: least costs between elevators, and in small buildings all costs."""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np

from robocorba.kernels import kernel
from robocorba.planning.packing import Packed, numbers, pack, rows
from robocorba.planning.roads import CLEARANCE, LENGTH, SPEED_LIMIT, TRAVEL, WAIT, RoadMap, Roads
from robocorba.planning.space import TOUCH_M
from robocorba.spatial.grids import Floats, Longs

#: Buildings of at most so many nodes get a table of all costs for the robot that getPath plans for.
MOST_TABLED = 400


class Guide(NamedTuple):
    """For one pace and radius. `node` (c,) are the nodes in elevator cabins, those of floor f at start[f]:start[f + 1],
    and bound (c, c) what a way between two of them costs at least. cost (n, n) is what the way between any two nodes
    costs and edge (n, n) with which edge it begins; both are empty where there is no table."""

    node: Longs
    start: Longs
    bound: Floats
    cost: Floats
    edge: Longs


def make_guide(
    road_map: RoadMap, pace: float, avoid: frozenset[str] = frozenset(), radius: float | None = None
) -> Packed:
    """A guide for costs in seconds at `pace` m/s, or in metres where it is 0, without the elevators avoided;
    with the table of all costs for robots of `radius` where one is given and the building is small enough."""
    roads, elevators = road_map.roads, road_map.elevators
    rides = np.flatnonzero(roads.elevator >= 0)
    rides = rides[[elevators[e] not in avoid for e in roads.elevator[rides].tolist()]]
    origins = np.searchsorted(roads.first, rides, side="right") - 1
    node = np.unique(np.concatenate([origins, roads.to[rides]]))
    start = np.searchsorted(roads.floor[node], np.arange(len(road_map.floors) + 1))
    apart = roads.xy[node, None] - roads.xy[None, node]
    direct = np.hypot(apart[..., 0], apart[..., 1]) / (pace or 1.0)
    bound = np.where(roads.floor[node, None] == roads.floor[None, node], direct, np.inf)
    measures = roads.measures[rides]
    costs = measures[:, WAIT] + measures[:, TRAVEL] if pace else measures[:, LENGTH]
    np.minimum.at(bound, (np.searchsorted(node, origins), np.searchsorted(node, roads.to[rides])), costs)
    for k in range(len(node)):
        np.minimum(bound, bound[:, k, None] + bound[None, k, :], out=bound)
    bound = np.maximum(bound - 1e-9, 0.0)  # never above the true cost by rounding
    if radius is None or len(roads.xy) > MOST_TABLED:
        return pack([bound, np.empty(0)], [node, start, np.empty(0)])
    cost, edge = tabulate(roads, pace, radius)
    return pack([bound, cost], [node, start, edge])


@kernel
def read_guide(guide: Packed, nodes: int) -> Guide:
    """The parts of a guide for a road map of so many nodes."""
    node, edge = numbers(guide, 2), numbers(guide, 4)
    tabled = nodes if edge.shape[0] else 0
    return Guide(
        node, numbers(guide, 3), rows(guide, 0, node.shape[0]), rows(guide, 1, tabled), edge.reshape(tabled, tabled)
    )


@kernel
def step_cost(roads: Roads, edge: int, pace: float) -> float:
    """What an edge costs: seconds at `pace` m/s, or metres where it is 0."""
    length = roads.measures[edge, LENGTH]
    if pace == 0.0:
        return length
    if roads.elevator[edge] >= 0:
        return roads.measures[edge, WAIT] + roads.measures[edge, TRAVEL]
    return length / min(pace, roads.measures[edge, SPEED_LIMIT])


@kernel
def rides_on(roads: Roads, came_by: int, edge: int) -> bool:
    """Whether an edge rides on in the elevator that one has just come by: nobody gets off and on again."""
    return came_by >= 0 and roads.elevator[edge] >= 0 and roads.elevator[came_by] == roads.elevator[edge]


@kernel
def tabulate(roads: Roads, pace: float, radius: float) -> tuple[Floats, Longs]:
    """Dijkstra from every node: costs (n, n), inf where there is no way, and first edges (n, n)."""
    count = roads.xy.shape[0]
    cost = np.full((count, count), np.inf)
    first = np.full((count, count), -1, np.int64)
    came_by = np.empty(count, np.int64)
    done = np.empty(count, np.bool_)
    for source in range(count):
        row = cost[source]
        came_by[:] = -1
        done[:] = False
        row[source] = 0.0
        queue = [(0.0, source)]
        while queue:
            so_far, node = heapq.heappop(queue)
            if done[node]:
                continue
            done[node] = True
            for edge in range(roads.first[node], roads.first[node + 1]):
                if roads.measures[edge, CLEARANCE] < radius - TOUCH_M or rides_on(roads, came_by[node], edge):
                    continue
                other = roads.to[edge]
                total = so_far + step_cost(roads, edge, pace)
                if total < row[other]:
                    row[other] = total
                    came_by[other] = edge
                    first[source, other] = edge if node == source else first[source, node]
                    heapq.heappush(queue, (total, other))
    return cost, first
