"""The medial axis of the free space, and the bridges where it is broken."""

from __future__ import annotations

import math
from typing import TypeAlias

import networkx as nx
import numpy as np
import shapely
from scipy.spatial import Voronoi
from shapely import Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.maps.topology.roadmap import RoadmapGraph, midpoint
from robocorba.spatial.pose import XY

#: Points along the obstacles are at most this many radii apart, while there are fewer than MAX_SITES.
SITE_SPACING_RADII = 0.4
MAX_SITES = 200_000
#: An axis piece between two sites closer than this many radii leads into a gap or away from one wall: no road.
#: Anything below 2 keeps every connection of the free space (the lambda medial axis).
MIN_SITE_DISTANCE_RADII = 1.5

#: A stop on a bridge: a node of the roadmap, or the middle of a triangle's side.
BridgePoint: TypeAlias = int | XY


def draw_axis(roadmap: RoadmapGraph, outlines: list[BaseGeometry]) -> None:
    """Add the medial axis of the outlines, as far as it is free."""
    step = max(SITE_SPACING_RADII * roadmap.radius, float(shapely.length(outlines).sum()) / MAX_SITES)
    sites = shapely.get_coordinates(shapely.segmentize(outlines, step))
    sites = np.unique(np.round(sites, 7), axis=0)
    centre = sites.mean(axis=0)  # near the origin qhull is exact
    if len(sites) < 5 or np.linalg.matrix_rank(sites - centre) < 2:
        return
    diagram = Voronoi(sites - centre)
    corners = diagram.vertices + centre
    ends = np.asarray(diagram.ridge_vertices)
    pair = diagram.ridge_points
    apart = np.linalg.norm(sites[pair[:, 0]] - sites[pair[:, 1]], axis=1)
    kept = np.flatnonzero((ends >= 0).all(axis=1) & (apart >= MIN_SITE_DISTANCE_RADII * roadmap.radius))
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
    """Make each part of the free space hold exactly one connected piece of the graph.

    The axis has its connections already, except where a passage is only just wide enough."""
    for room, mine in zip(roadmap.rooms, _nodes_by_room(roadmap), strict=True):
        if not mine:
            place = room.representative_point()
            roadmap.add((place.x, place.y))
            continue
        pieces = list(nx.connected_components(roadmap.graph.subgraph(mine)))
        if len(pieces) > 1:
            _bridge(roadmap, room, [min(piece) for piece in pieces], mine)


def _nodes_by_room(roadmap: RoadmapGraph) -> list[list[int]]:
    """The nodes that lie in each room."""
    nodes = list(roadmap.graph)
    places = shapely.points(np.array([roadmap.at(node) for node in nodes]).reshape(-1, 2))
    homes: list[list[int]] = [[] for _ in roadmap.rooms]
    for room, i in STRtree(places).query(roadmap.rooms, predicate="intersects").T.tolist():
        homes[room].append(nodes[i])
    return homes


def _bridge(roadmap: RoadmapGraph, room: Polygon, targets: list[int], mine: list[int]) -> None:
    """Join pieces of the graph, each given by one node, over the triangles of a room."""
    web = _bridge_graph(roadmap, room, mine)
    added: dict[XY, int] = {}
    for target in targets[1:]:
        nodes = []
        for stop in nx.shortest_path(web, targets[0], target, weight="weight"):
            if not isinstance(stop, int) and stop not in added:
                added[stop] = roadmap.add(stop)
            nodes.append(stop if isinstance(stop, int) else added[stop])
        nx.add_path(roadmap.graph, nodes)


def _bridge_graph(roadmap: RoadmapGraph, room: Polygon, mine: list[int]) -> nx.Graph[BridgePoint]:
    """All ways in a room from triangle to triangle, from each node to its triangle's sides, and along its roadmap."""
    web: nx.Graph[BridgePoint] = nx.Graph()
    for a, b in roadmap.graph.subgraph(mine).edges:
        web.add_edge(a, b, weight=0.01 * roadmap.length(a, b))  # roadmap that are there already come first
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room)).tolist()
    gates: list[list[XY]] = []
    for triangle in triangles:
        corners = sorted(triangle.exterior.coords[:3])
        gates.append([midpoint(p, q) for p, q in ((corners[0], corners[1]), (corners[0], corners[2]), corners[1:])])
        for i, p in enumerate(gates[-1]):
            for q in gates[-1][:i]:
                web.add_edge(p, q, weight=math.dist(p, q))
    tree = STRtree(triangles)
    for node in mine:
        for i in tree.query(Point(roadmap.at(node)), predicate="intersects").tolist():
            for gate in gates[i]:
                web.add_edge(node, gate, weight=math.dist(roadmap.at(node), gate))
    return web
