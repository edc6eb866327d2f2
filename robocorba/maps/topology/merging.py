"""Nodes that are close together become one, and roads that nearly run along x or y do."""

from __future__ import annotations

import networkx as nx
import numpy as np

from robocorba.maps.topology.roads import BEND_SHARE, SAME_PLACE_M, Roads, middle, off_line
from robocorba.spatial.pose import XY

#: Nodes closer than this many radii, or this share of their clearance, become one.
MERGE_RADII, MERGE_SHARE = 3.0, 0.75
#: A road whose ends differ by less than this share of its length along x (or y) is meant to run along y (or x).
TILT_SHARE = 0.3


def merge(roads: Roads) -> None:
    """Join nodes that are close together, and drop those that only lie between two others."""
    changed = True
    while changed:
        changed = False
        for a, b in sorted(roads.graph.edges, key=lambda edge: (roads.length(*edge), edge)):
            if roads.graph.has_edge(a, b) and _merged(roads, a, b):
                changed = True
        for node in sorted(roads.graph):
            changed |= _skipped(roads, node)


def _merged(roads: Roads, a: int, b: int) -> bool:
    """Whether two neighbours became one."""
    if roads.length(a, b) > _near(roads, a, b) or (roads.elevator(a) and roads.elevator(b)):
        return False
    if _weight(roads, b) > _weight(roads, a):
        a, b = b, a
    if roads.place(b):
        return False
    if roads.fixed(a) and roads.length(a, b) > roads.radius:
        return False  # a junction in front of a doorway stays there, and so does the node of a small room
    one, other = roads.at(a), roads.at(b)
    for place in [one] if roads.fixed(a) else [one, middle(one, other), other]:
        if roads.may_move(a, place, but=b) and roads.may_move(b, place, but=a):
            roads.graph.nodes[a].update(at=place, clear=min(roads.clear(a), roads.clear(b)))
            roads.graph.add_edges_from((a, n) for n in list(roads.graph[b]) if n != a)
            roads.graph.remove_node(b)
            return True
    return False


def _near(roads: Roads, a: int, b: int) -> float:
    """How close two neighbours must be to become one, m."""
    if roads.fixed(a) and roads.fixed(b):
        return SAME_PLACE_M
    if 1 in (len(roads.graph[a]), len(roads.graph[b])):
        return roads.radius  # what is left of the dead ends is meant to be there
    return max(MERGE_RADII * roads.radius, MERGE_SHARE * min(roads.clear(a), roads.clear(b)))


def _weight(roads: Roads, node: int) -> tuple[bool, bool, bool, int, float]:
    """Of two nodes that merge, the one that stays has more of this."""
    special = bool(roads.elevator(node)), bool(roads.place(node)), roads.fixed(node)
    return *special, len(roads.graph[node]), roads.clear(node)


def _skipped(roads: Roads, node: int) -> bool:
    """Whether a node that only lay between two others is gone."""
    if len(roads.graph[node]) != 2 or roads.fixed(node):
        return False
    a, b = roads.graph[node]
    off = float(off_line(np.array([roads.at(node)]), np.array(roads.at(a)), np.array(roads.at(b)))[0])
    if off > BEND_SHARE * roads.clear(node) or not roads.free(roads.at(a), roads.at(node), roads.at(b)):
        return False
    roads.graph.remove_node(node)
    roads.graph.add_edge(a, b)
    return True


def align(roads: Roads) -> None:
    """Put nodes of a road that runs nearly along x or y on one line."""
    for axis in (0, 1):
        along: nx.Graph[int] = nx.Graph()
        for a, b in roads.graph.edges:
            off = [abs(p - q) for p, q in zip(roads.at(a), roads.at(b), strict=True)]
            if off[axis] < TILT_SHARE * off[1 - axis]:
                along.add_edge(a, b)
        for road in nx.connected_components(along):
            nodes = sorted(road)
            fixed = [roads.at(node)[axis] for node in nodes if roads.fixed(node)]
            line = float(np.median(fixed or [roads.at(node)[axis] for node in nodes]))
            for node in nodes:
                x, y = roads.at(node)
                place: XY = (line, y) if axis == 0 else (x, line)
                near = abs(line - roads.at(node)[axis]) <= BEND_SHARE * roads.clear(node)
                if near and not roads.fixed(node) and roads.may_move(node, place):
                    roads.graph.nodes[node]["at"] = place
