"""Generation of the topological map of a floor, with optional given nodes.

The medial axis of the free space, from the Voronoi diagram of points along all
obstacles, maximises the clearance and has the same connections and loops as the free
space. It is pruned, straightened and simplified. A node is moved only if the area that
its edges sweep is free, so an edge never jumps to the other side of an obstacle.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.maps import InvalidElement, UnknownElement
from robocorba.maps import geometry
from robocorba.maps.model import Building, PathNode, TopologicalMap
from robocorba.maps.topology.axis import connect_components, draw_axis
from robocorba.maps.topology.coverage import add_coverage_nodes
from robocorba.maps.topology.doorways import add_cabin_nodes, add_doorway_nodes, add_place_nodes
from robocorba.maps.topology.merging import align, merge
from robocorba.maps.topology.naming import round_positions, to_topological_map
from robocorba.maps.topology.pruning import cut_small_loops, prune
from robocorba.maps.topology.roadmap import RoadmapGraph
from robocorba.maps.topology.straightening import straighten
from robocorba.spatial.pose import SMARTPAL_RADIUS_M

__all__ = ["topological_map"]

#: Maximum radius of a robot [m]. No robot is larger, and no geometry overflows below it.
MAX_RADIUS_M = 1000.0


def topological_map(
    building: Building, floor: str, radius_m: float = SMARTPAL_RADIUS_M, places: Sequence[PathNode] = ()
) -> TopologicalMap:
    """Nodes and edges for a robot of `radius_m`, from the floor's geometrical map and `places` only.

    Every edge has a clearance of `radius_m`. Two nodes are connected exactly if their positions are
    connected in the free space, and every component of the free space has a node. If the robot fits,
    there is a node in the cabin of each elevator that serves the floor (`cabin-E1`), and one in front
    of it. The others are n1, n2, ... in reading order. All `places` are nodes under their own names.
    A place has no edge if the robot does not fit there, or if another place or a cabin's node has the
    same position. The result is deterministic.

    Raises UnknownElement for an unknown floor, InvalidElement if the radius is not between 0 and
    MAX_RADIUS_M, or if the floor has no free space for the robot.
    """
    if floor not in building.floors:
        raise UnknownElement("floor", "", floor)
    if not 0 < radius_m <= MAX_RADIUS_M:
        reason = f"no roadmap for a radius of {radius_m:g} m: it must be above 0 and at most {MAX_RADIUS_M:g} m"
        raise InvalidElement("floor", "", floor, reason)
    building = _with_places_only(building, floor, places)
    space = _free_space(building, floor, radius_m)
    if space.is_empty:
        raise InvalidElement("floor", "", floor, f"no free space for a robot of radius {radius_m:g} m")
    roadmap = RoadmapGraph(space, radius_m)
    draw_axis(roadmap, _obstacle_lines(building, floor, radius_m))
    for elevator in building.elevators.values():
        if floor in elevator.floors():
            add_cabin_nodes(roadmap, elevator, floor, places)
    doors = building.floors[floor].geometrical.doors.values()
    add_doorway_nodes(roadmap, (LineString([door.a, door.b]) for door in doors if not door.locked))
    add_place_nodes(roadmap, places)
    connect_components(roadmap)
    prune(roadmap)
    straighten(roadmap)
    merge(roadmap)
    cut_small_loops(roadmap)
    prune(roadmap)
    align(roadmap)
    merge(roadmap)
    add_coverage_nodes(roadmap)
    round_positions(roadmap)
    return to_topological_map(roadmap, places)


def _with_places_only(building: Building, floor: str, places: Sequence[PathNode]) -> Building:
    """The building with `places` as the only nodes of the floor: its old roadmap must not affect the new one."""
    topology = TopologicalMap({place.name: place for place in places})
    bare = msgspec.structs.replace(building.floors[floor], topological=topology)
    return msgspec.structs.replace(building, floors={**building.floors, floor: bare})


def _free_space(building: Building, floor: str, radius_m: float) -> BaseGeometry:
    """The free space of a floor, without the shafts that do not serve it."""
    space = geometry.free_space(building, floor, radius_m)
    closed = [geometry.shaft_polygon(e) for e in building.elevators.values() if floor not in e.floors()]
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
