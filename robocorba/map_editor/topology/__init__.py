"""Generation of the topological map of a floor, with optional given nodes.

The medial axis of the free space, from the Voronoi diagram of points along all
obstacles, maximises the clearance and has the same connections and loops as the free
space. It is pruned, straightened and simplified. A node is moved only if the area that
its edges sweep is free, so an edge never jumps to the other side of an obstacle.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from itertools import chain, count

import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.maps import InvalidElement, UnknownElement
from robocorba.map_editor import geometry
from robocorba.map_editor.model import Building, PathEdge, PathNode, TopologicalMap, with_topology
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.map_editor.time_limit import no_limit
from robocorba.map_editor.topology.axis import connect_components, draw_axis
from robocorba.map_editor.topology.coverage import add_coverage_nodes
from robocorba.map_editor.topology.doorways import add_cabin_nodes, add_doorway_nodes, add_given_nodes
from robocorba.map_editor.topology.pruning import cut_small_loops, prune
from robocorba.map_editor.topology.roadmap import RoadmapGraph
from robocorba.map_editor.topology.simplification import align, merge, straighten

__all__ = ["topological_map"]


def topological_map(
    building: Building,
    floor: str,
    radius_m: float = SMARTPAL_RADIUS_M,
    given: Sequence[PathNode] = (),
    check_time: Callable[[], None] = no_limit,
) -> TopologicalMap:
    """Nodes and edges for a robot of `radius_m`, from the floor's geometrical map and the `given` nodes only.

    Every edge has a clearance of `radius_m`. Two nodes are connected exactly if their positions are
    connected in the free space, and every component of the free space has a node. If the robot fits,
    there is a node in the cabin of each elevator that serves the floor (`cabin-E1`), and one in front
    of it. The others are n1, n2, ... in reading order. All `given` nodes are kept under their own names.
    A given node has no edge if the robot does not fit there, or if another one or a cabin's node has the
    same position. The result is deterministic. The time follows the number of obstacles, not their size; `check_time`
    is called often, and may raise an error to end the work.

    Raises UnknownElement for an unknown floor, InvalidElement if the radius is not from 0.05 to 1000 m,
    or if the floor has no free space for the robot.
    """
    if floor not in building.floors:
        raise UnknownElement("floor", "", floor)
    # No robot is smaller, and the roadmap of a large floor for 1 cm would take minutes; none is larger, and no geometry
    # overflows.
    if not 0.05 <= radius_m <= 1000.0:
        reason = f"no roadmap for a radius of {radius_m:g} m: it must be from 0.05 to 1000 m"
        raise InvalidElement("floor", "", floor, reason)
    # The old roadmap must not affect the new one.
    building = with_topology(building, floor, TopologicalMap({node.name: node for node in given}))
    space = _free_space(building, floor, radius_m)
    if space.is_empty:
        raise InvalidElement("floor", "", floor, f"no free space for a robot of radius {radius_m:g} m")
    roadmap = RoadmapGraph(space, radius_m, check_time)
    draw_axis(roadmap, _obstacle_lines(building, floor, radius_m))
    for elevator in building.elevators.values():
        if floor in elevator.floors():
            add_cabin_nodes(roadmap, elevator, floor, given)
    doors = building.floors[floor].geometrical.doors.values()
    add_doorway_nodes(roadmap, (LineString([door.a, door.b]) for door in doors if not door.locked))
    add_given_nodes(roadmap, given)
    connect_components(roadmap)
    prune(roadmap)
    straighten(roadmap)
    merge(roadmap)
    cut_small_loops(roadmap)
    prune(roadmap)
    align(roadmap)
    merge(roadmap)
    add_coverage_nodes(roadmap)
    _round_positions(roadmap)
    return _to_topological_map(roadmap, given)


def _free_space(building: Building, floor: str, radius_m: float) -> BaseGeometry:
    """The free space of a floor, without the shafts that do not serve it."""
    space = geometry.free_space(building, floor, radius_m)
    closed = [geometry.shaft_polygon(e) for e in building.elevators_through(floor) if floor not in e.floors()]
    if closed:
        space = space.difference(shapely.union_all(closed))
    shapely.prepare(space)
    return space


def _obstacle_lines(building: Building, floor: str, radius_m: float) -> list[BaseGeometry]:
    """The obstacles as lines, with the border of the mapped region if the floor has no outline."""
    lines = [item.geometry for item in geometry.obstacles(building, floor)]
    lines = [line.exterior if isinstance(line, Polygon) else line for line in lines]
    if not building.floors[floor].floor.outline:
        rim = shapely.box(*geometry.bounds(building, floor, 1.0 + radius_m))
        lines.append(rim.exterior)
    return lines


def _round_positions(roadmap: RoadmapGraph) -> None:
    """Round node positions to centimetres or millimetres where the space allows it."""
    for node in sorted(roadmap.graph):
        if roadmap.elevator(node) or roadmap.given_name(node):
            continue
        for digits in (2, 3):
            x, y = roadmap.at(node)
            point = (round(x, digits) + 0.0, round(y, digits) + 0.0)
            if roadmap.is_free(roadmap.at(node), point) and roadmap.can_move(node, point):
                roadmap.graph.nodes[node]["at"] = point
                break


def _to_topological_map(roadmap: RoadmapGraph, given: Sequence[PathNode] = ()) -> TopologicalMap:
    """The topological map: nodes from top to bottom and left to right, then cabins, then unconnected `given` nodes."""

    def reading_order(node: int) -> tuple[bool, str, float, float, float]:
        x, y = roadmap.at(node)
        return bool(roadmap.elevator(node)), roadmap.elevator(node), -round(y), x, -y

    known = {node.name: node for node in given}
    nodes: dict[str, PathNode] = {}
    names: dict[int, str] = {}
    for i, node in enumerate(sorted(roadmap.graph, key=reading_order), 1):
        elevator = roadmap.elevator(node)
        names[node] = roadmap.given_name(node) or _free_name(f"cabin-{elevator}" if elevator else f"n{i}", known)
        nodes[names[node]] = known.get(names[node]) or PathNode(
            name=names[node], at=roadmap.at(node), elevator=elevator
        )
    rank = {node: i for i, node in enumerate(names)}
    edges: dict[str, PathEdge] = {}
    for a, b in sorted(sorted(edge, key=rank.__getitem__) for edge in roadmap.graph.edges):
        edge = PathEdge(name=_free_name(f"{names[a]}-{names[b]}", edges), a=names[a], b=names[b])
        edges[edge.name] = edge
    return TopologicalMap({**nodes, **{name: node for name, node in known.items() if name not in nodes}}, edges)


def _free_name(wanted: str, taken: Container[str]) -> str:
    """`wanted`, or the first of `wanted-2`, `wanted-3`... that is not taken."""
    numbered = (f"{wanted}-{i}" for i in count(2))
    return next(name for name in chain([wanted], numbered) if name not in taken)
