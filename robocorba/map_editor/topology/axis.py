"""The medial axis of the free space, and bridges between its components."""

from __future__ import annotations

import math
from typing import TypeAlias

import networkx as nx
import numpy as np
import shapely
from scipy.spatial import Voronoi
from shapely import Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.topology.roadmap import RoadmapGraph, midpoint
from robocorba.map_editor.topology.sites import sites_of

#: Minimum distance of the two sites of an axis segment [radii]. Segments between closer sites lead into a gap or
#: away from a single wall, as those between two sites on one side of an obstacle do. Every value below 2 keeps the
#: connectivity of the free space, by the theorem on the lambda medial axis (Chazal and Lieutier, 2005): sites on both
#: sides of a passage that the robot fits through are two radii apart.
MIN_SITE_DISTANCE_RADII = 1.5

#: A node of a bridge: a node of the roadmap, or the midpoint of a triangle's side.
BridgePoint: TypeAlias = int | XY


def draw_axis(roadmap: RoadmapGraph, outlines: list[BaseGeometry]) -> None:
    """Add the free part of the medial axis of the outlines."""
    sites, on_sides = sites_of(outlines, roadmap.radius)
    centre = sites.mean(axis=0)  # qhull is most precise near the origin
    if len(sites) < 5 or np.linalg.matrix_rank(sites - centre) < 2:
        return
    roadmap.check_time()
    # qhull takes thirty times as long for many points on one line: each is shifted by at most 10 µm, far less than
    # anything that is drawn.
    diagram = Voronoi(sites - centre + np.random.default_rng(0).uniform(-1e-5, 1e-5, sites.shape))
    roadmap.check_time()
    corners = diagram.vertices + centre
    ends = np.asarray(diagram.ridge_vertices)
    pair = diagram.ridge_points
    apart = np.linalg.norm(sites[pair[:, 0]] - sites[pair[:, 1]], axis=1)
    kept = np.flatnonzero((ends >= 0).all(axis=1) & (apart >= MIN_SITE_DISTANCE_RADII * roadmap.radius))
    shared = on_sides[pair[kept, 0]].multiply(on_sides[pair[kept, 1]])
    kept = kept[np.asarray(shared.sum(axis=1)).reshape(-1) == 0]  # not between two sites of one straight side
    kept = kept[shapely.covers(roadmap.space, shapely.linestrings(corners[ends[kept]]))]
    numbers: dict[int, int] = {}
    for ridge in kept.tolist():
        a, b = ends[ridge].tolist()
        for corner in (a, b):
            if corner not in numbers:
                clear = float(np.linalg.norm(corners[corner] - sites[pair[ridge, 0]]))
                numbers[corner] = roadmap.add((float(corners[corner, 0]), float(corners[corner, 1])), clear)
        roadmap.graph.add_edge(numbers[a], numbers[b])


def connect_components(roadmap: RoadmapGraph) -> None:
    """Give each component of the free space exactly one connected component of the graph.

    The axis has its connectivity already, except in passages that are barely wide enough."""
    for room, nodes_in_room in zip(roadmap.rooms, _nodes_by_room(roadmap), strict=True):
        if not nodes_in_room:
            inside = room.representative_point()
            roadmap.add((inside.x, inside.y))
            continue
        pieces = list(nx.connected_components(roadmap.graph.subgraph(nodes_in_room)))
        if len(pieces) > 1:
            _bridge(roadmap, room, [min(piece) for piece in pieces], nodes_in_room)


def _nodes_by_room(roadmap: RoadmapGraph) -> list[list[int]]:
    """The nodes in each room."""
    nodes = list(roadmap.graph)
    points = shapely.points(np.array([roadmap.at(node) for node in nodes]).reshape(-1, 2))
    by_room: list[list[int]] = [[] for _ in roadmap.rooms]
    for room, i in STRtree(points).query(roadmap.rooms, predicate="intersects").T.tolist():
        by_room[room].append(nodes[i])
    return by_room


def _bridge(roadmap: RoadmapGraph, room: Polygon, targets: list[int], nodes_in_room: list[int]) -> None:
    """Connect components of the graph, each given by one node, across the triangles of a room."""
    graph = _bridge_graph(roadmap, room, nodes_in_room)
    added: dict[XY, int] = {}
    for target in targets[1:]:
        roadmap.check_time()
        nodes = []
        for step in nx.shortest_path(graph, targets[0], target, weight="weight"):
            if not isinstance(step, int) and step not in added:
                added[step] = roadmap.add(step)
            nodes.append(step if isinstance(step, int) else added[step])
        nx.add_path(roadmap.graph, nodes)


def _bridge_graph(roadmap: RoadmapGraph, room: Polygon, nodes_in_room: list[int]) -> nx.Graph[BridgePoint]:
    """All connections in a room: between triangles, from each node to the sides of its triangle, and roadmap edges."""
    graph: nx.Graph[BridgePoint] = nx.Graph()
    for a, b in roadmap.graph.subgraph(nodes_in_room).edges:
        graph.add_edge(a, b, weight=0.01 * roadmap.length(a, b))  # a choice: existing edges win
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room)).tolist()
    midpoints: list[list[XY]] = []
    for triangle in triangles:
        corners = sorted(triangle.exterior.coords[:3])
        midpoints.append([midpoint(p, q) for p, q in ((corners[0], corners[1]), (corners[0], corners[2]), corners[1:])])
        for i, p in enumerate(midpoints[-1]):
            for q in midpoints[-1][:i]:
                graph.add_edge(p, q, weight=math.dist(p, q))
    tree = STRtree(triangles)
    for node in nodes_in_room:
        for i in tree.query(Point(roadmap.at(node)), predicate="intersects").tolist():
            for point in midpoints[i]:
                graph.add_edge(node, point, weight=math.dist(roadmap.at(node), point))
    return graph
