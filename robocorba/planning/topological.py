"""Ways along the topological map, with corners cut and roads left where that is asked for and allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.planning import geometric
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from robocorba.planning.route import ELEVATOR, FLOOR, LIMIT, NODE, X, Y, waypoints
from robocorba.planning.search import (
    FOUND,
    GOAL_NOT_FREE,
    MOST_JOINTS,
    START_NOT_FREE,
    find_way,
    joints,
    joints_of_each,
    longest_free,
    smoothed,
)
from robocorba.planning.snapshot import Snapshot
from robocorba.planning.world import floor_grid, floor_lanes, unpack
from robocorba.spatial.grids import Floats, Longs
from robocorba.spatial.pose import XY

#: An alternative may use an edge of a better path again, but as if it were so much longer.
DETOUR_FACTOR = 1.6
#: A place without a usable node in sight is tied around corners to nodes among this many nearest ones, and where none
#: of them can be reached among this many.
NEAR_NODES, MORE_NODES = 8, 256
#: Components of the road map that such a place is tied to at most, the nearest first.
MOST_COMPONENTS = 32


NO_CORNERS: Floats = np.empty((0, 2))


class Tie:
    """How a place is tied to the road map: nodes, how far each is (m), and the corners on the way to it."""

    def __init__(self, nodes: Sequence[int], lengths: Sequence[float], ways: Sequence[Floats] = ()) -> None:
        self.nodes, self.lengths = np.array(nodes, np.int64), np.array(lengths, float)
        self._corners = dict(zip(nodes, ways, strict=False))

    def corners(self, node: int) -> Floats:
        """Corners (k, 2) between the place and one of the nodes, in driving order."""
        return self._corners.get(node, NO_CORNERS)


#: What is looked up by the search itself: the nearest nodes in sight.
IN_SIGHT = Tie((), ())


def ways(snapshot: Snapshot, request: PathRequest, deadline: float) -> list[Floats]:
    """The best way and the alternatives asked for, in the order found; empty where there is none."""
    smooth = request.mode is RouteMode.SMOOTHED
    factor = snapshot.factor(request.avoid_elevators, request.graph)
    best = _find(snapshot, request, factor, deadline, smooth=smooth, straight=smooth)
    if best is None:
        leaves_roads = smooth and not request.graph
        return _through_free_space(snapshot, request, deadline) if leaves_roads else []
    if not request.alternatives:
        return [best]
    found: dict[tuple[float, ...], Floats] = {}
    factor = factor.copy() if len(factor) else np.ones(len(snapshot.roads.roads.to))
    for _ in range(1 + 3 * request.alternatives):
        along = _find(snapshot, request, factor, deadline, smooth=False)
        way = _find(snapshot, request, factor, deadline, smooth=True) if smooth else along
        if along is None or way is None:
            break
        found.setdefault(tuple(way[:, [FLOOR, X, Y, NODE]].ravel()), way)
        if len(found) > request.alternatives:
            break
        _make_dearer(snapshot, factor, along[1:-1, NODE].astype(np.int64).tolist())
    return list(found.values())


def _through_free_space(snapshot: Snapshot, request: PathRequest, deadline: float) -> list[Floats]:
    """The best way and alternatives where the road map has none. One-way edges are obeyed: no drive runs against one,
    or else, since ways turn at walls only, all keep clear of them."""
    found = geometric.ways(snapshot, request, deadline, obey_one_way=True)
    if found or not any(len(part.lanes) for part in snapshot.roads.parts.values()):
        return found
    return geometric.ways(snapshot.with_one_way_edges_closed(), request, deadline)


def _find(
    snapshot: Snapshot, request: PathRequest, factor: Floats, deadline: float, *, smooth: bool, straight: bool = False
) -> Floats | None:
    """The cheapest way, None without one.

    Ends are tied to the nearest nodes in sight. Where these lead nowhere, to each component of the road map that is in
    sight, and then to those around corners."""
    roads, start, goal, radius = snapshot.roads, request.start, request.goal, request.radius
    pace = request.speed if request.best is Criterion.SHORTEST_TIME else 0.0
    guide = snapshot.guide_for(pace, radius, request.avoid_elevators)
    origin = (roads.floor_index[start.floor], start.x, start.y)
    target = (roads.floor_index[goal.floor], goal.x, goal.y)
    begin = end = IN_SIGHT
    for attempt in range(3):
        if attempt == 1:
            begin = in_sight(snapshot, request, start, outbound=True)
            end = in_sight(snapshot, request, goal, outbound=False)
        elif attempt == 2:
            begin = _joined(begin, around_corners(snapshot, request, start, True, deadline))
            end = _joined(end, around_corners(snapshot, request, goal, False, deadline))
        if attempt and not (len(begin.nodes) and len(end.nodes)):
            continue
        ends = (origin, begin.nodes, begin.lengths, target, end.nodes, end.lengths)
        status, way = find_way(snapshot.world, guide, *ends, radius, pace, straight, factor)
        if status == FOUND:
            way = _with_corners(way, begin.corners(int(way[1, NODE])), end.corners(int(way[-2, NODE])))
            break
        if status in (START_NOT_FREE, GOAL_NOT_FREE):
            return None
    else:
        return None
    if not smooth:
        return way
    way = smoothed(snapshot.world, way, radius)
    return way if request.graph else without_detours(snapshot, request, way, deadline)


def _with_corners(way: Floats, lead: Floats, tail: Floats) -> Floats:
    """The way with the corners between its ends and the map."""
    return np.concatenate(
        [way[:1], waypoints(way[0, FLOOR], lead), way[1:-1], waypoints(way[-1, FLOOR], tail), way[-1:]]
    )


def without_detours(snapshot: Snapshot, request: PathRequest, way: Floats, deadline: float) -> Floats:
    """The way with each drive replaced by the way through free space where that is so much shorter (see search.DETOUR).

    One-way edges are obeyed in free space as well."""
    floors = snapshot.roads.floors
    parts: list[Floats] = []
    at = 0
    for i in range(len(way)):
        if i + 1 < len(way) and way[i, ELEVATOR] < 0.0:
            continue
        drive = way[at : i + 1]
        longest_m = longest_free(snapshot.world, way, at, i)
        if longest_m > 0.0:
            floor = floors[int(way[i, FLOOR])]
            a, b = (float(way[at, X]), float(way[at, Y])), (float(way[i, X]), float(way[i, Y]))
            leg = snapshot.graph(floor, request.radius).legs(
                a, [b], longest_m=longest_m, lanes=snapshot.roads.parts[floor].lanes, deadline=deadline
            )[0]
            if math.isfinite(leg.length) and not _is_slower(request, drive, leg.length):
                first = drive[:1].copy()
                first[0, LIMIT] = math.inf
                drive = np.concatenate([first, waypoints(way[i, FLOOR], leg.points[1:-1]), drive[-1:]])
        parts.append(drive)
        at = i + 1
    return np.concatenate(parts)


def _is_slower(request: PathRequest, drive: Floats, length_m: float) -> bool:
    """Whether a drive of that length through free space takes longer than one along the map, where that matters."""
    if request.best is not Criterion.SHORTEST_TIME:
        return False
    steps = np.hypot(*np.diff(drive[:, [X, Y]], axis=0).T)
    return length_m / request.speed > float((steps / np.minimum(drive[:-1, LIMIT], request.speed)).sum())


def in_sight(snapshot: Snapshot, request: PathRequest, place: Place, outbound: bool) -> Tie:
    """The nearest nodes in straight sight of a place, and the nearest one of each component of the road map."""
    ground, roads = unpack(snapshot.world)
    floor = snapshot.roads.floor_index[place.floor]
    low, high = int(ground.first_node[floor]), int(ground.first_node[floor + 1])
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    grid, lanes = floor_grid(ground, floor), floor_lanes(ground, floor)
    near = joints(grid, lanes, roads.xy, low, high, *place[1:], request.radius, outbound)
    each = joints_of_each(grid, lanes, roads.xy, low, high, component, *place[1:], request.radius, outbound)
    found = dict(zip(each[0].tolist(), each[1].tolist(), strict=True))
    found.update(zip(near[0].tolist(), near[1].tolist(), strict=True))
    return Tie(list(found), list(found.values()))


def around_corners(snapshot: Snapshot, request: PathRequest, place: Place, outbound: bool, deadline: float) -> Tie:
    """Tie a free place to the nearest nodes, and to the nearest of each component of the road map, around corners;
    outbound: drives lead away from it."""
    roads, space = snapshot.roads, snapshot.spaces[place.floor]
    floor = roads.floor_index[place.floor]
    low, high = int(roads.offset[floor]), int(roads.offset[floor + 1])
    xy = roads.roads.xy
    order = low + np.argsort(np.hypot(xy[low:high, 0] - place.x, xy[low:high, 1] - place.y), kind="stable")
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    graph = snapshot.graph(place.floor, request.radius)
    lanes = roads.parts[place.floor].lanes
    if not len(order):
        return IN_SIGHT
    for near_by in (_nearest(order, component), order[NEAR_NODES:MORE_NODES]):
        nodes = [
            int(node) for node in near_by if space.stands_free(float(xy[node, 0]), float(xy[node, 1]), request.radius)
        ]
        targets: list[XY] = [(float(xy[node, 0]), float(xy[node, 1])) for node in nodes]
        legs = graph.legs(place[1:], targets, lanes=lanes, outbound=outbound, deadline=deadline)
        near = sorted((leg.length, i) for i, leg in enumerate(legs) if math.isfinite(leg.length))
        if near:
            break
    else:
        return IN_SIGHT
    seen = set(component[[nodes[i] for _, i in near[:MOST_JOINTS]]].tolist())
    kept = near[:MOST_JOINTS] + [item for item in near[MOST_JOINTS:] if not _seen(seen, int(component[nodes[item[1]]]))]
    corners = [legs[i].points[1:-1] if outbound else legs[i].points[1:-1][::-1] for _, i in kept]
    return Tie([nodes[i] for _, i in kept], [length for length, _ in kept], corners)


def _nearest(order: Longs, component: Longs) -> list[int]:
    """The nearest nodes and the nearest one of each component, from nodes in the order of their distance."""
    first = np.unique(component[order], return_index=True)[1]
    of_each = order[np.sort(first)[:MOST_COMPONENTS]]
    return list(dict.fromkeys([*order[:NEAR_NODES].tolist(), *of_each.tolist()]))


def _seen(seen: set[int], number: int) -> bool:
    """Whether a number was there; it is from now on."""
    known = number in seen
    seen.add(number)
    return known


def _joined(straight: Tie, around: Tie) -> Tie:
    """Both ties; what is in sight comes straight."""
    nodes = [node for node in around.nodes.tolist() if node not in set(straight.nodes.tolist())]
    lengths = dict(zip(around.nodes.tolist(), around.lengths.tolist(), strict=True))
    return Tie(
        [*straight.nodes.tolist(), *nodes],
        [*straight.lengths.tolist(), *(lengths[node] for node in nodes)],
        [*(NO_CORNERS for _ in straight.nodes), *(around.corners(node) for node in nodes)],
    )


def _make_dearer(snapshot: Snapshot, factor: Floats, nodes: list[int]) -> None:
    """Let the next search shun the edges between these nodes, both ways."""
    roads = snapshot.roads.roads
    on_way = set(nodes)
    for node in nodes[1:-1]:
        for edge in range(roads.first[node], roads.first[node + 1]):
            if int(roads.to[edge]) in on_way:
                factor[edge] *= DETOUR_FACTOR
