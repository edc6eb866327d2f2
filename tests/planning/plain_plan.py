"""A building as shapely geometry and a networkx graph for one request, made without the planner's code: only the map
and its obstacles (robocorba.map_editor) and the classes of requests are shared with it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import permutations
from typing import NamedTuple, TypeAlias

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building, Elevator, PathEdge, PathNode
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode

Node: TypeAlias = tuple[str, str]
#: Tolerance for rounding [m].
TOLERANCE_M = 1e-6
#: path_planner.idl: a place is connected to nodes in sight at most this much farther than the nearest one [m]; the
#: planner takes at most so many of them; nearer than ON_NODE_M it is on a node.
TIE_REACH_M, MAX_TIES, ON_NODE_M = 6.0, 8, 0.01
#: Clearance beyond the radius in the parts of the free space, and how far a place is from one at most [m].
PART_MARGIN_M, PART_REACH_M = 0.01, 0.3


class Lane(NamedTuple):
    """All edges between two nodes: for each direction the largest radius [m] and speed [m/s] that one of them allows
    the request; -1 if none does."""

    line: LineString
    widest: tuple[float, float]
    speed: tuple[float, float]

    def is_closed(self, direction: int, radius: float) -> bool:
        return radius > self.widest[direction] + 1e-9

    @property
    def has_rule(self) -> bool:
        return min(*self.widest, *self.speed) < math.inf


class FloorPlan:
    """One floor for the options of a request: its start, goal, mode and criterion do not matter."""

    def __init__(self, building: Building, name: str, request: PathRequest) -> None:
        self.building, self.name, self.request = building, name, request
        entry = building.floors[name]
        self.nodes = entry.topological.nodes
        self.edges = list(entry.topological.edges.values())
        movables = {item.name for item in entry.geometrical.objects.values() if item.movable}
        ignored = movables if name in request.without_movables else set()
        polygons = [polygon for floor, polygon in request.forbidden_areas if floor == name]
        polygons += [entry.geometrical.areas[area].polygon for floor, area in request.avoid_areas if floor == name]
        shapes = [
            item.geometry for item in obstacles(building, name) if (item.kind, item.name in ignored) != ("object", True)
        ]
        self.shapes = np.array([*shapes, *map(Polygon, polygons)], object)
        self.outline = Polygon(entry.floor.outline) if entry.floor.outline else None
        if self.outline is not None:
            shapely.prepare(self.outline)
        self._tree = STRtree(self.shapes)
        self._usable: dict[tuple[str, float], bool] = {}
        self._parts: dict[bool, NDArray[np.object_]] = {}
        self.lanes = list(self._lanes())
        self._strips = np.array(
            [lane.line.buffer(max(request.radius - TOLERANCE_M, 1e-9), cap_style="flat") for lane in self.lanes], object
        )

    # Geometry.

    def clearance(self, a: XY, b: XY) -> float:
        """Distance of a drive to the nearest obstacle [m]; negative outside the outline."""
        line = self.drive(a, b)
        if self.outline is not None and not self.outline.covers(line):
            return -1.0
        return float(shapely.distance(self.shapes, line).min(initial=math.inf))

    def drive(self, a: XY, b: XY) -> BaseGeometry:
        return LineString([a, b]) if math.dist(a, b) > 1e-12 else Point(a)

    def is_free(self, a: XY, b: XY, spare_m: float) -> bool:
        """Whether a drive keeps the radius, and `spare_m` more, from all obstacles."""
        line, reach = self.drive(a, b), self.request.radius + spare_m
        if self.outline is not None and not self.outline.covers(line):
            return False
        hits = self._tree.query(line, "dwithin", reach) if reach > 0.0 else self._tree.query(line, "crosses")
        return not len(hits)

    def usable(self, edge: PathEdge, spare_m: float) -> bool:
        """Whether the request's robot may use an edge and fits along it."""
        key = edge.name, spare_m
        if key not in self._usable:
            ends = self.nodes[edge.a].at, self.nodes[edge.b].at
            self._usable[key] = self.is_open(edge) and self.is_free(*ends, spare_m)
        return self._usable[key]

    # Rules of edges.

    def is_open(self, edge: PathEdge) -> bool:
        """Whether the request's robot may use an edge, walls aside."""
        graph, radius = self.request.graph, self.request.radius
        return not (graph and edge.graphs and graph not in edge.graphs) and not 0.0 < edge.clearance < radius - 1e-9

    def _lanes(self) -> Iterator[Lane]:
        pairs: dict[frozenset[str], list[PathEdge]] = {}
        for edge in self.edges:
            if self.nodes[edge.a].at != self.nodes[edge.b].at:
                pairs.setdefault(frozenset((edge.a, edge.b)), []).append(edge)
        for edges in pairs.values():
            a, b = edges[0].a, edges[0].b
            widest, speed = [-1.0, -1.0], [-1.0, -1.0]
            for edge in edges:
                if self.request.graph and edge.graphs and self.request.graph not in edge.graphs:
                    continue
                there = 0 if edge.a == a else 1
                for direction in (there,) if edge.one_way else (0, 1):
                    widest[direction] = max(widest[direction], edge.clearance or math.inf)
                    speed[direction] = max(speed[direction], edge.speed_limit or math.inf)
            yield Lane(LineString([self.nodes[a].at, self.nodes[b].at]), tuple(widest), tuple(speed))  # type: ignore

    def followed(self, a: XY, b: XY) -> list[tuple[Lane, int, float]]:
        """The lanes that a drive follows: each with the direction and the length [m] of the drive beside it."""
        if math.dist(a, b) <= 2 * self.request.radius or not self.lanes:
            return []
        line, found = LineString([a, b]), []
        for i in np.flatnonzero(shapely.intersects(self._strips, line)):
            shared, lane = line.intersection(self._strips[i]), self.lanes[i]
            along = [lane.line.project(Point(point)) for point in shapely.get_coordinates(shared)]
            if max(along) - min(along) > 2 * self.request.radius + 2 * TOLERANCE_M:
                (px, py), (qx, qy) = lane.line.coords
                ahead = (b[0] - a[0]) * (qx - px) + (b[1] - a[1]) * (qy - py)
                found.append((lane, 0 if ahead >= 0.0 else 1, shared.length))
        return found

    def follows_closed(self, a: XY, b: XY) -> bool:
        return any(lane.is_closed(direction, self.request.radius) for lane, direction, _ in self.followed(a, b))

    def slowest(self, a: XY, b: XY) -> float:
        """Least time of a drive [s] off the roads by the speed limits of the lanes that it follows."""
        line, speed = self.drive(a, b), self.request.speed
        limited = [(lane, lane.speed[way]) for lane, way, _ in self.followed(a, b) if 0.0 < lane.speed[way] < speed]
        seconds, rest = 0.0, line
        for lane, limit in sorted(limited, key=lambda each: each[1]):
            strip = lane.line.buffer(max(self.request.radius - TOLERANCE_M, 1e-9), cap_style="flat")
            seconds += rest.intersection(strip).length / limit
            rest = rest.difference(strip)
        return seconds + rest.length / speed

    def is_near_rules(self, a: XY, b: XY, spare_m: float = 0.05) -> bool:
        """Whether a drive comes near a lane with a rule, so that another reading of the rules could forbid it."""
        line = self.drive(a, b)
        return any(lane.has_rule and line.distance(lane.line) <= self.request.radius + spare_m for lane in self.lanes)

    def crosses_closed(self, place: XY, a: XY, b: XY) -> bool:
        """Whether a drive that connects a place to the map crosses a lane that is closed both ways, on which the robot
        does not stand."""
        line = self.drive(a, b)
        return any(
            line.crosses(lane.line) and lane.line.distance(Point(place)) > self.request.radius + TOLERANCE_M
            for lane in self.lanes
            if all(lane.is_closed(direction, self.request.radius) for direction in (0, 1))
            and min(lane.line.distance(Point(end)) for end in (a, b)) > TOLERANCE_M
        )

    # Ties.

    def ties(self, place: XY, outbound: bool) -> list[tuple[PathNode, float, float]]:
        """The nodes in sight that a place is connected to: each with the distance [m] and the time [s]."""
        found: list[tuple[PathNode, float, float]] = []
        for node in sorted(self.nodes.values(), key=lambda node: math.dist(place, node.at)):
            length = math.dist(place, node.at)
            if found and length > found[0][1] + TIE_REACH_M:
                break
            a, b = (place, node.at) if outbound else (node.at, place)
            if not self.is_free(a, b, -TOLERANCE_M) or self.follows_closed(a, b) or self.crosses_closed(place, a, b):
                continue
            found.append((node, length, self.slowest(a, b)))
            if len(found) == MAX_TIES or length < ON_NODE_M:
                break
        return found

    def certain_ties(self, place: XY) -> list[PathNode]:
        """The nodes to and from which a robot can certainly drive, by any reading of the rules: those in sight, and
        where there are neither any nor rules, those around corners."""
        on = [node for node in self.nodes.values() if math.dist(node.at, place) < ON_NODE_M][:1]
        nodes = on or list(self.nodes.values())
        in_sight = [
            node
            for node in nodes
            if self.is_free(place, node.at, TOLERANCE_M) and not self.is_near_rules(place, node.at)
        ]
        if in_sight or any(lane.has_rule for lane in self.lanes):
            return in_sight
        parts = self.parts(place, False)
        return [node for node in nodes if parts & self.parts(node.at, False)]

    # Free space.

    def _free_parts(self, with_rules: bool) -> NDArray[np.object_]:
        """The connected parts of the space that is certainly free, with rules also away from closed lanes."""
        closed = [
            lane.line
            for lane in self.lanes
            if with_rules and any(lane.is_closed(direction, self.request.radius) for direction in (0, 1))
        ]
        key = bool(closed)
        if key not in self._parts:
            points = [Point(node.at) for node in self.nodes.values()]
            drawn = shapely.total_bounds([*self.shapes, *points, Point(0.0, 0.0)])
            region = self.outline or shapely.box(*drawn).buffer(3.0)
            grown = shapely.buffer([*self.shapes, *closed], (self.request.radius + PART_MARGIN_M) * 1.01)
            self._parts[key] = shapely.get_parts(region.difference(shapely.union_all(grown)))
        return self._parts[key]

    def parts(self, place: XY, with_rules: bool) -> set[int]:
        """The parts of the free space that a straight drive certainly leads to."""
        parts, at, found = self._free_parts(with_rules), Point(place), set()
        for i in np.flatnonzero(shapely.dwithin(parts, at, PART_REACH_M)).tolist():
            nearest, _ = shapely.shortest_line(parts[i], at).coords
            if self.is_free(place, nearest, TOLERANCE_M) and not (with_rules and self.is_near_rules(place, nearest)):
                found.add(i)
        return found


class Plan:
    """A building for a request: its floors, rides and roads."""

    def __init__(self, building: Building, request: PathRequest, floors: dict[str, FloorPlan]) -> None:
        self.building, self.request, self.floors = building, request, floors
        self.height = {name: entry.floor.elevation for name, entry in building.floors.items()}
        self.lifts = {name: lift for name, lift in building.elevators.items() if name not in request.avoid_elevators}

    def ride_s(self, lift: Elevator, origin: str, destination: str) -> tuple[float, float]:
        """Mean seconds of waiting, and of the ride: doors close, travel, doors open."""
        served = list(dict.fromkeys(door.floor for door in lift.doors))
        to_landing = [self._travel_s(lift, self.height[name] - self.height[origin]) for name in served]
        travel = self._travel_s(lift, self.height[destination] - self.height[origin])
        return sum(to_landing) / len(served) + lift.door_time, 2 * lift.door_time + travel

    def _travel_s(self, lift: Elevator, climb: float) -> float:
        """From rest to rest with 1 m/s²."""
        if abs(climb) < lift.speed**2:
            return 2 * math.sqrt(abs(climb))
        return abs(climb) / lift.speed + lift.speed

    def roads(self, spare_m: float = -TOLERANCE_M) -> nx.DiGraph[Node]:
        """Nodes, usable edges and rides; weights by the request's criterion."""
        by_time, speed = self.request.best is Criterion.SHORTEST_TIME, self.request.speed
        graph: nx.DiGraph[Node] = nx.DiGraph()

        def link(a: Node, b: Node, weight: float) -> None:
            if weight < graph.get_edge_data(a, b, {"weight": math.inf})["weight"]:
                graph.add_edge(a, b, weight=weight)

        for name, plan in self.floors.items():
            graph.add_nodes_from((name, node) for node in plan.nodes)
            for edge in plan.edges:
                if plan.usable(edge, spare_m):
                    length = math.dist(plan.nodes[edge.a].at, plan.nodes[edge.b].at)
                    cost = length / min(speed, edge.speed_limit or speed) if by_time else length
                    for a, b in ((edge.a, edge.b),) if edge.one_way else ((edge.a, edge.b), (edge.b, edge.a)):
                        link((name, a), (name, b), cost)
        for lift in self.lifts.values():
            served = {door.floor for door in lift.doors}
            stops = [(name, node) for name in served for node in self.floors[name].nodes.values()]
            stops = [(name, node) for name, node in stops if node.elevator == lift.name]
            for (origin, a), (destination, b) in permutations(stops, 2):
                inside = [self.floors[name].is_free(a.at, b.at, spare_m) for name in (origin, destination)]
                if origin != destination and any(inside):
                    driven = math.dist(a.at, b.at)
                    cost = abs(self.height[destination] - self.height[origin]) + driven
                    if by_time:
                        cost = sum(self.ride_s(lift, origin, destination)) + driven / speed
                    link((origin, a.name), (destination, b.name), cost)
        return graph

    def road_cost(self) -> float | None:
        """Cost of the cheapest route along the roads between the nodes in sight [m or s]; inf without one, None if an
        end sees no node."""
        by_time, start, goal = self.request.best is Criterion.SHORTEST_TIME, self.request.start, self.request.goal
        graph, ends = self.roads(), (("", "start"), ("", "goal"))
        starts = self.floors[start.floor].ties(start[1:], True)
        goals = self.floors[goal.floor].ties(goal[1:], False)
        if not starts or not goals:
            return None
        graph.add_nodes_from(ends)
        for node, length, seconds in starts:
            graph.add_edge(ends[0], (start.floor, node.name), weight=seconds if by_time else length)
        for node, length, seconds in goals:
            graph.add_edge((goal.floor, node.name), ends[1], weight=seconds if by_time else length)
        try:
            return float(nx.dijkstra_path_length(graph, *ends))
        except nx.NetworkXNoPath:
            return math.inf

    def certain_road(self) -> bool:
        """Whether the roads certainly lead from start to goal, by any reading of the rules."""
        graph, request = self.roads(TOLERANCE_M), self.request
        starts, goals = (
            {(place.floor, node.name) for node in self.floors[place.floor].certain_ties(place[1:])}
            for place in (request.start, request.goal)
        )
        reached = set(starts).union(*(nx.descendants(graph, node) for node in starts))
        return bool(reached & goals)

    def certain_way(self) -> bool:
        """Whether a path through free space certainly leads from start to goal, in smoothed mode away from closed
        edges."""
        request, with_rules = self.request, self.request.mode is RouteMode.SMOOTHED
        if self.is_straight(with_rules):
            return True
        graph: nx.Graph[tuple[str, object]] = nx.Graph()
        for name, lift in self.lifts.items():
            places = self.cabin_places(lift)
            for floor in {door.floor for door in lift.doors}:
                for i, place in enumerate(places):
                    graph.add_edges_from(
                        ((name, i), (floor, part)) for part in self.floors[floor].parts(place, with_rules)
                    )
        ends = (("start", ""), ("goal", ""))
        graph.add_nodes_from(ends)
        for end, place in zip(ends, (request.start, request.goal), strict=True):
            graph.add_edges_from(
                (end, (place.floor, part)) for part in self.floors[place.floor].parts(place[1:], with_rules)
            )
        return nx.has_path(graph, *ends)

    def is_straight(self, with_rules: bool) -> bool:
        """Whether a robot can certainly drive straight from start to goal."""
        start, goal = self.request.start, self.request.goal
        if start.floor != goal.floor:
            return False
        floor, ends = self.floors[start.floor], (start[1:], goal[1:])
        return floor.is_free(*ends, TOLERANCE_M) and not (with_rules and floor.is_near_rules(*ends))

    def cabin_places(self, lift: Elevator) -> list[XY]:
        nodes = [node for plan in self.floors.values() for node in plan.nodes.values()]
        return [node.at for node in nodes if node.elevator == lift.name] or [lift.at]

    def fits(self, place: Place, spare_m: float) -> bool:
        return self.floors[place.floor].is_free(place[1:], place[1:], spare_m)
