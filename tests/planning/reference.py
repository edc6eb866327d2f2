"""What the planner is held against: networkx on the topological map, an exact visibility graph, shapely distances."""

from __future__ import annotations

import math
from itertools import combinations, permutations

import networkx as nx
import numpy as np
import shapely
from shapely import LineString, Point, Polygon

from robocorba.maps.geometry import free_space, obstacles
from robocorba.maps.model import Building
from robocorba.planning.elevators import ride
from robocorba.planning.request import Place

JOINTS = 8


class Reference:
    """The cheapest way along the topological map for one robot, by networkx."""

    def __init__(self, building: Building, radius: float, speed: float | None = None) -> None:
        self.building, self.radius, self.speed = building, radius, speed
        self.blocked = {
            floor: shapely.union_all([item.geometry for item in obstacles(building, floor)])
            for floor in building.floors
        }
        for shape in self.blocked.values():
            shapely.prepare(shape)
        self.one_way = {
            floor: [
                (entry.topological.nodes[edge.a].at, entry.topological.nodes[edge.b].at)
                for edge in entry.topological.edges.values()
                if edge.one_way
            ]
            for floor, entry in building.floors.items()
        }
        self.graph = self._graph()

    def _drive(self, length: float, limit: float = 0.0) -> float:
        if self.speed is None:
            return length
        return length / (min(self.speed, limit) if limit else self.speed)

    def _graph(self) -> nx.DiGraph:
        graph = nx.DiGraph()
        stops: dict[str, list[tuple[str, str]]] = {}
        for floor, entry in self.building.floors.items():
            for node in entry.topological.nodes.values():
                graph.add_node((floor, node.name))
                if node.elevator:
                    stops.setdefault(node.elevator, []).append((floor, node.name))
            for edge in entry.topological.edges.values():
                a, b = (entry.topological.nodes[name].at for name in (edge.a, edge.b))
                if edge.clearance and edge.clearance < self.radius:
                    continue
                if LineString([a, b]).distance(self.blocked[floor]) < self.radius - 1e-9:
                    continue
                cost = self._drive(math.dist(a, b), edge.speed_limit)
                graph.add_edge((floor, edge.a), (floor, edge.b), weight=cost)
                if not edge.one_way:
                    graph.add_edge((floor, edge.b), (floor, edge.a), weight=cost)
        for name, places in stops.items():
            elevator = self.building.elevators[name]
            for a, b in permutations(places, 2):
                if a[0] != b[0] and {a[0], b[0]} <= set(elevator.floors()):
                    wait, travel, climb = ride(self.building, elevator, a[0], b[0])
                    cost = climb if self.speed is None else wait + travel
                    graph.add_edge(a, b, weight=min(cost, graph.get_edge_data(a, b, {"weight": math.inf})["weight"]))
        return graph

    def joints(self, place: Place, outbound: bool) -> list[tuple[str, float]]:
        """The nearest nodes in straight free sight and how far they are."""
        nodes = list(self.building.floors[place.floor].topological.nodes.values())
        if not nodes:
            return []
        lines = shapely.linestrings([[(place.x, place.y), node.at] for node in nodes])
        clear = shapely.distance(lines, self.blocked[place.floor]) >= self.radius - 1e-9
        near = sorted(
            (math.dist(place[1:], node.at), node.name, node.at) for node, c in zip(nodes, clear, strict=True) if c
        )
        found = []
        for length, name, at in near:
            a, b = (place[1:], at) if outbound else (at, place[1:])
            if not self._wrong_way(place.floor, a, b):
                found.append((name, length))
        if found and found[0][1] < 0.01:
            return found[:1]
        return [(name, length) for name, length in found if length <= found[0][1] + 6.0][:JOINTS]

    def _wrong_way(self, floor: str, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether the line from a to b goes back beside a one-way edge for more than the robot's width."""
        for first, second in self.one_way[floor]:
            edge = LineString([first, second])
            beside = edge.buffer(self.radius, cap_style="flat")
            shared = LineString([a, b]).intersection(beside)
            if shared.is_empty:
                continue
            along = [edge.project(Point(p)) for p in shapely.get_coordinates(shared)]
            direction = (b[0] - a[0]) * (second[0] - first[0]) + (b[1] - a[1]) * (second[1] - first[1])
            if direction < 0 and max(along) - min(along) > 2 * self.radius:
                return True
        return False

    def cost(self, start: Place, goal: Place) -> float | None:
        """Cost of the cheapest way; infinite without one; None where an end sees no node."""
        begin, end = self.joints(start, True), self.joints(goal, False)
        if not begin or not end:
            return None
        graph = self.graph
        graph.add_node("start")
        graph.add_node("goal")
        for name, length in begin:
            graph.add_edge("start", (start.floor, name), weight=self._drive(length))
        for name, length in end:
            graph.add_edge((goal.floor, name), "goal", weight=self._drive(length))
        try:
            return nx.dijkstra_path_length(graph, "start", "goal")
        except nx.NetworkXNoPath:
            return math.inf
        finally:
            graph.remove_nodes_from(["start", "goal"])


def random_places(building: Building, radius: float, count: int, seed: int) -> list[Place]:
    """Free places all over a building."""
    rng = np.random.default_rng(seed)
    spaces = {floor: free_space(building, floor, radius) for floor in building.floors}
    weights = np.array([space.area for space in spaces.values()])
    names = list(spaces)
    found: list[Place] = []
    while len(found) < count:
        floor = names[rng.choice(len(names), p=weights / weights.sum())]
        x0, y0, x1, y1 = spaces[floor].bounds
        points = rng.uniform((x0, y0), (x1, y1), (50, 2))
        inside = shapely.contains_xy(spaces[floor], points)
        found += [Place(floor, float(x), float(y)) for x, y in points[inside][:1]]
    return found


def shortest_by_visibility(space: Polygon, start: tuple[float, float], goal: tuple[float, float]) -> float:
    """Length of the shortest way inside a polygon with holes, by its whole visibility graph."""
    corners = [start, goal, *map(tuple, shapely.get_coordinates(space))]
    corners = list(dict.fromkeys(corners))
    pairs = list(combinations(range(len(corners)), 2))
    lines = shapely.linestrings([[corners[i], corners[j]] for i, j in pairs])
    room = space.buffer(1e-7)
    shapely.prepare(room)
    seen = shapely.covers(room, lines)
    graph = nx.Graph()
    graph.add_weighted_edges_from(
        (i, j, math.dist(corners[i], corners[j])) for (i, j), sees in zip(pairs, seen, strict=True) if sees
    )
    return nx.dijkstra_path_length(graph, 0, 1)
