"""Converts the graph to the topological map: round positions, names in reading order."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import chain, count

from robocorba.maps.model import PathEdge, PathNode, TopologicalMap
from robocorba.maps.topology.roadmap import RoadmapGraph


def round_positions(roadmap: RoadmapGraph) -> None:
    """Round node positions to centimetres or millimetres where the space allows it."""
    for node in sorted(roadmap.graph):
        if roadmap.elevator(node) or roadmap.place(node):
            continue
        for digits in (2, 3):
            x, y = roadmap.at(node)
            place = (round(x, digits) + 0.0, round(y, digits) + 0.0)
            if roadmap.is_free(roadmap.at(node), place) and roadmap.can_move(node, place):
                roadmap.graph.nodes[node]["at"] = place
                break


def to_topological_map(roadmap: RoadmapGraph, places: Sequence[PathNode] = ()) -> TopologicalMap:
    """The topological map: nodes from top to bottom and left to right, then cabins, then `places` without edges."""

    def reading_order(node: int) -> tuple[bool, str, float, float, float]:
        x, y = roadmap.at(node)
        return bool(roadmap.elevator(node)), roadmap.elevator(node), -round(y), x, -y

    known = {place.name: place for place in places}
    nodes: dict[str, PathNode] = {}
    names: dict[int, str] = {}
    for i, node in enumerate(sorted(roadmap.graph, key=reading_order), 1):
        elevator = roadmap.elevator(node)
        names[node] = roadmap.place(node) or _free_name(f"cabin-{elevator}" if elevator else f"n{i}", known)
        nodes[names[node]] = known.get(names[node]) or PathNode(
            name=names[node], at=roadmap.at(node), elevator=elevator
        )
    rank = {node: i for i, node in enumerate(names)}
    edges: dict[str, PathEdge] = {}
    for a, b in sorted(sorted(edge, key=rank.__getitem__) for edge in roadmap.graph.edges):
        edge = PathEdge(name=_free_name(f"{names[a]}-{names[b]}", edges), a=names[a], b=names[b])
        edges[edge.name] = edge
    return TopologicalMap({**nodes, **{name: place for name, place in known.items() if name not in nodes}}, edges)


def _free_name(wanted: str, taken: Container[str]) -> str:
    """`wanted`, or the first of `wanted-2`, `wanted-3`... that is not taken."""
    numbered = (f"{wanted}-{i}" for i in count(2))
    return next(name for name in chain([wanted], numbered) if name not in taken)
