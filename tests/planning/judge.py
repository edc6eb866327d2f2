"""Judges the planner's answers by shapely, numpy and networkx, without the planner's kernels.

A path must keep the robot's radius from every obstacle. A refusal must be justified: the judge searches a path on a
fine grid. The grid contains only paths that certainly exist, so the judge never rejects a correct answer; it may
miss a path that is narrower than radius + GRID_MARGIN_M.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations, pairwise, permutations
from typing import NamedTuple, TypeAlias

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point

from robocorba.errors.paths import NoPath, NotFree
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.model import Building
from robocorba.planning.elevators import ride
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.search import CONNECTION_REACH_M, MAX_CONNECTIONS, ON_NODE_M
from robocorba.spatial.pose import XY
from robocorba.testing.fine_grid import SPARE_M, TOLERANCE_M, FineGrid, FloorGeometry
from robocorba.testing.grid_maps import Cell
from tests.planning.plain_plan import Plan
from tests.planning.visibility import VisibilityGraph, cabin_place

Array: TypeAlias = NDArray[np.float64]


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
        self._exact: dict[float, VisibilityGraph] = {}
        self._roads: dict[tuple[float, float | None, float], nx.DiGraph] = {}
        self._plans: dict[tuple[float, float], Plan] = {}
        #: Lengths from a cell to all others of its grid; the last few, as each has a million of them.
        self._lengths_from = lru_cache(maxsize=24)(self._compute_lengths_from)

    def verdict(self, planner: PathPlanner, request: PathRequest) -> Verdict:
        """Query the planner and judge its answer."""
        try:
            path = planner.paths(request)[0]
        except NotFree as refusal:
            place = request.start if refusal.which == "start" else request.goal
            return Verdict("NotFree", is_refused_wrongly=self.point_is_free(place, request.radius, TOLERANCE_M))
        except NoPath:
            return Verdict("NoPath", is_refused_wrongly=self.path_exists(request))
        except Exception as error:  # the planner must not raise any other exception
            return Verdict(type(error).__name__, faults=(repr(error)[:200],))
        touches, faults = self.touches(path, request.radius), self.faults(path, request)
        return Verdict("found", tuple(touches), tuple(faults), length_m=path.distance)

    def point_is_free(self, place: Place, radius_m: float, spare_m: float = 0.0) -> bool:
        """Whether a robot fits at a place with `spare_m` of additional clearance."""
        return self.floors[place.floor].point_is_free(place[1:], radius_m + spare_m)

    # Paths.

    def touches(self, path: Path, radius_m: float) -> list[str]:
        """Where the path comes nearer than the radius to an obstacle or leaves the outline, one sentence for each."""
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
                is_against = self._is_against_lane(a.floor, (a.x, a.y), (b.x, b.y), request.radius)
                if request.mode is not RouteMode.GEOMETRIC and is_against and not self._is_along_edge(a, b):
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
        if any(shaft.distance(Point(point.x, point.y)) > TOLERANCE_M for point in (a, b)):
            found.append(f"the ride begins or ends outside the shaft of {a.elevator}")
        return found

    def _node_faults(self, point: PathPoint) -> list[str]:
        if not point.node:
            return []
        node = self.building.floors[point.floor].topological.nodes.get(point.node)
        if node is None or math.dist(node.at, (point.x, point.y)) > 1e-9:
            return [f"{point.node} is not at {point.floor}:{point.x},{point.y}"]
        return []

    def _is_against_lane(self, floor: str, a: XY, b: XY, radius_m: float) -> bool:
        """Whether a drive goes back beside a one-way edge for more than the robot's diameter."""
        drive, line = np.subtract(b, a), LineString([a, b])
        for lane in self.floors[floor].lanes:
            if drive @ np.diff(shapely.get_coordinates(lane), axis=0)[0] >= 0.0:
                continue
            shared = shapely.get_coordinates(line.intersection(lane.buffer(radius_m - TOLERANCE_M, cap_style="flat")))
            along = [lane.project(Point(point)) for point in shared]
            if along and max(along) - min(along) > 2 * radius_m + TOLERANCE_M:
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
            if all(line.distance(Point(point.x, point.y)) <= TOLERANCE_M for point in (a, b)):
                return True
        return False

    # Refusals.

    def path_exists(self, request: PathRequest) -> bool:
        """Whether a path that the mode allows certainly exists, although the planner found none."""
        if request.mode is RouteMode.TOPOLOGICAL:
            return self._path_exists_on_roads(request)
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
        if without_lanes and floor.is_near_lane(start[1:], goal[1:], request.radius):
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

    def _path_exists_on_roads(self, request: PathRequest) -> bool:
        """Whether networkx finds a route on the roadmap between the nodes in sight, else those around corners."""
        graph = self.roads(request.radius, spare_m=TOLERANCE_M)
        reached = starts = set(self._certain_nodes(request.start, request.radius))
        for node in starts:
            reached = reached | nx.descendants(graph, node)
        return not reached.isdisjoint(self._certain_nodes(request.goal, request.radius))

    def _certain_nodes(self, place: Place, radius_m: float) -> list[tuple[str, str]]:
        """The nodes to and from which a robot can certainly drive."""
        floor = self.floors[place.floor]
        nodes = list(self.building.floors[place.floor].topological.nodes.values())
        on = [node for node in nodes if math.dist(node.at, place[1:]) < ON_NODE_M]
        if on:
            nodes = on[:1]
        lines = [(place[1:], node.at) for node in nodes]
        touching = floor.touching(lines, radius_m + TOLERANCE_M)
        in_sight = [
            node
            for i, node in enumerate(nodes)
            if i not in touching and not floor.is_near_lane(place[1:], node.at, radius_m)
        ]
        if not in_sight and not floor.lanes:
            grid = self.grid(place.floor, radius_m)
            parts = grid.parts(place[1:])
            in_sight = [node for node in nodes if parts & grid.parts(node.at)]
        return [(place.floor, node.name) for node in in_sight]

    def roads(self, radius_m: float, speed: float | None = None, spare_m: float = 0.0) -> nx.DiGraph:
        """The roadmap that a robot can use: edges with `spare_m` of additional clearance, and rides. Weights are
        seconds at `speed` [m/s], metres without."""
        key = (radius_m, speed, spare_m)
        if key in self._roads:
            return self._roads[key]
        graph: nx.DiGraph = nx.DiGraph()
        stops: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.building.floors.items():
            nodes, edges = entry.topological.nodes, list(entry.topological.edges.values())
            for node in nodes.values():
                graph.add_node((name, node.name))
                if node.elevator and name in self.building.elevators[node.elevator].floors():
                    stops.setdefault(node.elevator, []).append((name, node.name))
            touching = self.floors[name].touching(
                [(nodes[edge.a].at, nodes[edge.b].at) for edge in edges], radius_m + spare_m
            )
            for i, edge in enumerate(edges):
                if i in touching or 0.0 < edge.clearance < radius_m:
                    continue
                length = math.dist(nodes[edge.a].at, nodes[edge.b].at)
                cost = length / min(speed, edge.speed_limit or speed) if speed else length
                graph.add_edge((name, edge.a), (name, edge.b), weight=cost)
                if not edge.one_way:
                    graph.add_edge((name, edge.b), (name, edge.a), weight=cost)
        for elevator, places in stops.items():
            for a, b in permutations(places, 2):
                if a[0] != b[0]:
                    wait, travel, climb = ride(self.building, self.building.elevators[elevator], a[0], b[0])
                    inside = math.dist(
                        *(self.building.floors[floor].topological.nodes[name].at for floor, name in (a, b))
                    )
                    cost = wait + travel + inside / speed if speed else climb + inside
                    known = graph.get_edge_data(a, b, {"weight": math.inf})["weight"]
                    graph.add_edge(a, b, weight=min(cost, known))
        self._roads[key] = graph
        return graph

    # Costs and lengths.

    def roadmap_cost(self, request: PathRequest) -> float | None:
        """Cost of the cheapest route along the topological map [m or s]; infinite if there is none, None if an end
        sees no node."""
        speed = request.speed if request.best is Criterion.SHORTEST_TIME else None
        starts = self._nodes_in_sight(request.start, request.radius, outbound=True)
        goals = self._nodes_in_sight(request.goal, request.radius, outbound=False)
        if not starts or not goals:
            return None
        graph = self.roads(request.radius, speed)
        graph.add_weighted_edges_from(
            ("start", node, self._tie(request, node, length, True)) for node, length in starts
        )
        graph.add_weighted_edges_from((node, "goal", self._tie(request, node, length, False)) for node, length in goals)
        try:
            return float(nx.dijkstra_path_length(graph, "start", "goal"))
        except nx.NetworkXNoPath:
            return math.inf
        finally:
            graph.remove_nodes_from(["start", "goal"])

    def _tie(self, request: PathRequest, node: tuple[str, str], length: float, outbound: bool) -> float:
        """Cost of the straight drive between an end and a node [m or s], with the speed limits of edges beside it."""
        if request.best is not Criterion.SHORTEST_TIME:
            return length
        if (key := (request.radius, request.speed)) not in self._plans:
            self._plans[key] = Plan(self.building, PathRequest(request.start, request.goal, *key))
        at = self.building.floors[node[0]].topological.nodes[node[1]].at
        ends = (request.start[1:], at) if outbound else (at, request.goal[1:])
        return self._plans[key].floors[node[0]].slowest(*ends)

    def _nodes_in_sight(self, place: Place, radius_m: float, outbound: bool) -> list[tuple[tuple[str, str], float]]:
        """The nearest nodes that the planner connects a place to by a straight drive, and their distances [m]."""
        nodes = sorted(
            (math.dist(place[1:], node.at), node.name, node.at)
            for node in self.building.floors[place.floor].topological.nodes.values()
        )
        touching = self.floors[place.floor].touching([(place[1:], at) for _, _, at in nodes], radius_m)
        found = [
            ((place.floor, name), length)
            for i, (length, name, at) in enumerate(nodes)
            if i not in touching
            and not self._is_against_lane(place.floor, *((place[1:], at) if outbound else (at, place[1:])), radius_m)
        ]
        if found and found[0][1] < ON_NODE_M:
            return found[:1]
        return [each for each in found if each[1] <= found[0][1] + CONNECTION_REACH_M][:MAX_CONNECTIONS]

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
        if self._is_straight(request, without_lanes=False):
            return math.dist(request.start[1:], request.goal[1:])
        places = {
            (floor, name): Place(floor, *cabin_place(self.building, name, floor))
            for name, elevator in self.building.elevators.items()
            for floor in elevator.floors()
        }
        places |= {("", "start"): request.start, ("", "goal"): request.goal}  # last: paths are searched from cabins
        graph: nx.Graph = nx.Graph()
        graph.add_nodes_from(places)
        for (a, origin), (b, target) in combinations(places.items(), 2):
            if origin.floor == target.floor:
                graph.add_edge(a, b, weight=self._length_on_grid(origin, target, request.radius))
            elif a[1] == b[1]:
                graph.add_edge(a, b, weight=abs(self._height(origin.floor) - self._height(target.floor)))
        return float(nx.single_source_dijkstra_path_length(graph, ("", "start")).get(("", "goal"), math.inf))

    def _length_on_grid(self, origin: Place, target: Place, radius_m: float) -> float:
        """Length of a path between two places of a floor [m]."""
        grid = self.grid(origin.floor, radius_m)
        starts, ends = grid.links(origin[1:]), grid.links(target[1:])
        if not starts or not ends:
            return math.inf
        cell, first = starts[0]
        lengths = self._lengths_from(origin.floor, cell, radius_m)
        return min(first + float(lengths[end]) + last for end, last in ends)

    def _compute_lengths_from(self, floor: str, cell: Cell, radius_m: float) -> Array:
        return self.grid(floor, radius_m).octile.lengths_from(cell)


def errors(building: Building, path: Path, request: PathRequest) -> list[str]:
    """Collisions and other errors of a path, one sentence for each."""
    judge = Judge(building)
    return judge.touches(path, request.radius) + judge.faults(path, request)
