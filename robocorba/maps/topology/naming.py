"""From the graph to the map: round positions, and names in reading order."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import chain, count

from robocorba.maps.model import PathEdge, PathNode, TopologicalMap
from robocorba.maps.topology.roads import Roads


def round_positions(roads: Roads) -> None:
    """Move nodes to whole centimetres or millimetres where there is room to."""
    for node in sorted(roads.graph):
        if roads.elevator(node) or roads.place(node):
            continue
        for digits in (2, 3):
            x, y = roads.at(node)
            place = (round(x, digits) + 0.0, round(y, digits) + 0.0)
            if roads.free(roads.at(node), place) and roads.may_move(node, place):
                roads.graph.nodes[node]["at"] = place
                break


def named(roads: Roads, places: Sequence[PathNode] = ()) -> TopologicalMap:
    """The map: nodes from top to bottom and left to right, then the cabins; of `places`, those without roads last."""

    def reading_order(node: int) -> tuple[bool, str, float, float, float]:
        x, y = roads.at(node)
        return bool(roads.elevator(node)), roads.elevator(node), -round(y), x, -y

    known = {place.name: place for place in places}
    nodes: dict[str, PathNode] = {}
    names: dict[int, str] = {}
    for i, node in enumerate(sorted(roads.graph, key=reading_order), 1):
        elevator = roads.elevator(node)
        names[node] = roads.place(node) or _free_name(f"cabin-{elevator}" if elevator else f"n{i}", known)
        nodes[names[node]] = known.get(names[node]) or PathNode(name=names[node], at=roads.at(node), elevator=elevator)
    rank = {node: i for i, node in enumerate(names)}
    edges: dict[str, PathEdge] = {}
    for a, b in sorted(sorted(edge, key=rank.__getitem__) for edge in roads.graph.edges):
        edge = PathEdge(name=_free_name(f"{names[a]}-{names[b]}", edges), a=names[a], b=names[b])
        edges[edge.name] = edge
    return TopologicalMap({**nodes, **{name: place for name, place in known.items() if name not in nodes}}, edges)


def _free_name(wanted: str, taken: Container[str]) -> str:
    """The name, or the first of `name-2`, `name-3`... that is not taken."""
    numbered = (f"{wanted}-{i}" for i in count(2))
    return next(name for name in chain([wanted], numbered) if name not in taken)
