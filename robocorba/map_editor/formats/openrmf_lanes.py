"""The topological map of a floor from the vertices and lanes of an Open-RMF level."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator

import msgspec
import shapely

from robocorba.map_editor.formats.openrmf_file import Level, Link, flag
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.model import Elevator, PathEdge, PathNode, TopologicalMap

#: Parameters of lanes that a building keeps.
_KEPT_LANE_PARAMETERS = {"bidirectional", "is_bidirectional", "graph_idx", "speed_limit", "name", "clearance"}


def unique_names(losses: Losses, what: str, given_names: Iterable[str]) -> Callable[[str, str], str]:
    """A function from the name in the file and a generated one to a unique name: that in the file, else the generated
    one, which also avoids all names in the file. Duplicates get a suffix. what: whose names, in messages."""
    in_file, taken = set(given_names), set[str]()

    def take(given: str, generated: str) -> str:
        wanted = given or generated
        name, n = wanted, 1
        while name in taken or (name in in_file and name != given):
            n += 1
            name = f"{wanted}_{n}"
        if given and name != given:
            losses.add(f"names used twice, renamed: {what}: {{names}}", f"{given} is now {name}")
        taken.add(name)
        return name

    return take


def lanes_of(
    level: Level, lifts: dict[str, Elevator], left_out: Collection[str], graphs: dict[int, str], losses: Losses
) -> TopologicalMap:
    """Nodes for the vertices of lanes and those with a name or parameters; edges for the lanes.

    `left_out` names the lifts of the file that did not become elevators."""
    nodes = _nodes(level, lifts, left_out, losses)
    edges: dict[str, PathEdge] = {}
    name_of = unique_names(losses, f"lane of {level.name}", [lane.text("name") for lane in level.links["lanes"]])
    for edge in list(_edges(level, {index: node.name for index, node in nodes.items()}, graphs, losses)):
        name = name_of(edge.name, f"{edge.a}-{edge.b}")
        edges[name] = msgspec.structs.replace(edge, name=name)
    return TopologicalMap({node.name: node for node in nodes.values()}, edges)


def _nodes(level: Level, lifts: dict[str, Elevator], left_out: Collection[str], losses: Losses) -> dict[int, PathNode]:
    name_of = unique_names(losses, f"vertex of {level.name}", [vertex.name for vertex in level.vertices])
    shafts = {name: shaft_polygon(lift) for name, lift in lifts.items() if level.name in lift.floors()}
    found: dict[int, PathNode] = {}
    for index in level.node_vertices():
        vertex = level.vertices[index]
        name = name_of(vertex.name, f"n{index}")
        cabin = vertex.params["lift_cabin"].text() if "lift_cabin" in vertex.params else ""
        if cabin and cabin not in shafts:
            where = f"{cabin} at {level.name} {name}"
            if cabin in lifts:
                losses.add("lift cabins left out, the lift does not stop at this level: {names}", where)
            elif cabin not in left_out:
                losses.add("vertices name a lift that the file does not contain: {names}", where)
            cabin = ""
        # As in the format's own tools, a vertex inside a shaft belongs to that lift.
        point = shapely.Point(vertex.at)
        cabin = cabin or next((lift for lift, shaft in shafts.items() if shaft.contains(point)), "")
        found[index] = PathNode(name=name, at=vertex.at, elevator=cabin)
        for key, value in vertex.params.items():
            if key != "lift_cabin" and value.value:
                losses.add(f"vertex property {key}: not kept: {{names}}", f"{level.name} {name}")
    return found


def _edges(level: Level, nodes: dict[int, str], graphs: dict[int, str], losses: Losses) -> Iterator[PathEdge]:
    """Edges from lanes. Lanes that differ only in their graphs become one edge with all of the graphs."""
    pairs: dict[tuple[int, int], list[Link]] = {}
    for lane in level.links["lanes"]:
        if lane.a == lane.b:
            losses.add("lanes from a vertex to itself: {n} left out: {names}", f"{level.name} {nodes[lane.a]}")
            continue
        pairs.setdefault((lane.b, lane.a) if (lane.b, lane.a) in pairs else (lane.a, lane.b), []).append(lane)
        for key, value in lane.params.items():
            if key not in _KEPT_LANE_PARAMETERS and value.value:
                losses.add(f"lane property {key}: not kept: {{names}}", f"{level.name} {nodes[lane.a]}-{nodes[lane.b]}")
    for (a, b), lanes in pairs.items():
        merged = _merged_lanes(f"{level.name} {nodes[a]}-{nodes[b]}", a, lanes, graphs, losses)
        for (forward, backward, speed, clearance, name), graph_names in merged.items():
            start, end = (a, b) if forward else (b, a)
            yield PathEdge(
                name=name,
                a=nodes[start],
                b=nodes[end],
                one_way=not (forward and backward),
                speed_limit=speed,
                clearance=clearance,
                graphs=tuple(filter(None, graph_names)),
            )


_MergedLane = tuple[bool, bool, float, float, str]


def _merged_lanes(
    where: str, start: int, lanes: list[Link], graphs: dict[int, str], losses: Losses
) -> dict[_MergedLane, list[str]]:
    """Names of graphs by (forward, backward, speed, clearance, name), for lanes between two vertices; forward is from
    vertex `start`. Opposite lanes of a graph become a two-way edge. where: the lanes in messages."""
    directions_of: dict[tuple[str, float, float, str], list[bool]] = {}
    for lane in lanes:
        graph = _graph(lane, graphs)
        key = graph, _number(lane, "speed_limit"), _number(lane, "clearance"), lane.text("name")
        both = flag(lane.params, "bidirectional") or flag(lane.params, "is_bidirectional")
        forward, backward = both or lane.a == start, both or lane.a != start
        directions = directions_of.setdefault(key, [False, False])
        if (not forward or directions[0]) and (not backward or directions[1]):
            losses.add("lanes drawn twice: {n} left out: {names}", where)
        directions[0], directions[1] = directions[0] or forward, directions[1] or backward
    found: dict[_MergedLane, list[str]] = {}
    for (graph, speed, clearance, name), (forward, backward) in directions_of.items():
        found.setdefault((forward, backward, speed, clearance, name), []).append(graph)
    return found


def _graph(lane: Link, graphs: dict[int, str]) -> str:
    """The name of a lane's graph, or its index if it has no name; empty (all graphs) if the lane names none."""
    if "graph_idx" not in lane.params:
        return ""
    index = lane.params["graph_idx"].integer()
    return graphs.get(index, str(index))


def _number(lane: Link, name: str) -> float:
    return lane.params[name].number() if name in lane.params else 0.0
