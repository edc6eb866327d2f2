"""Judges the planner's answers by shapely and numpy alone, without the planner's kernels.

A path must keep the robot's radius from every obstacle. A refusal must be justified: the judge searches a path on a
fine grid. The grid contains only paths that certainly exist, so the judge never rejects a correct answer; it may
miss a path that is narrower than radius + GRID_MARGIN_M.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point

from robocorba.errors.paths import NoPath, NotFree
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.model import Building
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from robocorba.spatial.pose import XY
from robocorba.testing.fine_grid import FORGIVEN_M, SPARE_M, FineGrid, FloorGeometry
from robocorba.testing.grid_maps import Cell
from tests.planning.visibility import VisibilityGraph, cabin_place

Array: TypeAlias = NDArray[np.float64]

#: A place nearer to a node than this is on the node [m].
ON_NODE_M = 0.01


class Verdict(NamedTuple):
    """The planner's answer and its errors.

    `outcome` is found, NoPath, NotFree or the name of an unexpected exception. `touches` are collisions, `faults`
    other errors of the path. `is_refused_wrongly`: a path exists. `length_m` is the length of the path, 0 without
    one."""

    outcome: str
    touches: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    is_refused_wrongly: bool = False
    length_m: float = 0.0

    @property
    def is_right(self) -> bool:
        return not (self.touches or self.faults or self.is_refused_wrongly)


class Judge:
    """Judges answers for one building."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self.floors = {name: FloorGeometry(building, name) for name in building.floors}
        self._grids: dict[tuple[str, float, bool], FineGrid] = {}
        self._components: dict[tuple[float, bool], dict[tuple[str, int], int]] = {}
        self._cabin_lengths: dict[tuple[str, str, float], Array] = {}
        self._start_lengths: dict[tuple[str, Cell, float], Array] = {}
        self._exact: dict[float, VisibilityGraph] = {}
        self._roads: dict[float, nx.DiGraph] = {}

    def verdict(self, planner: PathPlanner, request: PathRequest) -> Verdict:
        """Query the planner and judge its answer."""
        try:
            path = planner.paths(request)[0]
        except NotFree as refusal:
            place = request.start if refusal.which == "start" else request.goal
            return Verdict("NotFree", is_refused_wrongly=self.point_is_free(place, request.radius, FORGIVEN_M))
        except NoPath:
            return Verdict("NoPath", is_refused_wrongly=self.has_way(request))
        except Exception as error:  # the planner must not raise any other exception
            return Verdict(type(error).__name__, faults=(repr(error)[:200],))
        touches, faults = self.touches(path, request.radius), self.faults(path, request)
        return Verdict("found", tuple(touches), tuple(faults), length_m=path.distance)

    def point_is_free(self, place: Place, radius_m: float, spare_m: float = 0.0) -> bool:
        """Whether a robot fits at a place with `spare_m` of additional clearance."""
        return self.floors[place.floor].point_is_free(place[1:], radius_m + spare_m)

    # Paths.

    def touches(self, path: Path, radius_m: float) -> list[str]:
        """Where the path comes nearer than the radius to an obstacle or leaves the outline, a sentence each."""
        drives: dict[str, list[tuple[XY, XY]]] = {}
        for a, b in pairwise(path.points):
            if a.kind is not PointKind.ELEVATOR_ENTRY and a.floor == b.floor:
                drives.setdefault(a.floor, []).append(((a.x, a.y), (b.x, b.y)))
        return [text for floor, lines in drives.items() for text in self.floors[floor].touches(lines, radius_m)]

    def faults(self, path: Path, request: PathRequest) -> list[str]:
        """Other errors: ends, rides, the order of points, distances, one-way edges."""
        points = path.points
        found = []
        if len(points) < 2:
            return [f"the path has {len(points)} points"]
        for point, place, kind in (
            (points[0], request.start, PointKind.START),
            (points[-1], request.goal, PointKind.GOAL),
        ):
            if point.kind is not kind or point.floor != place.floor or math.dist((point.x, point.y), place[1:]) > 1e-9:
                found.append(f"the path's {kind.name.lower()} is {point}")
        driven = 0.0
        for a, b in pairwise(points):
            where = f"from {a.floor}:{a.x:.3f},{a.y:.3f} to {b.floor}:{b.x:.3f},{b.y:.3f}"
            if not all(map(math.isfinite, (b.x, b.y, b.distance, b.time, b.heading))):
                found.append(f"{where}: a value is not finite")
            if a.kind is PointKind.ELEVATOR_ENTRY:
                found += [f"{where}: {reason}" for reason in self._ride_faults(a, b)]
                driven += abs(self._height(a.floor) - self._height(b.floor))
            elif a.floor != b.floor:
                found.append(f"{where}: changes the floor without an elevator")
            else:
                driven += math.dist((a.x, a.y), (b.x, b.y))
                if request.mode is not RouteMode.GEOMETRIC and self._is_wrong_way(a, b, request.radius):
                    found.append(f"{where}: against a one-way edge")
            if b.distance < a.distance or b.time < a.time:
                found.append(f"{where}: distance or time falls")
            found += self._node_faults(b)
        if not math.isclose(driven, path.distance, rel_tol=1e-9, abs_tol=1e-6):
            found.append(f"the path is {driven} m long and reports {path.distance} m")
        return found

    def _height(self, floor: str) -> float:
        return self.building.floors[floor].floor.elevation

    def _ride_faults(self, a: PathPoint, b: PathPoint) -> list[str]:
        if b.kind is not PointKind.ELEVATOR_EXIT or a.elevator != b.elevator:
            return ["a ride without an end"]
        elevator = self.building.elevators[a.elevator]
        found = []
        if not {a.floor, b.floor} <= set(elevator.floors()):
            found.append(f"elevator {a.elevator} does not serve both floors")
        shaft = shaft_polygon(elevator)
        if any(shaft.distance(Point(point.x, point.y)) > FORGIVEN_M for point in (a, b)):
            found.append(f"the ride begins or ends outside the shaft of {a.elevator}")
        return found

    def _node_faults(self, point: PathPoint) -> list[str]:
        if not point.node:
            return []
        node = self.building.floors[point.floor].topological.nodes.get(point.node)
        if node is None or math.dist(node.at, (point.x, point.y)) > 1e-9:
            return [f"{point.node} is not at {point.floor}:{point.x},{point.y}"]
        return []

    def _is_wrong_way(self, a: PathPoint, b: PathPoint, radius_m: float) -> bool:
        """Whether a drive goes back beside a one-way edge for more than the robot's diameter."""
        if not self.floors[a.floor].lanes or self._is_along_edge(a, b):
            return False
        drive = np.array([b.x - a.x, b.y - a.y])
        line = LineString([(a.x, a.y), (b.x, b.y)])
        for lane in self.floors[a.floor].lanes:
            ahead = np.diff(shapely.get_coordinates(lane), axis=0)[0]
            if drive @ ahead >= 0.0:
                continue
            shared = shapely.get_coordinates(line.intersection(lane.buffer(radius_m - FORGIVEN_M, cap_style="flat")))
            along = [lane.project(Point(point)) for point in shared]
            if along and max(along) - min(along) > 2 * radius_m + FORGIVEN_M:
                return True
        return False

    def _is_along_edge(self, a: PathPoint, b: PathPoint) -> bool:
        """Whether a drive stays on an edge that allows its direction, regardless of one-way edges beside it."""
        topological = self.building.floors[a.floor].topological
        for edge in topological.edges.values():
            first, last = (np.array(topological.nodes[name].at) for name in (edge.a, edge.b))
            if edge.one_way and (b.x - a.x) * (last - first)[0] + (b.y - a.y) * (last - first)[1] < 0.0:
                continue
            line = LineString([first, last])
            if all(line.distance(Point(point.x, point.y)) <= FORGIVEN_M for point in (a, b)):
                return True
        return False

    # Refusals.

    def has_way(self, request: PathRequest) -> bool:
        """Whether a path that the mode allows certainly exists, although the planner found none."""
        if request.mode is RouteMode.TOPOLOGICAL:
            return self._has_way_along_the_map(request)
        without_lanes = request.mode is RouteMode.SMOOTHED
        starts = self._parts(request.start, request.radius, without_lanes)
        goals = self._parts(request.goal, request.radius, without_lanes)
        return bool(starts & goals) or self._is_straight(request, without_lanes)

    def _is_straight(self, request: PathRequest, without_lanes: bool) -> bool:
        """Whether a robot can drive straight from start to goal."""
        start, goal = request.start, request.goal
        if start.floor != goal.floor:
            return False
        floor = self.floors[start.floor]
        line = LineString([start[1:], goal[1:]])
        if without_lanes and any(line.distance(lane) <= request.radius for lane in floor.lanes):
            return False
        needed = min(floor.clearance(start[1:]), floor.clearance(goal[1:]), request.radius + SPARE_M)
        return needed >= request.radius and not floor.touching([(start[1:], goal[1:])], needed)

    def grid(self, floor: str, radius_m: float, without_lanes: bool = False) -> FineGrid:
        """The fine grid of a floor for a radius; optionally without the area beside one-way edges."""
        without_lanes = without_lanes and bool(self.floors[floor].lanes)
        key = (floor, radius_m, without_lanes)
        if key not in self._grids:
            self._grids[key] = FineGrid(self.floors[floor], radius_m, without_lanes)
        return self._grids[key]

    def _parts(self, place: Place, radius_m: float, without_lanes: bool) -> set[int]:
        """The parts of the building, connected by rides too, that certainly contain a place."""
        known = self._components.get((radius_m, without_lanes))
        if known is None:
            known = self._components[radius_m, without_lanes] = self._connect(radius_m, without_lanes)
        return {known[place.floor, part] for part in self.grid(place.floor, radius_m, without_lanes).parts(place[1:])}

    def _connect(self, radius_m: float, without_lanes: bool) -> dict[tuple[str, int], int]:
        graph: nx.Graph = nx.Graph()
        for floor in self.building.floors:
            graph.add_nodes_from(
                (floor, part) for part in range(1, self.grid(floor, radius_m, without_lanes).count + 1)
            )
        for name, elevator in self.building.elevators.items():
            for floor in elevator.floors():
                grid = self.grid(floor, radius_m, without_lanes)
                graph.add_edges_from(
                    (("", name), (floor, part)) for part in grid.parts(cabin_place(self.building, name, floor))
                )
        parts = nx.connected_components(graph)
        return {node: i for i, part in enumerate(parts) for node in part}

    def _has_way_along_the_map(self, request: PathRequest) -> bool:
        """Whether networkx finds a route on the roadmap between the nodes in sight, else those around corners."""
        graph = self.roads(request.radius)
        starts = self._ties(request.start, request.radius, outbound=True)
        goals = self._ties(request.goal, request.radius, outbound=False)
        reached = set(starts)
        for node in starts:
            reached |= nx.descendants(graph, node)
        return not reached.isdisjoint(goals)

    def _ties(self, place: Place, radius_m: float, outbound: bool) -> list[tuple[str, str]]:
        floor = self.floors[place.floor]
        nodes = list(self.building.floors[place.floor].topological.nodes.values())
        on = [node for node in nodes if math.dist(node.at, place[1:]) < ON_NODE_M]
        if on:
            nodes = on[:1]
        lines = [(place[1:], node.at) for node in nodes]
        touching = floor.touching(lines, radius_m + FORGIVEN_M)
        in_sight = [
            node
            for i, node in enumerate(nodes)
            if i not in touching and not (floor.lanes and self._beside_lane(floor, place[1:], node.at, radius_m))
        ]
        if not in_sight and not floor.lanes:
            grid = self.grid(place.floor, radius_m)
            parts = grid.parts(place[1:])
            in_sight = [node for node in nodes if parts & grid.parts(node.at)]
        return [(place.floor, node.name) for node in in_sight]

    def _beside_lane(self, floor: FloorGeometry, a: XY, b: XY, radius_m: float) -> bool:
        """Whether a one-way edge might forbid the drive."""
        line = LineString([a, b])
        return any(line.distance(lane) <= radius_m for lane in floor.lanes)

    def roads(self, radius_m: float) -> nx.DiGraph:
        """The roadmap that a robot can use: clear edges, and rides."""
        if radius_m in self._roads:
            return self._roads[radius_m]
        graph: nx.DiGraph = nx.DiGraph()
        cabins: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.building.floors.items():
            nodes = entry.topological.nodes
            edges = list(entry.topological.edges.values())
            graph.add_nodes_from((name, node) for node in nodes)
            for node in nodes.values():
                if node.elevator:
                    cabins.setdefault(node.elevator, []).append((name, node.name))
            lines = [(nodes[edge.a].at, nodes[edge.b].at) for edge in edges]
            touching = self.floors[name].touching(lines, radius_m + FORGIVEN_M)
            for i, edge in enumerate(edges):
                if i in touching or 0.0 < edge.clearance < radius_m:
                    continue
                graph.add_edge((name, edge.a), (name, edge.b))
                if not edge.one_way:
                    graph.add_edge((name, edge.b), (name, edge.a))
        for elevator, places in cabins.items():
            served = set(self.building.elevators[elevator].floors())
            stops = [place for place in places if place[0] in served]
            graph.add_edges_from((a, b) for a in stops for b in stops if a[0] != b[0])
        self._roads[radius_m] = graph
        return graph

    # Lengths.

    def shortest_length(self, request: PathRequest, exact: bool) -> float:
        """Length that a shortest path must not exceed by more than a percent [m]; infinite if none is known.

        With `exact` it comes from a visibility graph, unless an end is too near to an obstacle for it; else from the
        fine grids."""
        length = self.exact_length(request) if exact else math.nan
        return self.octile_length(request) if math.isnan(length) else length

    def exact_length(self, request: PathRequest) -> float:
        """Length of the shortest path by a visibility graph [m]; NaN if the graph cannot decide.

        For small buildings: it takes a second for 300 corners a floor."""
        if request.radius not in self._exact:
            self._exact[request.radius] = VisibilityGraph(self.building, request.radius)
        return self._exact[request.radius].length(request.start, request.goal)

    def octile_length(self, request: PathRequest) -> float:
        """Length of the shortest path on the fine grids, rides included [m]: no shortest path is longer.

        Infinite if the grid has no path. A new start in a million cells takes a tenth of a second."""
        start, goal, radius = request.start, request.goal, request.radius
        best = math.inf
        if start.floor == goal.floor:
            if self._is_straight(request, without_lanes=False):
                return math.dist(start[1:], goal[1:])
            best = self._same_floor(start, goal, radius)
        stops = [(floor, name) for name, lift in self.building.elevators.items() for floor in lift.floors()]
        lengths = {stop: self._from_cabin(stop, start, radius) for stop in stops if stop[0] == start.floor}
        graph: nx.Graph = nx.Graph()
        graph.add_nodes_from(["start", "goal", *stops])
        graph.add_weighted_edges_from(("start", stop, length) for stop, length in lengths.items())
        for stop in stops:
            if stop[0] == goal.floor:
                graph.add_edge(stop, "goal", weight=self._from_cabin(stop, goal, radius))
            for other in stops:
                if other[1] == stop[1] and other[0] > stop[0]:
                    graph.add_edge(stop, other, weight=abs(self._height(stop[0]) - self._height(other[0])))
                elif other[0] == stop[0] and other[1] > stop[1]:
                    graph.add_edge(
                        stop,
                        other,
                        weight=self._from_cabin(
                            stop, Place(other[0], *cabin_place(self.building, *other[::-1])), radius
                        ),
                    )
        try:
            return min(best, nx.dijkstra_path_length(graph, "start", "goal"))
        except nx.NetworkXNoPath:
            return best

    def _same_floor(self, start: Place, goal: Place, radius_m: float) -> float:
        grid = self.grid(start.floor, radius_m)
        starts, goals = grid.links(start[1:]), grid.links(goal[1:])
        if not starts or not goals:
            return math.inf
        cell, first = starts[0]
        key = (start.floor, cell, radius_m)
        if key not in self._start_lengths:
            if len(self._start_lengths) > 8:
                self._start_lengths.clear()
            self._start_lengths[key] = grid.octile.lengths_from(cell)
        return min(first + float(self._start_lengths[key][goal_cell]) + last for goal_cell, last in goals)

    def _from_cabin(self, stop: tuple[str, str], place: Place, radius_m: float) -> float:
        """Length of a path from a cabin to a place on the same floor [m]."""
        floor, name = stop
        grid = self.grid(floor, radius_m)
        links = grid.links(cabin_place(self.building, name, floor))
        if not links:
            return math.inf
        cell, first = links[0]
        key = (floor, name, radius_m)
        if key not in self._cabin_lengths:
            self._cabin_lengths[key] = grid.octile.lengths_from(cell)
        ends = grid.links(place[1:])
        return min((first + float(self._cabin_lengths[key][end]) + last for end, last in ends), default=math.inf)
