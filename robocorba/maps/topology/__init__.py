"""RoadmapGraph for a floor that was drawn without any, and by way of the places that it names.

The medial axis of the free space, from the Voronoi diagram of points along all
obstacles, keeps as far from everything as one can and has the same connections and
loops as the free space itself. It is pruned, straightened and thinned until it reads
like a road map. Every move of a node is made only where the strip that its edges sweep
is free, so a road never jumps to the other side of an obstacle.
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

__all__ = ["topological_map"]

#: No robot is larger, and no geometry overflows below it, m.
LARGEST_RADIUS_M = 1000.0


def topological_map(
    building: Building, floor: str, radius_m: float = 0.40, places: Sequence[PathNode] = ()
) -> TopologicalMap:
    """Nodes and edges for a robot of `radius_m`, from the floor's geometrical map and `places` alone.

    Every edge keeps `radius_m` from every obstacle of the floor. Two nodes are connected
    exactly when their places are connected in the free space, and every part of it has a
    node. A node stands in the cabin of each elevator that serves the floor (`cabin-E1`)
    if the robot fits, and one in front of it; the others are n1, n2, ... in reading order.
    All `places` are nodes of the map under their own names; one where the robot does not fit, or
    that is at the same place as another or as a cabin's node, has no edge. The same map gives the same result.

    Raises UnknownElement for an unknown floor, InvalidElement where the radius is not
    between 0 and LARGEST_RADIUS_M or nowhere on the floor is room for the robot.
    """
    if floor not in building.floors:
        raise UnknownElement("floor", "", floor)
    if not 0 < radius_m <= LARGEST_RADIUS_M:
        reason = f"no roadmap for a radius of {radius_m:g} m: it must be above 0 and at most {LARGEST_RADIUS_M:g} m"
        raise InvalidElement("floor", "", floor, reason)
    building = _with_places_only(building, floor, places)
    space = _places(building, floor, radius_m)
    if space.is_empty:
        raise InvalidElement("floor", "", floor, f"no free space for a robot of radius {radius_m:g} m")
    roadmap = RoadmapGraph(space, radius_m)
    draw_axis(roadmap, _outlines(building, floor, radius_m))
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
    """The building without the floor's present roadmap, so that they have no influence on new ones."""
    topology = TopologicalMap({place.name: place for place in places})
    bare = msgspec.structs.replace(building.floors[floor], topological=topology)
    return msgspec.structs.replace(building, floors={**building.floors, floor: bare})


def _places(building: Building, floor: str, radius_m: float) -> BaseGeometry:
    """Free space without the shafts that have no door here."""
    space = geometry.free_space(building, floor, radius_m)
    closed = [geometry.shaft_polygon(e) for e in building.elevators.values() if floor not in e.floors()]
    if closed:
        space = space.difference(shapely.union_all(closed))
    shapely.prepare(space)
    return space


def _outlines(building: Building, floor: str, radius_m: float) -> list[BaseGeometry]:
    """What the roadmap keep their distance from, as lines; the rim of the drawn region where there is no outline."""
    lines = [item.geometry for item in geometry.obstacles(building, floor)]
    lines = [line.exterior if isinstance(line, Polygon) else line for line in lines]
    if not building.floors[floor].floor.outline:
        rim = shapely.box(*geometry.bounds(building, floor, 1.0 + radius_m))
        lines.append(rim.exterior)
    return lines
