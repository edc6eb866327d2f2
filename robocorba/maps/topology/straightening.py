"""Replaces winding chains of edges between two junctions by a few straight edges."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import networkx as nx
import numpy as np

from robocorba.maps.topology.roadmap import BEND_SHARE, RoadmapGraph, distance_to_segment_m


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
    """Indices of the nodes of a chain to keep (Douglas-Peucker with clearance)."""
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
