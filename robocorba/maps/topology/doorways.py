"""Nodes that have a reason to be where they are: in cabins, in front of them, in doorways, and at places on the map."""

from __future__ import annotations

import math
from collections.abc import Iterable

import networkx as nx
import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import LineString, Polygon

from robocorba.maps import geometry
from robocorba.maps.model import Elevator, ElevatorDoor, PathNode, Side
from robocorba.maps.topology.roads import SAME_PLACE_M, Roads
from robocorba.spatial.pose import XY

#: A node waits in front of an elevator, so many radii from its door; the first that is free.
FRONT_RADII = (2.5, 2.0, 1.5, 1.1)
#: A node that wants to join the roads looks at so many of the nearest nodes; further ones are out of sight.
MOST_LOOKED_AT = 200

_TURN_OF = {Side.FRONT: -math.pi / 2, Side.BACK: math.pi / 2, Side.LEFT: math.pi, Side.RIGHT: 0.0}


def enter_cabin(roads: Roads, elevator: Elevator, floor: str, places: Iterable[PathNode] = ()) -> None:
    """A node in the cabin, one in front of each of its doors here, and a straight way between them.

    A place in the cabin that is free becomes that node."""
    stop = next((place for place in places if place.elevator == elevator.name and roads.free(place.at)), None)
    middle = stop.at if stop else elevator.at
    if not roads.free(middle):
        return
    graph = roads.graph
    cabin = roads.add(middle, fixed=True, elevator=elevator.name, place=stop.name if stop else "")
    inside, outside = _split(roads, geometry.shaft_polygon(elevator), but=cabin)
    edges, tree = roads.lines()
    for door in [door for door in elevator.doors if door.floor == floor]:
        doorway = geometry.landing_line(elevator, door)
        threshold, fronts = _approach(elevator, door, doorway, roads.radius)
        front = next((at for at in fronts if roads.free(at, threshold) and roads.free(threshold, middle)), None)
        if front is not None:
            graph.remove_edges_from([edges[i] for i in tree.query(doorway, predicate="intersects")])
            waiting = roads.add(front, fixed=True)
            _join(roads, waiting, outside)
            nx.add_path(graph, [waiting, roads.add(threshold), cabin])
    if graph[cabin]:  # the axis inside is of no more use, unless it still leads out of another door
        for piece in [piece for piece in nx.connected_components(graph) if piece <= set(inside)]:
            graph.remove_nodes_from(piece)
    _join(roads, cabin, [node for node in inside if node in graph])


def _approach(elevator: Elevator, door: ElevatorDoor, doorway: LineString, radius_m: float) -> tuple[XY, list[XY]]:
    """The middle of an elevator's doorway, and places in front of it, best first."""
    threshold = doorway.interpolate(0.5, normalized=True)
    out = elevator.heading + _TURN_OF[door.side]
    fronts = [
        (threshold.x + radii * radius_m * math.cos(out), threshold.y + radii * radius_m * math.sin(out))
        for radii in FRONT_RADII
    ]
    return (threshold.x, threshold.y), fronts


def _split(roads: Roads, shape: Polygon, but: int) -> tuple[list[int], list[int]]:
    """The nodes inside and outside of a shape."""
    nodes = [node for node in roads.graph if node != but]
    within = shapely.contains_xy(shape, np.array([roads.at(node) for node in nodes]).reshape(-1, 2))
    numbers = np.array(nodes, dtype=int)
    return numbers[within].tolist(), numbers[~within].tolist()


def _join(roads: Roads, node: int, others: list[int]) -> None:
    """Link a node to the nearest of others that it sees."""
    places = np.array([roads.at(n) for n in others]).reshape(-1, 2)
    for i in np.argsort(np.hypot(*(places - roads.at(node)).T), kind="stable")[:MOST_LOOKED_AT].tolist():
        if roads.free(roads.at(node), roads.at(others[i])):
            roads.graph.add_edge(node, others[i])
            return


def mark_doorways(roads: Roads, doors: Iterable[LineString]) -> None:
    """A fixed node where the axis passes a doorway, in its middle if it may be there."""
    edges, tree = roads.lines()
    for door in doors:
        centre = door.interpolate(0.5, normalized=True)
        found = tree.query(door, predicate="intersects")
        if len(found) == 0:
            continue
        nearest = min(found.tolist(), key=lambda i: (tree.geometries[i].distance(centre), i))
        a, b = edges[nearest]
        if not roads.graph.has_edge(a, b):
            continue  # split by another door at the same place
        crossing = shapely.shortest_line(tree.geometries[nearest].intersection(door), centre).coords[0]
        best: XY = (centre.x, centre.y)
        here = best if roads.free(roads.at(a), best) and roads.free(best, roads.at(b)) else crossing
        roads.graph.remove_edge(a, b)
        nx.add_path(roads.graph, [a, roads.add(here, door.length / 2, fixed=True), b])


def visit(roads: Roads, places: Iterable[PathNode]) -> None:
    """A node at each place where the robot fits, unless it is one already or another is there."""
    special = [node for node in roads.graph if roads.place(node) or roads.elevator(node)]
    names, taken = {roads.place(node) for node in special}, [roads.at(node) for node in special]
    others = list(roads.graph)
    tree = cKDTree(np.array([roads.at(node) for node in others]).reshape(-1, 2))
    for place in places:
        if place.name in names or not roads.free(place.at):
            continue
        if any(math.dist(place.at, other) <= SAME_PLACE_M for other in taken):
            continue
        node = roads.add(place.at, fixed=True, elevator=place.elevator, place=place.name)
        taken.append(place.at)
        if others:
            nearest = tree.query(place.at, k=[*range(1, min(MOST_LOOKED_AT, len(others)) + 1)])[1]
            _join(roads, node, [others[i] for i in nearest.tolist()])
