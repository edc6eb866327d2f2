"""Nodes with a fixed position: in cabins, in front of them, in doorways, and given ones."""

from __future__ import annotations

import math
from collections.abc import Iterable

import networkx as nx
import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import LineString, Polygon

from robocorba.map_editor import geometry
from robocorba.map_editor.model import CabinSide, Elevator, ElevatorDoor, PathNode
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.topology.roadmap import SAME_POINT_M, RoadmapGraph

#: Nearest nodes tried to connect a node to the roadmap; farther ones are hardly ever visible.
MAX_CANDIDATES = 200


def add_cabin_nodes(roadmap: RoadmapGraph, elevator: Elevator, floor: str, given: Iterable[PathNode] = ()) -> None:
    """Add a node in the cabin, one in front of each of its doors on the floor, and straight edges between them.

    A given node in the cabin, if it is free, becomes its node."""
    stop = next((node for node in given if node.elevator == elevator.name and roadmap.is_free(node.at)), None)
    middle = stop.at if stop else elevator.at
    if not roadmap.is_free(middle):
        return
    graph = roadmap.graph
    cabin = roadmap.add(middle, fixed=True, elevator=elevator.name, given_name=stop.name if stop else "")
    inside, outside = _split(roadmap, geometry.shaft_polygon(elevator), but=cabin)
    edges, tree = roadmap.lines()
    for door in [door for door in elevator.doors if door.floor == floor]:
        doorway = geometry.landing_line(elevator, door)
        threshold, fronts = _approach(elevator, door, doorway, roadmap.radius)
        front = next(
            (at for at in fronts if roadmap.is_free(at, threshold) and roadmap.is_free(threshold, middle)), None
        )
        if front is not None:
            graph.remove_edges_from([edges[i] for i in tree.query(doorway, predicate="intersects")])
            waiting = roadmap.add(front, fixed=True)
            _join(roadmap, waiting, outside)
            nx.add_path(graph, [waiting, roadmap.add(threshold), cabin])
    if graph[cabin]:  # removes the axis in the cabin, unless it leads through another door
        for piece in [piece for piece in nx.connected_components(graph) if piece <= set(inside)]:
            graph.remove_nodes_from(piece)
    _join(roadmap, cabin, [node for node in inside if node in graph])


def _approach(elevator: Elevator, door: ElevatorDoor, doorway: LineString, radius_m: float) -> tuple[XY, list[XY]]:
    """The middle of an elevator's doorway, and waiting positions in front of it, best first: choices from
    2.5 radii away down to 1.1, where the robot just clears the door, for narrow halls."""
    threshold = doorway.interpolate(0.5, normalized=True)
    turns = {CabinSide.FRONT: -math.pi / 2, CabinSide.BACK: math.pi / 2, CabinSide.LEFT: math.pi, CabinSide.RIGHT: 0.0}
    out = elevator.heading + turns[door.side]
    fronts = [
        (threshold.x + radii * radius_m * math.cos(out), threshold.y + radii * radius_m * math.sin(out))
        for radii in (2.5, 2.0, 1.5, 1.1)
    ]
    return (threshold.x, threshold.y), fronts


def _split(roadmap: RoadmapGraph, shape: Polygon, but: int) -> tuple[list[int], list[int]]:
    """The nodes inside and outside a shape."""
    nodes = [node for node in roadmap.graph if node != but]
    within = shapely.contains_xy(shape, np.array([roadmap.at(node) for node in nodes]).reshape(-1, 2))
    numbers = np.array(nodes, dtype=int)
    return numbers[within].tolist(), numbers[~within].tolist()


def _join(roadmap: RoadmapGraph, node: int, others: list[int]) -> None:
    """Connect a node to the nearest visible one of others."""
    points = np.array([roadmap.at(n) for n in others]).reshape(-1, 2)
    for i in np.argsort(np.hypot(*(points - roadmap.at(node)).T), kind="stable")[:MAX_CANDIDATES].tolist():
        if roadmap.is_free(roadmap.at(node), roadmap.at(others[i])):
            roadmap.graph.add_edge(node, others[i])
            return


def add_doorway_nodes(roadmap: RoadmapGraph, doors: Iterable[LineString]) -> None:
    """Add a fixed node where the axis passes a doorway, in its middle if that is free."""
    edges, tree = roadmap.lines()
    for door in doors:
        centre = door.interpolate(0.5, normalized=True)
        found = tree.query(door, predicate="intersects")
        if len(found) == 0:
            continue
        nearest = min(found.tolist(), key=lambda i: (tree.geometries[i].distance(centre), i))
        a, b = edges[nearest]
        if not roadmap.graph.has_edge(a, b):
            continue  # another door at the same point has split it
        crossing = shapely.shortest_line(tree.geometries[nearest].intersection(door), centre).coords[0]
        best: XY = (centre.x, centre.y)
        at = best if roadmap.is_free(roadmap.at(a), best) and roadmap.is_free(best, roadmap.at(b)) else crossing
        roadmap.graph.remove_edge(a, b)
        nx.add_path(roadmap.graph, [a, roadmap.add(at, door.length / 2, fixed=True), b])


def add_given_nodes(roadmap: RoadmapGraph, given: Iterable[PathNode]) -> None:
    """Add a node at each given node where the robot fits, unless it is the node of a cabin or its position is taken."""
    special = [node for node in roadmap.graph if roadmap.given_name(node) or roadmap.elevator(node)]
    names, taken = {roadmap.given_name(node) for node in special}, [roadmap.at(node) for node in special]
    others = list(roadmap.graph)
    tree = cKDTree(np.array([roadmap.at(node) for node in others]).reshape(-1, 2))
    for path_node in given:
        if path_node.name in names or not roadmap.is_free(path_node.at):
            continue
        if any(math.dist(path_node.at, other) <= SAME_POINT_M for other in taken):
            continue
        node = roadmap.add(path_node.at, fixed=True, elevator=path_node.elevator, given_name=path_node.name)
        taken.append(path_node.at)
        if others:
            nearest = tree.query(path_node.at, k=[*range(1, min(MAX_CANDIDATES, len(others)) + 1)])[1]
            _join(roadmap, node, [others[i] for i in nearest.tolist()])
