"""From the graph to the map: round positions, and names in reading order."""

from __future__ import annotations

from robocorba.maps.model import PathEdge, PathNode, TopologicalMap
from robocorba.maps.topology.roads import Roads


def round_positions(roads: Roads) -> None:
    """Move nodes to whole centimetres or millimetres where there is room to."""
    for node in sorted(roads.graph):
        if roads.elevator(node):
            continue
        for digits in (2, 3):
            x, y = roads.at(node)
            place = (round(x, digits) + 0.0, round(y, digits) + 0.0)
            if roads.free(roads.at(node), place) and roads.may_move(node, place):
                roads.graph.nodes[node]["at"] = place
                break


def named(roads: Roads) -> TopologicalMap:
    """The map: nodes from top to bottom and left to right, then the cabins."""

    def reading_order(node: int) -> tuple[bool, str, float, float, float]:
        x, y = roads.at(node)
        return bool(roads.elevator(node)), roads.elevator(node), -round(y), x, -y

    nodes: dict[str, PathNode] = {}
    names: dict[int, str] = {}
    for i, node in enumerate(sorted(roads.graph, key=reading_order), 1):
        elevator = roads.elevator(node)
        names[node] = f"cabin-{elevator}" if elevator else f"n{i}"
        nodes[names[node]] = PathNode(name=names[node], at=roads.at(node), elevator=elevator)
    rank = {node: i for i, node in enumerate(names)}
    edges: dict[str, PathEdge] = {}
    for a, b in sorted(sorted(edge, key=rank.__getitem__) for edge in roads.graph.edges):
        edge = PathEdge(name=f"{names[a]}-{names[b]}", a=names[a], b=names[b])
        edges[edge.name] = edge
    return TopologicalMap(nodes, edges)
