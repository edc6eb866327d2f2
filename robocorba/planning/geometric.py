"""Shortest routes of a round robot through free space, over elevators where necessary."""

from __future__ import annotations

import heapq
import math
from itertools import combinations, pairwise

import numpy as np

from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.elevators import RideEstimate, ride
from robocorba.planning.request import Criterion, PathRequest
from robocorba.planning.road_rules import NO_LANES
from robocorba.planning.roads import SAME_PLACE_M
from robocorba.planning.route import ELEVATOR, NODE, TRAVELS, WAITS, waypoints
from robocorba.planning.snapshot import BuildingSnapshot
from robocorba.planning.tangent_graph import DriveLeg
from robocorba.planning.turns import Turn

#: A vertex of the search: a floor, the elevator whose cabin is there or " start" or " goal", and the number of the
#: place in the cabin.
_Stop = tuple[str, str, int]


def routes(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn, obey_rules: bool = False) -> list[Floats]:
    """The shortest route and, as alternatives, those by other elevators; empty if there is none. Drives obey the
    rules of edges only with `obey_rules`."""
    for place in (request.start, request.goal):
        if not snapshot.spaces[place.floor].point_is_free(place.x, place.y, request.radius):
            return []
    best = _find_route(snapshot, request, request.avoid_elevators, turn, obey_rules)
    if best is None:
        return []
    used = _elevators(snapshot, best)
    found, seen = [best], {used}
    for count in range(1, len(used) + 1):
        for avoided in combinations(sorted(used), count):
            if len(found) > request.alternatives:
                return found
            other = _find_route(snapshot, request, request.avoid_elevators | set(avoided), turn, obey_rules)
            if other is not None and _elevators(snapshot, other) not in seen:
                seen.add(_elevators(snapshot, other))
                found.append(other)
    return found


def _elevators(snapshot: BuildingSnapshot, route: Floats) -> frozenset[str]:
    return frozenset(snapshot.roads.elevators[int(index)] for index in route[:, ELEVATOR] if index >= 0)


def _find_route(
    snapshot: BuildingSnapshot, request: PathRequest, avoid: frozenset[str], turn: Turn, obey_rules: bool
) -> Floats | None:
    """Dijkstra over start, cabins and goal. Drives between them are planned when the search needs them."""
    start, goal = request.start, request.goal
    by_time = request.best is Criterion.SHORTEST_TIME
    metres_per_cost = request.speed if by_time else 1.0
    origin, destination = (start.floor, " start", 0), (goal.floor, " goal", 0)
    at: dict[_Stop, XY] = _cabins(snapshot, request.radius, avoid)
    cabins = list(at)
    at |= {origin: start[1:], destination: goal[1:]}

    cost = {origin: 0.0}
    parents: dict[_Stop, tuple[_Stop, DriveLeg | None]] = {}
    done: set[_Stop] = set()
    queue = [(0.0, origin)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if here in done:
            continue
        done.add(here)
        if here == destination:
            return _assemble(snapshot, at, parents, origin, destination)
        steps: list[tuple[_Stop, float, DriveLeg | None]]
        if here != origin and parents[here][1] is not None:  # the robot drove into a cabin: it rides next
            steps = [
                (stop, _cost(_ride(snapshot.building, here, stop), by_time), None)
                for stop in cabins
                if stop[1:] == here[1:] and stop not in done
            ]
        else:
            targets = [stop for stop in at if stop[0] == here[0] and stop not in done]
            lanes = snapshot.lanes(here[0]) if obey_rules else NO_LANES
            legs = snapshot.graph(here[0], request.radius).legs(
                at[here], [at[stop] for stop in targets], lanes=lanes, turn=turn
            )
            steps = [(stop, leg.length / metres_per_cost, leg) for stop, leg in zip(targets, legs, strict=True)]
        for stop, step, leg in steps:
            if so_far + step < cost.get(stop, math.inf):
                cost[stop] = so_far + step
                parents[stop] = (here, leg)
                heapq.heappush(queue, (cost[stop], stop))
    return None


def _cabins(snapshot: BuildingSnapshot, radius: float, avoid: frozenset[str]) -> dict[_Stop, XY]:
    """The places of a robot in each cabin on each floor served: those of the nodes in the cabin on any floor, else its
    centre. A ride does not change the place."""
    found: dict[_Stop, XY] = {}
    stops: dict[str, list[XY]] = {}
    for entry in snapshot.building.floors.values():
        for node in entry.topological.nodes.values():
            places = stops.setdefault(node.elevator, []) if node.elevator else []
            if node.elevator and all(math.dist(node.at, place) >= SAME_PLACE_M for place in places):
                places.append(node.at)
    for name, elevator in snapshot.building.elevators.items():
        if name in avoid:
            continue
        for floor in elevator.floors():
            for number, place in enumerate(stops.get(name) or [elevator.at]):
                if snapshot.spaces[floor].point_is_free(*place, radius):
                    found[floor, name, number] = place
    return found


def _ride(building: Building, here: _Stop, there: _Stop) -> RideEstimate:
    return ride(building, building.elevators[here[1]], here[0], there[0])


def _cost(estimate: RideEstimate, by_time: bool) -> float:
    return estimate.wait + estimate.travel if by_time else estimate.climb


def _assemble(
    snapshot: BuildingSnapshot,
    at: dict[_Stop, XY],
    parents: dict[_Stop, tuple[_Stop, DriveLeg | None]],
    origin: _Stop,
    destination: _Stop,
) -> Floats:
    """The rows of the route; see route.py."""
    stops = [destination]
    while stops[-1] != origin:
        stops.append(parents[stops[-1]][0])
    roads = snapshot.roads
    parts: list[Floats] = []
    for here, there in pairwise(reversed(stops)):
        floor, node, leg = roads.floor_index[here[0]], _node(snapshot, here, at[here]), parents[there][1]
        if leg is None:
            wait, travel, _ = _ride(snapshot.building, here, there)
            rows = waypoints(floor, np.array([at[here]], float))
            rows[0, [ELEVATOR, WAITS, TRAVELS]] = roads.elevators.index(here[1]), wait, travel
        else:
            rows = waypoints(floor, leg.points[:-1])
        rows[0, NODE] = node
        parts.append(rows)
    parts.append(waypoints(roads.floor_index[destination[0]], np.array([at[destination]], float)))
    return np.concatenate(parts)


def _node(snapshot: BuildingSnapshot, stop: _Stop, at: XY) -> int:
    """Index of the node in a cabin at this place, -1 if there is none."""
    roads, (floor, elevator, _) = snapshot.roads, stop
    part, shift = roads.parts[floor], int(roads.offset[roads.floor_index[floor]])
    here = (node for node, name in part.cabins if name == elevator and math.dist(part.xy[node], at) < SAME_PLACE_M)
    return next((shift + node for node in here), -1)
