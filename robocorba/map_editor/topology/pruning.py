"""Removes dead ends without use, and loops around small obstacles."""

from __future__ import annotations

import heapq
from itertools import pairwise

import networkx as nx
import numpy as np
import shapely

from robocorba.map_editor.topology.roadmap import RoadmapGraph

#: A dead end is kept if it reaches this far beyond the free disc around its junction [radii] ... (a choice: a robot's
#: length and a half)
SPUR_RADII = 3.0
#: ... and this share of the disc's radius. The corner of a square reaches sqrt(2) - 1 = 0.41 beyond the disc in it, so
#: corners of rooms have no dead ends.
SPUR_SHARE = 0.6


def prune(roadmap: RoadmapGraph) -> None:
    """Remove dead ends without use, the shortest first."""
    graph = roadmap.graph
    for piece in nx.connected_components(graph):
        if not any(roadmap.is_fixed(node) for node in piece):
            # A component without fixed nodes keeps its node with the largest clearance.
            roadmap.hubs.add(max(piece, key=lambda node: (roadmap.clearance_m(node), -node)))
    waiting = [(_gain(roadmap, end), end[0], end) for end in _dead_ends(roadmap, list(graph))]
    heapq.heapify(waiting)
    while waiting:
        roadmap.check_time()
        gain, tip, end = heapq.heappop(waiting)
        if tip not in graph or gain >= 0:
            continue
        current = _dead_end(roadmap, tip)
        if current != end:
            if current:
                heapq.heappush(waiting, (_gain(roadmap, current), tip, current))
            continue
        graph.remove_nodes_from(end[:-1])
        shortened = _dead_end(roadmap, end[-1])
        if shortened:
            heapq.heappush(waiting, (_gain(roadmap, shortened), end[-1], shortened))

    for end in _dead_ends(roadmap, sorted(graph)):
        _shorten(roadmap, end)


def _dead_ends(roadmap: RoadmapGraph, nodes: list[int]) -> list[tuple[int, ...]]:
    return [end for end in (_dead_end(roadmap, node) for node in nodes) if end]


def _dead_end(roadmap: RoadmapGraph, tip: int) -> tuple[int, ...]:
    """The nodes from a loose end to its junction; empty if `tip` is no loose end or there is no junction."""
    graph = roadmap.graph
    if len(graph[tip]) != 1 or _is_kept(roadmap, tip):
        return ()
    chain = [tip]
    (node,) = graph[tip]
    while len(graph[node]) == 2 and not _is_kept(roadmap, node):
        (onward,) = (n for n in graph[node] if n != chain[-1])
        chain.append(node)
        node = onward
    return (*chain, node) if len(graph[node]) > 1 or _is_kept(roadmap, node) else ()


def _is_kept(roadmap: RoadmapGraph, node: int) -> bool:
    return node in roadmap.hubs or roadmap.is_fixed(node)


def _gain(roadmap: RoadmapGraph, end: tuple[int, ...]) -> float:
    """How far a dead end reaches beyond the free disc around its junction, less the required length [m]."""
    tip, junction = end[0], end[-1]
    along = sum(roadmap.length(a, b) for a, b in pairwise(end))
    reach = along + roadmap.clearance_m(tip) - roadmap.clearance_m(junction)
    if roadmap.is_fixed(junction):
        return reach - 1.0 * roadmap.radius  # shorter behind a doorway, so that small rooms have a node
    return reach - max(SPUR_RADII * roadmap.radius, SPUR_SHARE * roadmap.clearance_m(junction))


def _shorten(roadmap: RoadmapGraph, end: tuple[int, ...]) -> None:
    """Shorten a dead end to its widest node that sees the rest, e.g. the middle of a room, which sees the corners."""
    rest, last, widest = 0.0, 0, 0.0
    for i, (a, b) in enumerate(pairwise(end[:-1]), 1):
        rest += roadmap.length(a, b)
        clearance_m = roadmap.clearance_m(b)
        reach_m = max(SPUR_RADII * roadmap.radius, SPUR_SHARE * clearance_m)
        if rest + roadmap.clearance_m(end[0]) - clearance_m < reach_m and clearance_m >= widest:
            last, widest = i, clearance_m
    roadmap.graph.remove_nodes_from(end[:last])


def cut_small_loops(roadmap: RoadmapGraph) -> None:
    """Cut loops shorter than 12 radii at their narrowest edge: they pass a small obstacle on both sides, where one is
    enough. A choice: the circle at two radii around a post, which leaves a robot room beside it, has 12.6 radii."""
    graph = roadmap.graph
    edges, tree = roadmap.lines()
    lines = tree.geometries
    room = shapely.distance(lines, roadmap.space.boundary)
    for a, b in edges:
        graph.edges[a, b]["length"] = roadmap.length(a, b)
    for i in np.lexsort((-shapely.length(lines), np.round(room, 2))).tolist():
        a, b = edges[i]
        length = graph.edges[a, b]["length"]
        graph.remove_edge(a, b)
        roadmap.check_time()
        most = max(0.0, 12.0 * roadmap.radius - length)
        if b not in nx.single_source_dijkstra_path_length(graph, a, cutoff=most, weight="length"):
            graph.add_edge(a, b, length=length)
