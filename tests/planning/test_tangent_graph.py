"""Shortest ways through free space, beside a tangent graph that looks at every pair of vertices with shapely."""

from __future__ import annotations

import math
import threading
import time
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
import shapely
from shapely import LineString

from robocorba.errors.paths import PlanningTimeout
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_graph import TangentGraph
from robocorba.spatial.pose import XY
from tests.planning.reference import random_places
from tests.planning.scenes import random_room, room, wall

#: Rounding that the reference forgives, m.
FORGIVEN_M = 1e-7


class EveryTangent:
    """All circles around all vertices of a floor, all lines that touch two of them and are free, all arcs between."""

    def __init__(self, building: Building, radius: float) -> None:
        self.radius = radius
        self.blocked = shapely.union_all([item.geometry for item in obstacles(building, "L1")])
        shapely.prepare(self.blocked)
        self.vertices = np.unique(shapely.get_coordinates(self.blocked), axis=0)
        circles = [(i, turn) for i in range(len(self.vertices)) for turn in (1, -1)]
        self.lines = self._free_lines(circles, circles)

    def length(self, start: XY, goal: XY) -> float:
        """Length of the shortest way, inf without one."""
        if self._is_free(np.array([[start, goal]]))[0]:
            return math.dist(start, goal)
        ends = np.array([start, goal])
        circles = [(i, turn) for i in range(len(self.vertices)) for turn in (1, -1)]
        first = self._free_lines([(start, 0)], circles)
        last = self._free_lines(circles, [(goal, 0)])
        graph = nx.DiGraph()
        arrivals: dict[tuple[int, int], list[tuple[float, object]]] = {}
        departures: dict[tuple[int, int], list[tuple[float, object]]] = {}
        for number, (here, there, leave, arrive, length) in enumerate([*first, *self.lines, *last]):
            begin = ("start",) if here[1] == 0 else ("out", number)
            end = ("goal",) if there[1] == 0 else ("in", number)
            graph.add_edge(begin, end, weight=length)
            if here[1]:
                departures.setdefault(here, []).append((leave, begin))
            if there[1]:
                arrivals.setdefault(there, []).append((arrive, end))
        for circle, came in arrivals.items():
            vertex, turn = circle
            for angle, arrival in came:
                for other, departure in departures.get(circle, ()):
                    turned = (turn * (other - angle)) % (2 * math.pi)
                    turned = 0.0 if turned > 2 * math.pi - 1e-9 else turned
                    if turned <= math.pi + 1e-9 and self._arc_is_free(vertex, angle, turn * turned):
                        graph.add_edge(arrival, departure, weight=self.radius * turned)
        del ends
        try:
            return nx.dijkstra_path_length(graph, ("start",), ("goal",))
        except (nx.NetworkXNoPath, nx.NodeNotFound):
            return math.inf

    def _free_lines(self, here: list, there: list) -> list[tuple]:
        """(circle here, circle there, angle here, angle there, length) of all lines that are free."""
        found, ends = [], []
        for a in here:
            for b in there:
                p = np.array(a[0]) if a[1] == 0 else self.vertices[a[0]]
                q = np.array(b[0]) if b[1] == 0 else self.vertices[b[0]]
                apart = math.dist(p, q)
                offset = (a[1] - b[1]) * self.radius
                if apart < 1e-12 or abs(offset) > apart:
                    continue
                heading = math.atan2(q[1] - p[1], q[0] - p[0]) + math.asin(offset / apart)
                leave, arrive = heading - a[1] * math.pi / 2, heading - b[1] * math.pi / 2
                begin = p + abs(a[1]) * self.radius * np.array([math.cos(leave), math.sin(leave)])
                end = q + abs(b[1]) * self.radius * np.array([math.cos(arrive), math.sin(arrive)])
                found.append((a, b, leave, arrive, math.dist(begin, end)))
                ends.append((begin, end))
        free = self._is_free(np.array(ends).reshape(-1, 2, 2))
        return [line for line, keep in zip(found, free, strict=True) if keep]

    def _is_free(self, ends: np.ndarray) -> np.ndarray:
        return shapely.distance(shapely.linestrings(ends), self.blocked) >= self.radius - FORGIVEN_M

    def _arc_is_free(self, vertex: int, begin: float, turned: float) -> bool:
        angles = begin + np.linspace(0, turned, 2 + int(abs(turned) * 60))
        places = self.vertices[vertex] + self.radius * np.column_stack([np.cos(angles), np.sin(angles)])
        return bool((shapely.distance(shapely.points(places), self.blocked) >= self.radius - FORGIVEN_M).all())


def way_faults(space: FloorSpace, points: np.ndarray, radius: float) -> list[tuple[XY, XY]]:
    """The drives that come nearer to something than the radius, by shapely."""
    blocked = shapely.union_all([item.geometry for item in space.owners])
    return [(a, b) for a, b in pairwise(points) if LineString([a, b]).distance(blocked) < radius - 1e-6]


@pytest.mark.parametrize("seed", range(6))
def test_no_way_is_shorter(seed: int) -> None:
    building, radius = random_room(seed, 4), 0.4
    space, reference = FloorSpace(building, "L1"), EveryTangent(building, radius)
    graph = TangentGraph(space, radius)
    places = random_places(building, radius, 16, seed)
    for start, goal in zip(places[::2], places[1::2], strict=True):
        (leg,) = graph.legs(start[1:], [goal[1:]])
        assert leg.length == pytest.approx(reference.length(start[1:], goal[1:]), abs=1e-6)
        if len(leg.points):
            assert way_faults(space, leg.points, radius) == []
            driven = sum(math.dist(a, b) for a, b in pairwise(leg.points))
            assert leg.length - 1e-9 <= driven <= 1.0034 * leg.length


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.7])
def test_one_triangulation_serves_all_radii(radius: float) -> None:
    building = random_room(3, 8)
    space = FloorSpace(building, "L1")
    graph = TangentGraph(space, radius)
    back_and_forth = random_places(building, max(radius, 0.05), 30, 8)
    for start, goal in zip(back_and_forth[::2], back_and_forth[1::2], strict=True):
        there, back = graph.legs(start[1:], [goal[1:]])[0], graph.legs(goal[1:], [start[1:]])[0]
        assert there.length == pytest.approx(back.length, abs=1e-9)
        assert way_faults(space, there.points, radius) == []


def test_several_targets_get_what_each_gets_alone() -> None:
    building = random_room(5, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), 0.3)
    origin, *targets = (place[1:] for place in random_places(building, 0.3, 25, 2))
    together = graph.legs(origin, targets)
    assert [leg.length for leg in together] == pytest.approx([graph.legs(origin, [t])[0].length for t in targets])
    nearest = sorted(leg.length for leg in together)[:3]
    assert sorted(leg.length for leg in graph.legs(origin, targets, enough=3))[:3] == pytest.approx(nearest)


def test_ways_longer_than_asked_for_are_not_found() -> None:
    graph = TangentGraph(FloorSpace(room(10.0, 6.0, wall("w", 5.0, 0.0, 5.0, 5.0)), "L1"), 0.4)
    (leg,) = graph.legs((4.0, 1.0), [(6.0, 1.0)])
    assert math.isfinite(graph.legs((4.0, 1.0), [(6.0, 1.0)], max_length_m=leg.length + 1e-6)[0].length)
    assert math.isinf(graph.legs((4.0, 1.0), [(6.0, 1.0)], max_length_m=leg.length - 1e-6)[0].length)


def test_walls_that_cross_block() -> None:
    """Where walls cross there is no vertex of the map."""
    crossed = [wall("a", 0.0, 2.0, 9.0, 4.0), wall("b", 0.0, 4.0, 9.0, 2.0), wall("c", 6.0, 0.0, 6.0, 5.0)]
    building = room(10.0, 6.0, *crossed)
    space, reference = FloorSpace(building, "L1"), EveryTangent(building, 0.3)
    graph = TangentGraph(space, 0.3)
    for goal in ((9.5, 3.0), (3.0, 1.0), (3.0, 5.0), (7.0, 4.5)):
        (leg,) = graph.legs((0.6, 3.0), [goal])
        assert leg.length == pytest.approx(reference.length((0.6, 3.0), goal), abs=1e-6)


def test_a_search_ends_at_its_deadline() -> None:
    graph = TangentGraph(FloorSpace(random_room(1, 8), "L1"), 0.4)
    with graph._lock:  # another search is under way
        began = time.monotonic()
        with pytest.raises(PlanningTimeout):
            graph.legs((1.0, 1.0), [(11.0, 8.0)], deadline=began + 0.05)
    assert len(graph.legs((1.0, 1.0), [(11.0, 8.0)])[0].points)


def test_threads_share_a_graph() -> None:
    building = random_room(2, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), 0.3)
    places = [place[1:] for place in random_places(building, 0.3, 40, 4)]
    alone = TangentGraph(graph.space, 0.3)
    expected = [alone.legs(a, [b])[0].length for a, b in pairwise(places)]
    found: dict[int, list[float]] = {}

    def ask(number: int) -> None:
        found[number] = [graph.legs(a, [b])[0].length for a, b in pairwise(places)]

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(found[i] == pytest.approx(expected) for i in range(4))
