"""Which parts of a building's road map a robot gets to: along edges that are wide enough and free, and elevators."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from shapely import STRtree

from robocorba.errors.maps import describe
from robocorba.maps.collisions import TOUCH_M, all_paths, called
from robocorba.maps.enclosure import Enclosures
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building

IN_ONLY, OUT_ONLY = "entered but not left", "left but not entered"
APART = "neither entered from the rest of the road map nor left for it"

#: Nodes by name, and what keeps the robot from them.
Causes = dict[str, str]
Links = NDArray[np.int64]


class Gap(NamedTuple):
    """How much room an edge leaves, m, and what takes the rest."""

    room_m: float
    cause: str


class Reach:
    """The road map of `building` for a robot of `radius_m`."""

    def __init__(self, building: Building, radius_m: float) -> None:
        self._building, self.radius_m = building, radius_m
        places = ((floor, name) for floor, entry in building.floors.items() for name in entry.topological.nodes)
        self._index = {place: i for i, place in enumerate(places)}
        self._stops = _stops(building)
        self._closed = {floor: self._edges_closed(floor) for floor in building.floors}
        drives = np.concatenate([np.empty((0, 2), int), *(self._drives(floor) for floor in building.floors)])
        links = np.concatenate([drives, self._rides()])
        self._entered = set(drives[:, 1].tolist())
        self._part = connected_components(_graph(links, len(self._index)), connection="weak")[1]
        self._into, self._out = _both_ways(links, self._part)
        self._too_near = {floor: self._nodes_too_near(floor) for floor in building.floors}
        self._walled_in = {floor: self._nodes_walled_in(floor) for floor in building.floors}

    def too_near(self, floor: str) -> Causes:
        """Nodes that are free, but where the robot does not fit, and what they are too near to."""
        return {name: cause for name, cause in self._too_near[floor].items() if cause}

    def walled_in(self, floor: str) -> list[str]:
        """Nodes that walls close off from the floor's road map and from its elevators."""
        return self._walled_in[floor]

    def lone(self, floor: str) -> list[str]:
        """Nodes without an edge."""
        topology = self._building.floors[floor].topological
        joined = {name for edge in topology.edges.values() for name in (edge.a, edge.b)}
        return [name for name in topology.nodes if name not in joined]

    def separate_parts(self, floor: str) -> list[tuple[list[str], str]]:
        """Parts of the floor's road map that are not connected with its largest one, and why; those without nodes
        that are too near, walled in or lone."""
        known = {*self._too_near[floor], *self._walled_in[floor], *self.lone(floor)}
        parts = ([name for name in part if name not in known] for part in self._parts(floor)[1:])
        return [(part, self._missing_link(floor, set(part))) for part in parts if part]

    def one_way(self, floor: str) -> dict[str, list[str]]:
        """Nodes of connected parts that one-way edges let the robot enter or leave, but not both."""
        found: dict[str, list[str]] = {}
        for name in self._building.floors[floor].topological.nodes:
            i = self._index[floor, name]
            if not (self._into[i] and self._out[i]):
                direction = IN_ONLY if self._into[i] else OUT_ONLY if self._out[i] else APART
                found.setdefault(direction, []).append(name)
        return found

    def is_cut_off(self, floor: str) -> bool:
        """Whether the floor's road map is not connected with the building's largest part."""
        parts = self._parts(floor)
        return bool(parts) and self._part[self._index[floor, parts[0][0]]] != np.bincount(self._part).argmax()

    def enters(self, elevator: str) -> bool:
        """Whether the robot can drive into the elevator's cabin on some floor."""
        return any(self._index[stop] in self._entered for stop in self.stops(elevator))

    def stops(self, elevator: str) -> list[tuple[str, str]]:
        """Floors and names of the nodes in an elevator's cabin."""
        return self._stops.get(elevator, [])

    def _parts(self, floor: str) -> list[list[str]]:
        """The nodes of a floor by connected part, the largest part first."""
        parts: dict[int, list[str]] = {}
        for name in self._building.floors[floor].topological.nodes:
            parts.setdefault(int(self._part[self._index[floor, name]]), []).append(name)
        return sorted(parts.values(), key=len, reverse=True)

    def _missing_link(self, floor: str, part: set[str]) -> str:
        """Of the edges between a part and the others, the one that leaves most room."""
        edges = self._building.floors[floor].topological.edges
        closed = [
            (gap, name)
            for name, gap in self._closed[floor].items()
            if (edges[name].a in part) != (edges[name].b in part)
        ]
        if not closed:
            return "no edge joins them"
        gap, name = max(closed, key=lambda found: found[0].room_m)
        return f"{describe('edge', '', name)} {gap.cause}"

    def _drives(self, floor: str) -> Links:
        """Both nodes' indices of each edge that is wide enough, in each direction that it has."""
        links = []
        for name, edge in self._building.floors[floor].topological.edges.items():
            if name not in self._closed[floor]:
                a, b = self._index[floor, edge.a], self._index[floor, edge.b]
                links += [(a, b)] if edge.one_way else [(a, b), (b, a)]
        return np.array(links, int).reshape(-1, 2)

    def _edges_closed(self, floor: str) -> dict[str, Gap]:
        """Edges that the robot can't drive."""
        paths = all_paths(self._building.floors[floor].topological)
        closed = {
            edge.name: Gap(edge.clearance, f"is for robots of at most {edge.clearance:g} m")
            for edge in paths.edges
            if edge.clearance and edge.clearance < self.radius_m
        }
        for i, (room_m, what) in self._nearest(floor, shapely.linestrings(paths.ends)).items():
            cause = f"is {room_m:.3f} m from {what}" if room_m > 0 else f"is blocked by {what}"
            closed[paths.edges[i].name] = Gap(room_m, cause)
        return closed

    def _rides(self) -> Links:
        """Both nodes' indices of rides that connect all stops of an elevator that leads to another floor."""
        rides = [
            (self._index[here], self._index[there])
            for stops in self._stops.values()
            if len({floor for floor, _ in stops}) > 1
            for a, b in pairwise(stops)
            for here, there in ((a, b), (b, a))
        ]
        return np.array(rides, int).reshape(-1, 2)

    def _nodes_too_near(self, floor: str) -> Causes:
        """Nodes where the robot does not fit, and the nearest cause; none for those that stand on an obstacle."""
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
            return []  # no road map that one could be walled off from
        lifts = [lift.at for lift in self._building.elevators.values() if floor in lift.floors()]
        anchors = np.array([*(nodes[name].at for name in parts[0]), *lifts])
        enclosures = Enclosures(obstacles(self._building, floor), self.radius_m, anchors)
        rest = (name for part in parts[1:] for name in part if name not in self._too_near[floor])
        return [name for name in rest if enclosures.close_off(nodes[name].at)]

    def _nearest(self, floor: str, shapes: NDArray[np.object_]) -> dict[int, tuple[float, str]]:
        """The nearest obstacle of each shape that one is nearer to than the radius: its distance, m, and name."""
        found = obstacles(self._building, floor)
        tree = STRtree([item.geometry for item in found])
        which, near = tree.query(shapes, predicate="dwithin", distance=max(self.radius_m - TOUCH_M, 0.0))
        apart = shapely.distance(shapes[which], tree.geometries[near])
        by_distance = np.argsort(-apart, kind="stable").tolist()  # the nearest last
        nearest = {int(which[i]): i for i in by_distance}
        return {shape: (float(apart[i]), called(found[near[i]])) for shape, i in sorted(nearest.items())}


def _stops(building: Building) -> dict[str, list[tuple[str, str]]]:
    """Floors and names of the nodes in the cabin of each elevator."""
    stops: dict[str, list[tuple[str, str]]] = {}
    for floor, entry in building.floors.items():
        for node in entry.topological.nodes.values():
            if node.elevator:
                stops.setdefault(node.elevator, []).append((floor, node.name))
    return stops


def _graph(links: Links, size: int) -> csr_array:
    return csr_array((np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), (size, size))


def _both_ways(links: Links, part: NDArray[np.int32]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which nodes are reached from the largest two-way piece of their part, and from which it is reached."""
    size = len(part)
    piece = connected_components(_graph(links, size), connection="strong")[1]
    by_size = np.argsort(-np.bincount(piece)[piece], kind="stable") if size else np.empty(0, int)
    cores = by_size[np.unique(part[by_size], return_index=True)[1]]
    start = np.column_stack([np.full(len(cores), size), cores])  # one more node leads to all cores
    reached = []
    for way in (links, links[:, ::-1]):
        order = breadth_first_order(_graph(np.concatenate([way, start]), size + 1), size, return_predecessors=False)
        reached.append(np.isin(np.arange(size), order))
    return reached[0], reached[1]
