"""Why a place is not free, and what stands in the way where there is no path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely

from robocorba.errors.paths import Blocker
from robocorba.maps.model import Building
from robocorba.planning import geometric, topological
from robocorba.planning.request import Path, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.snapshot import Snapshot
from robocorba.planning.space import FloorSpace
from robocorba.spatial.grids import Longs
from robocorba.spatial.pose import XY

#: A robot of this radius shows whether the walls leave any way at all, m.
THIN_M = 0.02
#: Nodes of a piece of the topological map that are named, and one-way edges that are.
NAMES_SHOWN, MOST_ONE_WAY = 4, 16
#: A way that passes this near to a doorway leads through it, m.
DOORWAY_M = 0.3


def what_stands_at(space: FloorSpace, x: float, y: float, radius: float) -> tuple[str, float]:
    """What keeps a robot of `radius` from standing at a point, and how near it is (m, 0 within it)."""
    point = shapely.Point(x, y)
    for item in space.owners:
        if item.geometry.geom_type == "Polygon" and item.geometry.contains(point):
            return f"{item.kind} {item.name}", 0.0
    if not space.is_ground(x, y):
        return f"the outside of floor {space.floor}", 0.0
    distance, item_near = space.nearest(x, y, radius + 1e-6)
    return (f"{item_near.kind} {item_near.name}" if item_near else "nothing"), distance


def why_no_path(snapshot: Snapshot, request: PathRequest, deadline: float) -> tuple[str, list[Blocker]]:
    """A sentence, and the things that would have to change for a path to exist."""
    building = snapshot.building
    start, goal = request.start, request.goal
    if start.floor != goal.floor:
        unserved = _unserved(building, request)
        if unserved:
            return f"no elevator leads from {start.floor} to {goal.floor}", unserved
    on_roads = request.mode is RouteMode.TOPOLOGICAL or bool(request.graph and request.mode is RouteMode.SMOOTHED)
    if on_roads:
        for which, place, outbound in (("start", start, True), ("goal", goal, False)):
            if not len(topological.around_corners(snapshot, request, place, outbound, deadline).nodes):
                return f"the {which} reaches no path node", _around(snapshot, request, place, deadline)
    thin = request._replace(radius=min(THIN_M, request.radius), avoid_elevators=frozenset(), graph="", alternatives=0)
    if on_roads:
        found = topological.ways(snapshot, thin._replace(mode=RouteMode.TOPOLOGICAL), deadline)
    else:
        found = geometric.ways(snapshot, thin, deadline)
    if found:
        blockers = _narrow(snapshot, request, snapshot.path(found[0], thin))
        if blockers:
            return f"no path for a robot of radius {request.radius:g} m", blockers
    locked = _locked_doors(snapshot, thin, deadline)
    if locked:
        return "locked doors are in the way", locked
    if on_roads:
        return "start and goal are not connected", _unconnected(snapshot, request, deadline)
    if found:
        return "one-way edges forbid every way", _one_way_edges(building, request)
    floors = dict.fromkeys((start.floor, goal.floor))
    return "start and goal are not connected", [
        Blocker("floor", "", floor, "its walls leave no way") for floor in floors
    ]


def _locked_doors(snapshot: Snapshot, thin: PathRequest, deadline: float) -> list[Blocker]:
    """The locked doors on the way that a thin robot has where all doors are open."""
    opened = snapshot.with_doors_unlocked()
    if opened is None:
        return []
    found = geometric.ways(opened, thin._replace(mode=RouteMode.GEOMETRIC), deadline)
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
    """The floor that no elevator serves, or the elevators that are avoided, where that is the reason."""
    for place in (request.start, request.goal):
        serving = [name for name, lift in building.elevators.items() if place.floor in lift.floors()]
        if not serving:
            return [Blocker("floor", "", place.floor, "no elevator serves it")]
        if all(name in request.avoid_elevators for name in serving):
            return [Blocker("elevator", "", name, f"serves {place.floor}, but is to be avoided") for name in serving]
    return []


def _narrow(snapshot: Snapshot, request: PathRequest, path: Path) -> list[Blocker]:
    """What a thin robot's path passes that the robot itself can't."""
    blockers: dict[tuple[str, str, str], Blocker] = {}
    for here, there in pairwise(path.points):
        if here.kind is PointKind.ELEVATOR_ENTRY:
            avoided = here.elevator in request.avoid_elevators
            found = [Blocker("elevator", "", here.elevator, "is to be avoided")] if avoided else []
        else:
            found = _narrow_places(
                snapshot, request, here.floor, {here.node, there.node}, (here.x, here.y), (there.x, there.y)
            )
        for blocker in found:
            blockers.setdefault((blocker.kind, blocker.floor, blocker.name), blocker)
    return list(blockers.values())


def _narrow_places(
    snapshot: Snapshot, request: PathRequest, floor: str, nodes: set[str], a: XY, b: XY
) -> list[Blocker]:
    """What keeps the robot from driving from a to b; `nodes` are those at the ends."""
    space, needed = snapshot.spaces[floor], 2 * request.radius
    entry = snapshot.building.floors[floor]
    found = []
    for edge in entry.topological.edges.values():
        if {edge.a, edge.b} != nodes:
            continue
        if edge.clearance and edge.clearance < request.radius:
            found.append(Blocker("edge", floor, edge.name, f"is for robots of at most {edge.clearance:g} m radius"))
        if request.graph and edge.graphs and request.graph not in edge.graphs:
            found.append(Blocker("edge", floor, edge.name, f"is not of graph {request.graph}"))
    if space.line_is_free(*a, *b, request.radius):
        return found
    line = shapely.LineString([a, b])
    narrow_doors = [
        Blocker(
            "door",
            floor,
            door.name,
            "is {} m wide, {} m needed".format(*_told_apart(math.dist(door.a, door.b), needed)),
        )
        for door in entry.geometrical.doors.values()
        if math.dist(door.a, door.b) < needed and line.distance(shapely.LineString([door.a, door.b])) < DOORWAY_M
    ]
    if narrow_doors:
        return found + narrow_doors
    clearance, item = space.nearest_to_line(*a, *b, request.radius)
    if item is not None:
        reason = "is {} m from the way, {} m needed".format(*_told_apart(clearance, request.radius))
        found.append(Blocker(item.kind, "" if item.kind in ("elevator", "floor") else floor, item.name, reason))
    return found


def _told_apart(first: float, second: float) -> tuple[str, str]:
    """Two lengths with as many digits as it takes to see that they differ, two at least."""
    for digits in range(2, 9):
        texts = f"{first:.{digits}f}", f"{second:.{digits}f}"
        if texts[0] != texts[1]:
            break
    return texts


def _around(snapshot: Snapshot, request: PathRequest, place: Place, deadline: float) -> list[Blocker]:
    """Why a place reaches no node: the narrow spot on a thin robot's way, or the map without nodes."""
    entry = snapshot.building.floors[place.floor]
    if not entry.topological.nodes:
        return [Blocker("floor", "", place.floor, "has no path nodes; build its topological map")]
    nodes = sorted(entry.topological.nodes.values(), key=lambda node: math.dist(node.at, place[1:]))
    thin = snapshot.graph(place.floor, min(THIN_M, request.radius))
    legs = thin.legs(place[1:], [node.at for node in nodes[:16]], deadline=deadline)
    best = min(legs, key=lambda leg: leg.length)
    if not math.isfinite(best.length):
        return [Blocker("floor", "", place.floor, "its walls close the place off")]
    found = [_narrow_places(snapshot, request, place.floor, {""}, a, b) for a, b in pairwise(best.points.tolist())]
    return list({blocker.name: blocker for blockers in found for blocker in blockers}.values())


def _unconnected(snapshot: Snapshot, request: PathRequest, deadline: float) -> list[Blocker]:
    """The pieces of the topological map that start and goal are tied to; its one-way edges where it is one piece."""
    component = snapshot.components(request.radius, request.avoid_elevators, request.graph)
    pieces = []
    for place, outbound in ((request.start, True), (request.goal, False)):
        nodes = topological.around_corners(snapshot, request, place, outbound, deadline).nodes
        pieces.append(set(component[nodes].tolist()))
    if pieces[0] & pieces[1]:
        return _one_way_edges(snapshot.building, request)
    start, goal = (_piece(snapshot, component, numbers) for numbers in pieces)
    reason = (
        f"its topological map is in pieces: {start}, tied to the start, is not connected with {goal}, tied to the goal"
    )
    return [Blocker("floor", "", floor, reason) for floor in dict.fromkeys((request.start.floor, request.goal.floor))]


def _piece(snapshot: Snapshot, component: Longs, numbers: set[int]) -> str:
    """How many nodes are in these components, and the names of the first of them."""
    nodes = np.flatnonzero(np.isin(component, list(numbers)))
    names = [snapshot.roads.names.nodes[node] for node in nodes[:NAMES_SHOWN].tolist()]
    more = ", ..." if len(nodes) > NAMES_SHOWN else ""
    return f"{len(nodes)} node{'s' if len(nodes) > 1 else ''} ({', '.join(names)}{more})"


def _one_way_edges(building: Building, request: PathRequest) -> list[Blocker]:
    """The one-way edges of the floors of start and goal."""
    return [
        Blocker("edge", floor, edge.name, "is one-way")
        for floor in dict.fromkeys((request.start.floor, request.goal.floor))
        for edge in building.floors[floor].topological.edges.values()
        if edge.one_way
    ][:MOST_ONE_WAY]
