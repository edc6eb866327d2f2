"""Ways along the topological map, with corners cut where that is asked for and allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from robocorba.grids import Floats
from robocorba.maps.model import XY
from robocorba.planning.freeway import Freeways
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from robocorba.planning.route import COLUMNS, FLOOR, NODE, measure
from robocorba.planning.search import (
    FOUND,
    GOAL_SEES_NO_NODE,
    MOST_JOINTS,
    START_SEES_NO_NODE,
    find_way,
)
from robocorba.planning.snapshot import Snapshot

#: An alternative may use an edge of a better path again, but as if it were so much longer.
DETOUR_FACTOR = 1.6
#: A place without a node in sight is tied around corners to the nearest of so many nodes, by ways that go no
#: farther than this beyond them, m; if there are none, to the nearest of so many more, by ways as far as need be.
DETOURS = ((8, 2.0), (256, 0.0))


class Tie:
    """How a place that sees no node is tied to the road map: nodes, how far each is (m), the corners on the way."""

    def __init__(self, nodes: Sequence[int] = (), lengths: Sequence[float] = (), ways: Sequence[list[XY]] = ()) -> None:
        self.nodes, self.lengths = np.array(nodes, np.int64), np.array(lengths, float)
        self._corners = dict(zip(nodes, ways, strict=True))

    def corners(self, node: int) -> list[XY]:
        """Corners between the place and one of the nodes, in driving order."""
        return self._corners.get(node, [])


IN_SIGHT = Tie()


def ways(snapshot: Snapshot, request: PathRequest) -> list[Floats]:
    """The points of the best way and the alternatives asked for, in the order found; empty where there is none."""
    smooth = request.mode is RouteMode.SMOOTHED
    factor = snapshot.factor(request.avoid_elevators, request.graph)
    if not request.alternatives:
        best = _find(snapshot, request, factor, smooth, straight=smooth)
        return [] if best is None else [best]
    found: dict[tuple[float, ...], Floats] = {}
    factor = factor.copy() if len(factor) else np.ones(len(snapshot.roads.roads.to))
    for _ in range(1 + 3 * request.alternatives):
        along = _find(snapshot, request, factor, False)
        way = _find(snapshot, request, factor, True) if smooth else along
        if along is None or way is None:
            break
        found.setdefault(tuple(way[:, 1:5].ravel()), way)
        if len(found) > request.alternatives:
            break
        _make_dearer(snapshot, factor, along[1:-1, 1].astype(np.int64).tolist())
    return list(found.values())


def _find(
    snapshot: Snapshot, request: PathRequest, factor: Floats, smooth: bool, straight: bool = False
) -> Floats | None:
    """The points of the cheapest way, None without one; ends that see no node are tied to the map around corners."""
    roads, start, goal, radius = snapshot.roads, request.start, request.goal, request.radius
    pace = request.speed if request.best is Criterion.SHORTEST_TIME else 0.0
    guide = snapshot.guide_for(pace, radius, request.avoid_elevators)
    origin = (roads.floor_index[start.floor], start.x, start.y)
    target = (roads.floor_index[goal.floor], goal.x, goal.y)
    begin = end = IN_SIGHT
    while True:
        ends = (origin, begin.nodes, begin.lengths, target, end.nodes, end.lengths)
        status, way = find_way(snapshot.world, guide, *ends, radius, pace, smooth, straight, factor)
        if status == START_SEES_NO_NODE and begin is IN_SIGHT:
            begin = around_corners(snapshot, start, radius, outbound=True)
        elif status == GOAL_SEES_NO_NODE and end is IN_SIGHT:
            end = around_corners(snapshot, goal, radius, outbound=False)
        else:
            break
    if status != FOUND:
        return None
    way = _with_corners(way, begin.corners(int(way[1, NODE])), end.corners(int(way[-2, NODE])))
    return measure(way, roads.elevations, request.speed)


def _with_corners(way: Floats, lead: list[XY], tail: list[XY]) -> Floats:
    """The way with the corners between its ends and the map."""

    def rows(floor: float, corners: list[XY]) -> Floats:
        return np.array([(floor, *corner, -1, -1, math.inf, 0, 0) for corner in corners], float).reshape(-1, COLUMNS)

    first, last = way[0, FLOOR], way[-1, FLOOR]
    return np.concatenate([way[:1], rows(first, lead), way[1:-1], rows(last, tail), way[-1:]])


def around_corners(snapshot: Snapshot, place: Place, radius: float, outbound: bool) -> Tie:
    """Tie a free place that sees no node to the nearest nodes around corners; outbound: drives lead away from it."""
    roads, space = snapshot.roads, snapshot.spaces[place.floor]
    floor = roads.floor_index[place.floor]
    low, high = int(roads.offset[floor]), int(roads.offset[floor + 1])
    xy = roads.roads.xy
    order = low + np.argsort(np.hypot(xy[low:high, 0] - place.x, xy[low:high, 1] - place.y), kind="stable")
    lanes = roads.parts[place.floor].lanes
    if not outbound:  # what is driven towards the place is found from the place, with all one-way edges turned round
        lanes = np.ascontiguousarray(lanes[:, [2, 3, 0, 1]])
    for most, reach in DETOURS:
        near_by = [(int(node), *xy[node].tolist()) for node in order[:most]]
        targets = {node: (x, y) for node, x, y in near_by if space.stands_free(x, y, radius)}
        nodes, ends = list(targets), np.array([place[1:], *targets.values()])
        window = shapely.box(*(ends.min(axis=0) - reach), *(ends.max(axis=0) + reach)) if reach else None
        freeways = Freeways(space, lanes, radius, window)
        legs = freeways.legs(place[1:], list(targets.values()), enough=MOST_JOINTS)
        if any(math.isfinite(leg.length) for leg in legs):
            break
    near = sorted((leg.length, i) for i, leg in enumerate(legs) if math.isfinite(leg.length))[:MOST_JOINTS]
    corners = [legs[i].points[1:-1] if outbound else legs[i].points[-2:0:-1] for _, i in near]
    return Tie([nodes[i] for _, i in near], [length for length, _ in near], corners)


def _make_dearer(snapshot: Snapshot, factor: Floats, nodes: list[int]) -> None:
    """Let the next search shun the edges between these nodes, both ways."""
    roads = snapshot.roads.roads
    on_way = set(nodes)
    for node in nodes[1:-1]:
        for edge in range(roads.first[node], roads.first[node + 1]):
            if int(roads.to[edge]) in on_way:
                factor[edge] *= DETOUR_FACTOR
