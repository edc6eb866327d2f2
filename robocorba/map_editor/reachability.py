"""Which parts of a building's roadmap a robot reaches, by elevators and by edges that are free and wide enough."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from robocorba.errors.maps import describe
from robocorba.map_editor.collisions import TOUCH_M, all_paths, obstacle_label
from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.arrays import Longs, connected_parts
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.time_limit import no_limit

#: Why the robot does not fit, by name of the node.
Causes = dict[str, str]
#: Directed connections (n, 2) between node indices.
Links = NDArray[np.int64]


class Reachability:
    """Reachability on the roadmap of `building` for a robot of `radius_m`."""

    def __init__(self, building: Building, radius_m: float, check_time: Callable[[], None] = no_limit) -> None:
        """`check_time` is called often, and may raise an error to end the work."""
        self._building, self.radius_m, self._check_time = building, radius_m, check_time
        self._growth_m = max(radius_m - TOUCH_M, 0.0)
        nodes = ((floor, name) for floor, entry in building.floors.items() for name in entry.topological.nodes)
        self._index = {node: i for i, node in enumerate(nodes)}
        self._stops = _stops(building)
        self._closed = {floor: self._edges_closed(floor) for floor in building.floors}
        drives = np.concatenate([np.empty((0, 2), int), *(self._drives(floor) for floor in building.floors)])
        links = np.concatenate([drives, self._rides()])
        self._entered = set(drives[:, 1].tolist())
        self._part = connected_parts(links[:, 0], links[:, 1], len(self._index))
        self._into, self._out = _both_ways(links, self._part)
        self._too_close = {floor: self._nodes_too_close(floor) for floor in building.floors}
        self._walled_in = {floor: self._nodes_walled_in(floor) for floor in building.floors}

    def too_close(self, floor: str) -> Causes:
        """Free nodes that are too close to an obstacle for the robot, with the obstacle."""
        return {name: cause for name, cause in self._too_close[floor].items() if cause}

    def walled_in(self, floor: str) -> list[str]:
        """Nodes that obstacles separate from the floor's roadmap and from its elevators."""
        return self._walled_in[floor]

    def isolated(self, floor: str) -> list[str]:
        """Nodes without an edge."""
        topology = self._building.floors[floor].topological
        joined = {name for edge in topology.edges.values() for name in (edge.a, edge.b)}
        return [name for name in topology.nodes if name not in joined]

    def separate_parts(self, floor: str) -> list[tuple[list[str], str]]:
        """Parts of the floor's roadmap without a connection to its largest part, and why. They exclude nodes that are
        too close to an obstacle, walled in or isolated."""
        known = {*self._too_close[floor], *self._walled_in[floor], *self.isolated(floor)}
        parts = ([name for name in part if name not in known] for part in self._parts(floor)[1:])
        return [(part, self._cause_of_separation(floor, set(part))) for part in parts if part]

    def one_way(self, floor: str) -> dict[str, list[str]]:
        """Nodes of connected parts that the robot can't both enter and leave because of one-way edges, by direction."""
        found: dict[str, list[str]] = {}
        for name in self._building.floors[floor].topological.nodes:
            i = self._index[floor, name]
            if not (self._into[i] and self._out[i]):
                direction = "neither entered from the rest of the roadmap nor left for it"
                if self._into[i]:
                    direction = "entered but not left"
                elif self._out[i]:
                    direction = "left but not entered"
                found.setdefault(direction, []).append(name)
        return found

    def is_cut_off(self, floor: str) -> bool:
        """Whether the floor's roadmap is not connected with the building's largest part."""
        parts = self._parts(floor)
        return bool(parts) and self._part[self._index[floor, parts[0][0]]] != np.bincount(self._part).argmax()

    def enters(self, elevator: str) -> bool:
        """Whether the robot can drive into the elevator's cabin on some floor."""
        return any(self._index[stop] in self._entered for stop in self.stops(elevator))

    def stops(self, elevator: str) -> list[tuple[str, str]]:
        """Floor and name of the nodes in an elevator's cabin."""
        return self._stops.get(elevator, [])

    def _parts(self, floor: str) -> list[list[str]]:
        """The nodes of a floor by connected part, the largest part first."""
        parts: dict[int, list[str]] = {}
        for name in self._building.floors[floor].topological.nodes:
            parts.setdefault(int(self._part[self._index[floor, name]]), []).append(name)
        return sorted(parts.values(), key=len, reverse=True)

    def _cause_of_separation(self, floor: str, part: set[str]) -> str:
        """What blocks the widest edge between a part and the others."""
        edges = self._building.floors[floor].topological.edges
        closed = [
            (clearance_m, cause, name)
            for name, (clearance_m, cause) in self._closed[floor].items()
            if (edges[name].a in part) != (edges[name].b in part)
        ]
        if not closed:
            return "no edge joins them"
        _, cause, name = max(closed, key=lambda found: found[0])
        return f"{describe('edge', '', name)} {cause}"

    def _drives(self, floor: str) -> Links:
        """Links of the edges that are wide enough, in each permitted direction."""
        links = []
        for name, edge in self._building.floors[floor].topological.edges.items():
            if name not in self._closed[floor]:
                a, b = self._index[floor, edge.a], self._index[floor, edge.b]
                links += [(a, b)] if edge.one_way else [(a, b), (b, a)]
        return np.array(links, int).reshape(-1, 2)

    def _edges_closed(self, floor: str) -> dict[str, tuple[float, str]]:
        """The clearance [m] of edges that are blocked or too narrow for the robot, and what limits it."""
        self._check_time()
        paths = all_paths(self._building.floors[floor].topological)
        closed = {
            edge.name: (edge.clearance, f"is for robots of at most {edge.clearance:g} m")
            for edge in paths.edges
            if edge.clearance and edge.clearance < self.radius_m
        }
        for i, (clearance_m, what) in self._nearest(floor, shapely.linestrings(paths.ends)).items():
            cause = f"is {clearance_m:.3f} m from {what}" if clearance_m > 0 else f"is blocked by {what}"
            closed[paths.edges[i].name] = clearance_m, cause
        return closed

    def _rides(self) -> Links:
        """Links that connect all stops of each elevator between floors."""
        rides = [
            (self._index[start], self._index[end])
            for stops in self._stops.values()
            if len({floor for floor, _ in stops}) > 1
            for a, b in pairwise(stops)
            for start, end in ((a, b), (b, a))
        ]
        return np.array(rides, int).reshape(-1, 2)

    def _nodes_too_close(self, floor: str) -> Causes:
        """Nodes where the robot does not fit, with the nearest obstacle; with an empty cause if they lie on it."""
        paths = all_paths(self._building.floors[floor].topological)
        near = self._nearest(floor, shapely.points(paths.at))
        return {
            paths.nodes[i].name: f"{apart_m:.3f} m from {what}" if apart_m > TOUCH_M else ""
            for i, (apart_m, what) in near.items()
        }

    def _nodes_walled_in(self, floor: str) -> list[str]:
        nodes = self._building.floors[floor].topological.nodes
        parts = self._parts(floor)
        if not parts or len(parts[0]) == 1:
            return []  # there is no roadmap to be separated from
        lifts = [lift.at for lift in self._building.elevators.values() if floor in lift.floors()]
        anchors = np.array([*(nodes[name].at for name in parts[0]), *lifts])
        tree = STRtree([item.geometry for item in obstacles(self._building, floor)])
        known: list[tuple[Polygon, bool]] = []
        enclosed = []
        for name in (name for part in parts[1:] for name in part if name not in self._too_close[floor]):
            self._check_time()
            at = nodes[name].at
            is_enclosed = next((found for region, found in known if shapely.intersects_xy(region, *at)), None)
            if is_enclosed is None:
                region, is_enclosed = _region_around(tree, self._growth_m, at, anchors)
                if region is not None:
                    known.append((region, is_enclosed))
            if is_enclosed:
                enclosed.append(name)
        return enclosed

    def _nearest(self, floor: str, shapes: NDArray[np.object_]) -> dict[int, tuple[float, str]]:
        """For each shape closer to an obstacle than the radius: the distance [m] and name of the nearest obstacle."""
        found = obstacles(self._building, floor)
        tree = STRtree([item.geometry for item in found])
        which, near = tree.query(shapes, predicate="dwithin", distance=self._growth_m)
        apart = shapely.distance(shapes[which], tree.geometries[near])
        by_distance = np.argsort(-apart, kind="stable").tolist()  # the nearest last
        nearest = {int(which[i]): i for i in by_distance}
        return {shape: (float(apart[i]), obstacle_label(found[near[i]])) for shape, i in sorted(nearest.items())}


def _region_around(tree: STRtree, growth_m: float, at: XY, anchors: NDArray[np.float64]) -> tuple[Polygon | None, bool]:
    """The region around a robot at `at`, if there is any, and whether it is enclosed: whether the robot reaches neither
    one of the `anchors` (n, 2) nor the border of a window around it. tree: of the floor's obstacles. growth_m: how far
    the robot's middle keeps from them."""
    # A larger window than 60 m x 60 m would find larger enclosures; its cost grows with its square.
    window = shapely.box(at[0] - 30.0, at[1] - 30.0, at[0] + 30.0, at[1] + 30.0)
    near = tree.query(window, predicate="dwithin", distance=growth_m)
    # Chords within the arcs approximate round corners, so a gap appears up to 1 % wider.
    space = window.difference(shapely.union_all(shapely.buffer(tree.geometries[near], growth_m)))
    parts = shapely.get_parts(space)
    local = parts[shapely.dwithin(parts, shapely.Point(at), TOUCH_M)]
    if not len(local):
        return None, True
    region = local[0]
    shapely.prepare(region)
    is_open = shapely.dwithin(region, window.exterior, TOUCH_M) or shapely.intersects_xy(region, anchors).any()
    return region, not is_open


def _stops(building: Building) -> dict[str, list[tuple[str, str]]]:
    """Floor and name of the nodes in the cabin of each elevator."""
    stops: dict[str, list[tuple[str, str]]] = {}
    for floor, entry in building.floors.items():
        for node in entry.topological.nodes.values():
            if node.elevator:
                stops.setdefault(node.elevator, []).append((floor, node.name))
    return stops


def _both_ways(links: Links, part: Longs) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which nodes the largest strongly connected component of their part reaches, and which nodes reach it."""
    graph: nx.DiGraph[int] = nx.DiGraph(links.tolist())
    graph.add_nodes_from(range(len(part)))
    pieces = sorted((-len(piece), min(piece)) for piece in nx.strongly_connected_components(graph))
    # The largest piece of each part comes last.
    cores = {int(part[node]): node for _, node in reversed(pieces)}.values()
    reached = []
    for directed in (graph, graph.reverse(copy=False)):
        nodes = list(set(cores).union(*(nx.descendants(directed, core) for core in cores)))
        reached.append(np.isin(np.arange(len(part)), nodes))
    return reached[0], reached[1]
