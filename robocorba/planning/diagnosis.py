"""Explains why a place is not free, and which elements block every path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely

from robocorba.errors.paths import Blocker
from robocorba.map_editor.geometry import Obstacle, object_geometry
from robocorba.map_editor.model import Building, PathEdge
from robocorba.map_editor.spatial.arrays import Longs
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning import geometric, topological
from robocorba.planning.request import Path, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.snapshot import FORBIDDEN, BuildingSnapshot
from robocorba.planning.turns import Turn

#: Radius of a thin robot [m]: if it has a path where the real one has none, gaps are too narrow.
THIN_M = 0.02
#: Maximum number of edges that a diagnosis names.
MAX_EDGES_NAMED = 16
#: Number of nearest nodes to which a diagnosis searches a drive.
MAX_NODES_TRIED = 16


def obstacle_at(snapshot: BuildingSnapshot, place: Place, radius: float) -> tuple[str, float]:
    """The obstacle that a robot of this radius [m] would touch at a place, and its distance [m], 0 inside it."""
    space, point = snapshot.spaces[place.floor], shapely.Point(place[1:])

    def name_of(item: Obstacle) -> str:
        area = snapshot.avoided.get((place.floor, item.name)) if item.kind == "object" else None
        if area is None:
            return f"{item.kind} {item.name}"
        return area.name if area.reason == FORBIDDEN else f"area {area.name}, which {area.reason}"

    for item in space.owners:
        if item.geometry.geom_type == "Polygon" and item.geometry.contains(point):
            return name_of(item), 0.0
    if not space.is_ground(place.x, place.y):
        return f"the outside of floor {space.floor}", 0.0
    distance, nearest = space.nearest(place.x, place.y, radius + 1e-6)
    return (name_of(nearest) if nearest else "nothing"), distance


def areas_in_the_way(
    snapshot: BuildingSnapshot, free: BuildingSnapshot, request: PathRequest, turn: Turn
) -> list[Blocker]:
    """The areas that a request avoids on the best path that it would have without any; none if it has no path then.
    `free` and `request` are without the areas."""
    find = geometric.routes if request.mode is RouteMode.GEOMETRIC else topological.routes
    found = find(free, request, turn)
    blockers: dict[tuple[str, str], Blocker] = {}
    for here, there in pairwise(free.path(found[0], request).points if found else ()):
        if here.floor != there.floor:
            continue
        drive = shapely.LineString([here[3:5], there[3:5]])
        for (floor, name), area in snapshot.avoided.items():
            solid = snapshot.building.floors[floor].geometrical.objects[name]
            if floor == here.floor and object_geometry(solid).distance(drive) < request.radius:
                blockers[floor, name] = area
    return list(blockers.values())


def explain_no_path(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn) -> tuple[str, list[Blocker]]:
    """A sentence, and the elements that would have to change for a path to exist."""
    building = snapshot.building
    start, goal = request.start, request.goal
    if start.floor != goal.floor:
        unserved = _unserved(building, request)
        if unserved:
            return f"no elevator leads from {start.floor} to {goal.floor}", unserved
    on_roads = request.mode is RouteMode.TOPOLOGICAL or bool(request.graph and request.mode is RouteMode.SMOOTHED)
    if on_roads:
        for which, place, outbound in (("start", start, True), ("goal", goal, False)):
            if not len(topological.connect_around_corners(snapshot, request, place, outbound, turn).nodes):
                if roads := _roads_between(snapshot, request, place, turn):
                    return f"the {which} reaches a path node only along or across closed edges", roads
                return f"the {which} reaches no path node", _why_unreachable(snapshot, request, place, turn)
    thin = request._replace(radius=min(THIN_M, request.radius), avoid_elevators=frozenset(), graph="", alternatives=0)
    if on_roads:
        found = topological.routes(snapshot, thin._replace(mode=RouteMode.TOPOLOGICAL), turn)
    else:
        found = geometric.routes(snapshot, thin, turn)
    if found:
        blockers = _too_narrow(snapshot, request, snapshot.path(found[0], thin))
        if blockers:
            return f"no path for a robot of radius {request.radius:g} m", blockers
    locked = _locked_doors(snapshot, thin, turn)
    if locked:
        return "locked doors block every path", locked
    if on_roads:
        return "start and goal are not connected", _unconnected(snapshot, request, turn)
    if found and (edges := [*_closed_edges(building, request), *_one_way_edges(building, request)]):
        return "the rules of edges forbid every path", edges[:MAX_EDGES_NAMED]
    floors = dict.fromkeys((start.floor, goal.floor))
    return "start and goal are not connected", [
        Blocker("floor", "", floor, "its walls leave no passage") for floor in floors
    ]


def _locked_doors(snapshot: BuildingSnapshot, thin: PathRequest, turn: Turn) -> list[Blocker]:
    """The locked doors on the path of a thin robot with all doors unlocked."""
    opened = snapshot.with_doors_unlocked()
    if opened is None:
        return []
    found = geometric.routes(opened, thin._replace(mode=RouteMode.GEOMETRIC), turn)
    doors: dict[tuple[str, str], Blocker] = {}
    for here, there in pairwise(opened.path(found[0], thin).points if found else ()):
        if here.floor != there.floor:
            continue
        drive = shapely.LineString([here[3:5], there[3:5]])
        for door in snapshot.building.floors[here.floor].geometrical.doors.values():
            if door.locked and drive.intersects(shapely.LineString([door.a, door.b])):
                doors[here.floor, door.name] = Blocker("door", here.floor, door.name, "is locked")
    return list(doors.values())


def _unserved(building: Building, request: PathRequest) -> list[Blocker]:
    """The floor that no elevator serves, or the avoided elevators, if that is the reason."""
    for place in (request.start, request.goal):
        serving = [name for name, lift in building.elevators.items() if place.floor in lift.floors()]
        if not serving:
            return [Blocker("floor", "", place.floor, "no elevator serves it")]
        if all(name in request.avoid_elevators for name in serving):
            return [
                Blocker("elevator", "", name, f"serves {place.floor}, but the request avoids it") for name in serving
            ]
    return []


def _too_narrow(snapshot: BuildingSnapshot, request: PathRequest, path: Path) -> list[Blocker]:
    """What a thin robot's path passes and the robot itself cannot."""
    blockers: dict[tuple[str, str, str], Blocker] = {}
    for here, there in pairwise(path.points):
        if here.kind is PointKind.ELEVATOR_ENTRY:
            avoided = here.elevator in request.avoid_elevators
            found = [Blocker("elevator", "", here.elevator, "is avoided by the request")] if avoided else []
        else:
            found = _narrow_places(
                snapshot, request, here.floor, {here.node, there.node}, (here.x, here.y), (there.x, there.y)
            )
        for blocker in found:
            blockers.setdefault((blocker.kind, blocker.floor, blocker.name), blocker)
    return list(blockers.values())


def _narrow_places(
    snapshot: BuildingSnapshot, request: PathRequest, floor: str, nodes: set[str], a: XY, b: XY
) -> list[Blocker]:
    """What keeps the robot from driving from a to b; `nodes` are the nodes at the ends."""
    space, needed = snapshot.spaces[floor], 2 * request.radius
    entry = snapshot.building.floors[floor]
    found = []
    for edge in entry.topological.edges.values():
        if {edge.a, edge.b} != nodes:
            continue
        if reason := _why_closed(edge, request):
            found.append(Blocker("edge", floor, edge.name, reason))
    if space.line_is_free(*a, *b, request.radius):
        return found
    line = shapely.LineString([a, b])
    narrow_doors = [
        Blocker(
            "door",
            floor,
            door.name,
            "is {} m wide, {} m needed".format(*_distinguishable(math.dist(door.a, door.b), needed)),
        )
        for door in entry.geometrical.doors.values()
        if math.dist(door.a, door.b) < needed
        and line.distance(shapely.LineString([door.a, door.b])) < 0.3  # [m], it leads through the doorway
    ]
    if narrow_doors:
        return found + narrow_doors
    clearance, item = space.nearest_to_line(*a, *b, request.radius)
    if item is not None:
        reason = "is {} m from the path, {} m needed".format(*_distinguishable(clearance, request.radius))
        found.append(Blocker(item.kind, "" if item.kind in ("elevator", "floor") else floor, item.name, reason))
    return found


def _why_closed(edge: PathEdge, request: PathRequest) -> str:
    """Why a request must not use an edge in any direction, "" if it may."""
    if edge.clearance and edge.clearance < request.radius:
        return f"is for robots of at most {edge.clearance:g} m radius"
    return (
        f"is not of graph {request.graph}" if request.graph and edge.graphs and request.graph not in edge.graphs else ""
    )


def _closed_edges(building: Building, request: PathRequest) -> list[Blocker]:
    """The edges on the floors of start and goal that are closed for the request."""
    return [
        Blocker("edge", floor, edge.name, reason)
        for floor in dict.fromkeys((request.start.floor, request.goal.floor))
        for edge in building.floors[floor].topological.edges.values()
        if (reason := _why_closed(edge, request))
    ]


def _roads_between(snapshot: BuildingSnapshot, request: PathRequest, place: Place, turn: Turn) -> list[Blocker]:
    """The closed and one-way edges beside the shortest drive between a place and a node, if only rules of edges forbid
    it."""
    topology, space = snapshot.building.floors[place.floor].topological, snapshot.spaces[place.floor]
    nodes = [node.at for node in topology.nodes.values() if space.point_is_free(*node.at, request.radius)]
    nearest = sorted(nodes, key=lambda at: math.dist(at, place[1:]))[:MAX_NODES_TRIED]
    legs = snapshot.graph(place.floor, request.radius).legs(place[1:], nearest, turn=turn)
    best = min(legs, key=lambda leg: leg.length, default=None)
    if best is None or not math.isfinite(best.length):
        return []
    drive = shapely.LineString(best.points)
    return [
        Blocker("edge", place.floor, edge.name, reason)
        for edge in topology.edges.values()
        if (reason := _why_closed(edge, request) or ("is one-way" if edge.one_way else ""))
        and drive.distance(shapely.LineString([topology.nodes[edge.a].at, topology.nodes[edge.b].at])) < request.radius
    ][:MAX_EDGES_NAMED]


def _distinguishable(first: float, second: float) -> tuple[str, str]:
    """Two lengths with as many digits as show the difference, at least two."""
    for digits in range(2, 9):
        texts = f"{first:.{digits}f}", f"{second:.{digits}f}"
        if texts[0] != texts[1]:
            break
    return texts


def _why_unreachable(snapshot: BuildingSnapshot, request: PathRequest, place: Place, turn: Turn) -> list[Blocker]:
    """Why a place reaches no node: the narrow places on a thin robot's path, or a floor without nodes."""
    entry = snapshot.building.floors[place.floor]
    if not entry.topological.nodes:
        return [Blocker("floor", "", place.floor, "has no path nodes; build its topological map")]
    nodes = sorted(entry.topological.nodes.values(), key=lambda node: math.dist(node.at, place[1:]))
    thin = snapshot.graph(place.floor, min(THIN_M, request.radius))
    legs = thin.legs(place[1:], [node.at for node in nodes[:MAX_NODES_TRIED]], turn=turn)
    best = min(legs, key=lambda leg: leg.length)
    if not math.isfinite(best.length):
        return [Blocker("floor", "", place.floor, "its walls enclose the place")]
    found = [_narrow_places(snapshot, request, place.floor, {""}, a, b) for a, b in pairwise(best.points.tolist())]
    return list({blocker.name: blocker for blockers in found for blocker in blockers}.values())


def _unconnected(snapshot: BuildingSnapshot, request: PathRequest, turn: Turn) -> list[Blocker]:
    """The components of the topological map that start and goal are connected to; its one-way edges if both are in
    the same one."""
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    pieces = []
    for place, outbound in ((request.start, True), (request.goal, False)):
        nodes = topological.connect_around_corners(snapshot, request, place, outbound, turn).nodes
        pieces.append(set(component[nodes].tolist()))
    if pieces[0] & pieces[1]:
        return _one_way_edges(snapshot.building, request)
    start, goal = (_describe_components(snapshot, component, numbers) for numbers in pieces)
    reason = f"its topological map is not connected: the start reaches {start}, the goal {goal}"
    return [Blocker("floor", "", floor, reason) for floor in dict.fromkeys((request.start.floor, request.goal.floor))]


def _describe_components(snapshot: BuildingSnapshot, component: Longs, numbers: set[int]) -> str:
    """How many nodes these components have, and the names of the first of them."""
    nodes = np.flatnonzero(np.isin(component, list(numbers)))
    names = [snapshot.roads.names.nodes[node] for node in nodes[:4].tolist()]
    more = ", ..." if len(nodes) > len(names) else ""
    return f"{len(nodes)} node{'s' if len(nodes) > 1 else ''} ({', '.join(names)}{more})"


def _one_way_edges(building: Building, request: PathRequest) -> list[Blocker]:
    """The one-way edges on the floors of start and goal."""
    return [
        Blocker("edge", floor, edge.name, "is one-way")
        for floor in dict.fromkeys((request.start.floor, request.goal.floor))
        for edge in building.floors[floor].topological.edges.values()
        if edge.one_way
    ][:MAX_EDGES_NAMED]
