"""A building at one version, compiled for planning. Queries share it; each edit replaces it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import msgspec
import numpy as np

from robocorba.errors.paths import Blocker, NoPath
from robocorba.map_editor.model import Building, ElementKind, FloorMap, MapObject, PolygonShape, Wall
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.arrays import Floats, Longs, connected_parts
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M, XY
from robocorba.planning.floor_source import FloorSource
from robocorba.planning.heuristics import COST_IN_METRES, make_heuristics
from robocorba.planning.packing import Packed
from robocorba.planning.request import Path, PathRequest
from robocorba.planning.road_rules import RoadRules, closing_walls, lanes_on, road_rules
from robocorba.planning.roads import CLEARANCE, RoadMap
from robocorba.planning.search import points_of
from robocorba.planning.space import TOUCH_M, FloorSpace
from robocorba.planning.tangent_graph import TangentGraph
from robocorba.planning.world import pack_world

#: Why an area blocks.
AVOIDED, FORBIDDEN = "is avoided by the request", "is forbidden by the request"

T = TypeVar("T")


class BuildingSnapshot:
    """Spaces and roadmap of a building. Immutable apart from its bounded caches."""

    def __init__(self, building: Building, version: int, before: BuildingSnapshot | None = None) -> None:
        self.building, self.version = building, version
        #: The areas that the requests of this variant avoid, by floor and the name of the solid object in their place.
        self.avoided: dict[tuple[str, str], Blocker] = {}
        self.spaces: dict[str, FloorSpace] = {}
        for floor in building.floors:
            known = before.spaces.get(floor) if before else None
            unchanged = known is not None and known.source.same_as(FloorSource(building, floor))
            self.spaces[floor] = known if known and unchanged else FloorSpace(building, floor, known)
        self.roads: RoadMap = RoadMap(building, self.spaces, before.roads if before else None)
        lanes = [part.lanes for part in self.roads.parts.values()]
        self.world = pack_world(list(self.spaces.values()), lanes, self.roads.elevations, self.roads.roads)
        #: For the robot and cost of getPath, which nearly all queries use.
        self.heuristics = make_heuristics(self.roads, COST_IN_METRES)
        self._queries = 0
        self._lock = threading.Lock()
        self._graphs: OrderedDict[tuple[str, float], TangentGraph] = OrderedDict()
        #: What requests of a kind need: by what is computed, and for what. The latest are kept.
        self._known: dict[str, dict[Hashable, Any]] = {}
        if before:
            with before._lock:
                kept = list(before._graphs.items())
            self._graphs.update((key, graph) for key, graph in kept if graph.space is self.spaces.get(key[0]))

    def graph(self, floor: str, radius_m: float) -> TangentGraph:
        """The tangent graph of a floor for a radius [m]."""
        with self._lock:
            found = self._graphs.setdefault((floor, radius_m), TangentGraph(self.spaces[floor], radius_m))
            self._graphs.move_to_end((floor, radius_m))
            while len(self._graphs) > 64:  # the least recently used is dropped
                self._graphs.popitem(last=False)
        return found

    def _once(self, what: str, key: Hashable, make: Callable[[], T]) -> T:
        """What has been made for a key, or is made now; the 8 latest of each kind are kept."""
        with self._lock:
            known = self._known.setdefault(what, {}).get(key)
        if known is None:
            known = make()
            with self._lock:
                kept = self._known[what]
                kept[key] = known
                while len(kept) > 8:
                    del kept[next(iter(kept))]
        return known

    def components(self, radius_m: float, avoid_elevators: frozenset[str], graph: str) -> Longs:
        """The component of the roadmap (n,) that each node belongs to for a robot of this radius [m]. One-way edges
        count as two-way."""

        def make() -> Longs:
            roads = self.roads.roads
            usable = roads.measures[:, CLEARANCE] >= radius_m - TOUCH_M
            if len(factor := self.factor(avoid_elevators, graph)):
                usable &= np.isfinite(factor)
            origin = np.repeat(np.arange(len(roads.xy)), np.diff(roads.first))
            return connected_parts(origin[usable], roads.to[usable], len(roads.xy))

        return self._once("components", (radius_m, avoid_elevators, graph), make)

    def rules(self, graph: str) -> RoadRules:
        """The rules of edges for requests of a navigation graph, "" for all edges."""
        parts = self.roads.parts.values()
        return self._once("rules", graph, lambda: road_rules([part.lanes_of(graph) for part in parts]))

    def lanes(self, floor: str, graph: str = "") -> Floats:
        """Those of one floor (n, LANE_COLUMNS)."""
        return lanes_on(self.rules(graph), self.roads.floor_index[floor])

    def path(self, route: Floats, request: PathRequest) -> Path:
        """The path of a route. Raises NoPath if the route comes nearer to an obstacle than the radius."""
        points = points_of(self.world, route, request.radius, request.speed)
        if not len(points):
            raise NoPath(
                f"the path that was found comes nearer than {request.radius:g} m to an obstacle and is withheld; "
                "this is a defect: please report the map, start and goal"
            )
        return Path(points.tolist(), self.roads.names, self.version)

    def variant_for(self, request: PathRequest) -> BuildingSnapshot:
        """This building with every area that the request avoids as a solid object, and without movable objects on
        the request's floors `without_movables`."""
        floors = frozenset(request.without_movables)
        if not request.avoid_areas and not request.forbidden_areas and not floors:
            return self
        key = (request.avoid_areas, request.forbidden_areas, floors)
        return self._once("areas", key, lambda: self._avoiding(request, floors))

    def _avoiding(self, request: PathRequest, floors: frozenset[str]) -> BuildingSnapshot:
        """`variant_for` a request that avoids areas, or movable objects on floors."""
        building = _without_movables(self.building, floors)
        areas = [
            (Blocker("area", floor, name, AVOIDED), building.floors[floor].geometrical.areas[name].polygon)
            for floor, name in request.avoid_areas
        ]
        areas += [
            (Blocker("area", floor, f"forbidden area {i}", FORBIDDEN), polygon)
            for i, (floor, polygon) in enumerate(request.forbidden_areas)
        ]
        avoided: dict[tuple[str, str], Blocker] = {}
        for area, polygon in areas:
            name, taken = area.name, building.floors[area.floor].geometrical.objects
            while name in taken:
                name += "'"
            solid = MapObject(name=name, shape=PolygonShape(points=polygon), at=(0.0, 0.0))
            building = building.with_element(area.floor, solid)
            avoided[area.floor, name] = area
        made = BuildingSnapshot(building, self.version, self)
        made.avoided = avoided
        return made

    def with_roads_closed(self, request: PathRequest) -> BuildingSnapshot | None:
        """This building with walls along the edges that are closed for the request in a direction, with gaps for
        robots at start and goal; None if there are none."""
        walls: dict[str, list[tuple[XY, XY]]] = {}
        for floor in self.building.floors:
            places = [place[1:] for place in (request.start, request.goal) if place.floor == floor]
            if found := closing_walls(self.lanes(floor, request.graph), request.radius, places):
                walls[floor] = found
        if not walls:
            return None
        changes = [
            (ElementKind.WALL, floor, f"closed road {i}", Wall(name=f"closed road {i}", a=a, b=b))
            for floor, found in walls.items()
            for i, (a, b) in enumerate(found)
        ]
        key = tuple((floor, *found) for floor, found in walls.items())
        return self._once(
            "roads closed", key, lambda: BuildingSnapshot(self.building.with_changes(changes), self.version, self)
        )

    def with_doors_unlocked(self) -> BuildingSnapshot | None:
        """This building with every door unlocked; None if none is locked."""
        floors = self.building.floors
        if not any(door.locked for entry in floors.values() for door in entry.geometrical.doors.values()):
            return None
        opened = {floor: _with_doors_unlocked(entry) for floor, entry in floors.items()}
        building = msgspec.structs.replace(self.building, floors=opened)
        return self._once("doors unlocked", "", lambda: BuildingSnapshot(building, self.version, self))

    def count_query(self) -> None:
        """Count a query. After as many queries as the building has nodes, make the table of all costs, which then
        pays off."""
        self._queries += 1
        if self._queries == len(self.roads.roads.xy):
            self.heuristics = make_heuristics(self.roads, COST_IN_METRES, radius=SMARTPAL_RADIUS_M)

    def heuristics_for(self, speed_m_s: float, radius: float, avoid: frozenset[str]) -> Packed:
        """Heuristics for costs in seconds at `speed_m_s`, or in metres with COST_IN_METRES, without the elevators
        `avoid`."""
        if speed_m_s == COST_IN_METRES and radius == SMARTPAL_RADIUS_M and not avoid:
            return self.heuristics
        key = (speed_m_s, avoid)
        return self._once("heuristics", key, lambda: make_heuristics(self.roads, speed_m_s, avoid))

    def factor(self, avoid_elevators: frozenset[str], graph: str) -> Floats:
        """Cost factors of the edges (m,): inf for edges that a request must not use; empty if all are open."""
        if not avoid_elevators and not graph:
            return np.empty(0)

        def make() -> Floats:
            roads = self.roads
            is_closed = [
                (edge is None and roads.elevators[elevator] in avoid_elevators)
                or bool(graph and edge is not None and edge.graphs and graph not in edge.graphs)
                for edge, elevator in zip(roads.edges, roads.roads.elevator.tolist(), strict=True)
            ]
            return np.where(is_closed, np.inf, 1.0)

        return self._once("factor", (avoid_elevators, graph), make)


def _with_doors_unlocked(entry: FloorMap) -> FloorMap:
    doors = {
        name: msgspec.structs.replace(door, locked=False) if door.locked else door
        for name, door in entry.geometrical.doors.items()
    }
    return msgspec.structs.replace(entry, geometrical=msgspec.structs.replace(entry.geometrical, doors=doors))


def _without_movables(building: Building, floors: frozenset[str]) -> Building:
    for movable, floor in movables(building).values() if floors else ():
        if floor in floors:
            building = building.without(ElementKind.OBJECT, floor, movable.name)
    return building
