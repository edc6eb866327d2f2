"""Simplifies the roadmap: straightens chains of edges, merges close nodes, and aligns edges nearly along x or y."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import networkx as nx
import numpy as np

from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.topology.roadmap import (
    BEND_SHARE,
    SAME_POINT_M,
    RoadmapGraph,
    distance_to_segment_m,
    midpoint,
)


def straighten(roadmap: RoadmapGraph) -> None:
    """Replace every chain between two junctions by as few straight edges as possible."""
    for chain in list(_chains(roadmap)):
        kept = set(_bends(roadmap, chain))
        roadmap.graph.remove_edges_from(list(pairwise(chain)))
        roadmap.graph.remove_nodes_from([node for i, node in enumerate(chain) if i not in kept])
        nx.add_path(roadmap.graph, [chain[i] for i in sorted(kept)])


def _chains(roadmap: RoadmapGraph) -> Iterator[list[int]]:
    """Chains between junctions, loose ends and fixed nodes. A loop without any starts at its lowest node."""
    graph = roadmap.graph
    ends = {n for n in graph if len(graph[n]) != 2 or roadmap.is_fixed(n)}
    for piece in nx.connected_components(graph):
        if not piece & ends:
            ends.add(min(piece))
    seen: set[tuple[int, int]] = set()
    for end in sorted(ends):
        for first in sorted(graph[end]):
            if (end, first) in seen:
                continue
            chain = [end, first]
            while chain[-1] not in ends:
                (onward,) = (n for n in graph[chain[-1]] if n != chain[-2])
                chain.append(onward)
            seen |= {(chain[0], chain[1]), (chain[-1], chain[-2])}
            yield chain


def _bends(roadmap: RoadmapGraph, chain: list[int]) -> list[int]:
    """Indices of the nodes of a chain to keep, by the algorithm of Douglas and Peucker (1973), whose tolerance here is
    a share of each node's clearance."""
    at = np.array([roadmap.at(node) for node in chain])
    leeway = BEND_SHARE * np.array([roadmap.clearance_m(node) for node in chain])
    last = len(chain) - 1
    # A loop needs three nodes, so that its edges are straight and different.
    stops = [0, last // 3, 2 * last // 3, last] if chain[0] == chain[-1] else [0, last]
    kept, todo = list(stops), list(pairwise(stops))
    while todo:
        low, high = todo.pop()
        if high - low < 2:
            continue
        off = distance_to_segment_m(at[low + 1 : high], at[low], at[high])
        excess = off - leeway[low + 1 : high]
        if excess.max() > 0 or not roadmap.is_free(roadmap.at(chain[low]), roadmap.at(chain[high])):
            split = low + 1 + int(off.argmax())
            kept.append(split)
            todo += [(low, split), (split, high)]
    return kept


def merge(roadmap: RoadmapGraph) -> None:
    """Merge close nodes, and remove those that only lie between two others."""
    changed = True
    while changed:
        changed = False
        for a, b in sorted(roadmap.graph.edges, key=lambda edge: (roadmap.length(*edge), edge)):
            if roadmap.graph.has_edge(a, b) and _try_merge(roadmap, a, b):
                changed = True
        for node in sorted(roadmap.graph):
            changed |= _try_skip(roadmap, node)


def _try_merge(roadmap: RoadmapGraph, a: int, b: int) -> bool:
    """Merge two neighbours if allowed; whether they were merged."""
    if roadmap.length(a, b) > _merge_distance_m(roadmap, a, b) or (roadmap.elevator(a) and roadmap.elevator(b)):
        return False
    if _merge_priority(roadmap, b) > _merge_priority(roadmap, a):
        a, b = b, a
    if roadmap.given_name(b):
        return False
    if roadmap.is_fixed(a) and roadmap.length(a, b) > roadmap.radius:
        return False  # keeps a junction in front of a doorway and the node of a small room
    one, other = roadmap.at(a), roadmap.at(b)
    for point in [one] if roadmap.is_fixed(a) else [one, midpoint(one, other), other]:
        if roadmap.can_move(a, point, but=b) and roadmap.can_move(b, point, but=a):
            roadmap.graph.nodes[a].update(at=point, clear=min(roadmap.clearance_m(a), roadmap.clearance_m(b)))
            roadmap.graph.add_edges_from((a, n) for n in list(roadmap.graph[b]) if n != a)
            roadmap.graph.remove_node(b)
            return True
    return False


def _merge_distance_m(roadmap: RoadmapGraph, a: int, b: int) -> float:
    """Maximum distance at which two neighbours are merged [m]."""
    if roadmap.is_fixed(a) and roadmap.is_fixed(b):
        return SAME_POINT_M
    if 1 in (len(roadmap.graph[a]), len(roadmap.graph[b])):
        return roadmap.radius  # keeps the dead ends that pruning left
    # Choices of this project: a robot's length and a half, and one node for what lies in one free disc.
    return max(3.0 * roadmap.radius, 0.75 * min(roadmap.clearance_m(a), roadmap.clearance_m(b)))


def _merge_priority(roadmap: RoadmapGraph, node: int) -> tuple[bool, bool, bool, int, float]:
    """The node with the higher priority remains when two nodes merge."""
    special = bool(roadmap.elevator(node)), bool(roadmap.given_name(node)), roadmap.is_fixed(node)
    return *special, len(roadmap.graph[node]), roadmap.clearance_m(node)


def _try_skip(roadmap: RoadmapGraph, node: int) -> bool:
    """Remove a node that only lies between two others; whether it was removed."""
    if len(roadmap.graph[node]) != 2 or roadmap.is_fixed(node):
        return False
    a, b = roadmap.graph[node]
    start, at, end = roadmap.at(a), roadmap.at(node), roadmap.at(b)
    off_m = float(distance_to_segment_m(np.array([at]), np.array(start), np.array(end))[0])
    if off_m > BEND_SHARE * roadmap.clearance_m(node) or not roadmap.is_free(start, at, end):
        return False
    roadmap.graph.remove_node(node)
    roadmap.graph.add_edge(a, b)
    return True


def align(roadmap: RoadmapGraph) -> None:
    """Put the nodes of edges that run nearly along x or y on one line: those tilted by less than 17 degrees, whose
    extent along one axis is below 0.3 of that along the other. The angle is a choice; it only makes maps readable."""
    for axis in (0, 1):
        along: nx.Graph[int] = nx.Graph()
        for a, b in roadmap.graph.edges:
            off = [abs(p - q) for p, q in zip(roadmap.at(a), roadmap.at(b), strict=True)]
            if off[axis] < 0.3 * off[1 - axis]:
                along.add_edge(a, b)
        for road in nx.connected_components(along):
            nodes = sorted(road)
            fixed = [roadmap.at(node)[axis] for node in nodes if roadmap.is_fixed(node)]
            line = float(np.median(fixed or [roadmap.at(node)[axis] for node in nodes]))
            for node in nodes:
                x, y = roadmap.at(node)
                point: XY = (line, y) if axis == 0 else (x, line)
                near = abs(line - roadmap.at(node)[axis]) <= BEND_SHARE * roadmap.clearance_m(node)
                if near and not roadmap.is_fixed(node) and roadmap.can_move(node, point):
                    roadmap.graph.nodes[node]["at"] = point
