"""A building at one version, compiled for planning; queries share it, edits replace it."""

from __future__ import annotations

import threading
from collections import OrderedDict

import numpy as np

from robocorba.grids import Floats
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building, ElementKind, MapObject, PolygonShape
from robocorba.maps.movable import movables
from robocorba.planning.freeway import Freeways
from robocorba.planning.guide import make_guide
from robocorba.planning.packing import Packed
from robocorba.planning.request import SMARTPAL_RADIUS_M, PathRequest
from robocorba.planning.roads import RoadMap
from robocorba.planning.space import FloorSpace
from robocorba.planning.world import pack_world

#: So many (floor, radius) pairs keep their sight lines, the latest used.
MOST_FREEWAYS = 64
#: So many variants of the building, with forbidden areas or without movables, are kept, the latest used.
MOST_VARIANTS = 8

NO_FACTOR: Floats = np.empty(0)


class Snapshot:
    """Spaces and roads of a building. Immutable but for its caches, which are bounded."""

    def __init__(self, building: Building, version: int, before: Snapshot | None = None) -> None:
        self.building, self.version = building, version
        self.spaces: dict[str, FloorSpace] = {}
        for floor in building.floors:
            known = before.spaces.get(floor) if before else None
            unchanged = known is not None and known.owners is obstacles(building, floor)
            self.spaces[floor] = known if known and unchanged else FloorSpace(building, floor)
        self.roads: RoadMap = RoadMap(building, self.spaces, before.roads if before else None)
        lanes = [part.lanes for part in self.roads.parts.values()]
        self.world = pack_world(list(self.spaces.values()), lanes, self.roads.elevations, self.roads.roads)
        #: For getPath's own robot, which nearly all queries are about.
        self.guide = make_guide(self.roads, 0.0)
        self._asked = 0
        self._guides: dict[tuple[float, frozenset[str]], Packed] = {}
        self._lock = threading.Lock()
        self._freeways: OrderedDict[tuple[str, float], Freeways] = OrderedDict()
        self._variants: OrderedDict[tuple, Snapshot] = OrderedDict()
        self._factors: dict[tuple[frozenset[str], str], Floats] = {}
        if before:
            for key, freeways in list(before._freeways.items()):
                same_space = freeways.space is self.spaces.get(key[0])
                if same_space and np.array_equal(freeways.lanes, self.roads.parts[key[0]].lanes):
                    self._freeways[key] = freeways

    def freeways(self, floor: str, radius_m: float) -> Freeways:
        """The shortest legs on a floor for a radius."""
        with self._lock:
            known = self._freeways.get((floor, radius_m))
            if known:
                self._freeways.move_to_end((floor, radius_m))
                return known
        made = Freeways(self.spaces[floor], self.roads.parts[floor].lanes, radius_m)
        with self._lock:
            self._freeways[floor, radius_m] = made
            while len(self._freeways) > MOST_FREEWAYS:
                self._freeways.popitem(last=False)
        return made

    def as_asked(self, request: PathRequest) -> Snapshot:
        """This building with every area that the request avoids standing there as a solid object, and without what can
        be moved on the floors where the request knows better."""
        floors = frozenset(request.without_movables)
        if not request.avoid_areas and not request.forbidden_areas and not floors:
            return self
        key = (request.avoid_areas, request.forbidden_areas, floors)
        with self._lock:
            known = self._variants.get(key)
        if known:
            return known
        building = _without_movables(self.building, floors)
        named = [
            (floor, f"area {name}", building.floors[floor].geometrical.areas[name].polygon)
            for floor, name in request.avoid_areas
        ]
        numbered = enumerate(request.forbidden_areas)
        unnamed = [(floor, f"forbidden area {i}", polygon) for i, (floor, polygon) in numbered]
        for floor, name, polygon in named + unnamed:
            taken = building.floors[floor].geometrical.objects
            while name in taken:
                name += "'"
            solid = MapObject(name=name, shape=PolygonShape(points=polygon), at=(0.0, 0.0))
            building = building.with_element(floor, solid)
        made = Snapshot(building, self.version, self)
        with self._lock:
            self._variants[key] = made
            while len(self._variants) > MOST_VARIANTS:
                self._variants.popitem(last=False)
        return made

    def count_query(self) -> None:
        """A building that was asked for as many paths as it has nodes gets a table of all costs: it has paid for it."""
        self._asked += 1
        if self._asked == len(self.roads.roads.xy):
            self.guide = make_guide(self.roads, 0.0, radius=SMARTPAL_RADIUS_M)

    def guide_for(self, pace: float, radius: float, avoid: frozenset[str]) -> Packed:
        """The guide for costs in seconds at `pace` m/s, or in metres where it is 0, without the elevators avoided."""
        if pace == 0.0 and radius == SMARTPAL_RADIUS_M and not avoid:
            return self.guide
        known = self._guides.get((pace, avoid))
        if known is None:
            if len(self._guides) >= MOST_VARIANTS:
                self._guides.clear()
            known = self._guides[pace, avoid] = make_guide(self.roads, pace, avoid)
        return known

    def factor(self, avoid_elevators: frozenset[str], graph: str) -> Floats:
        """What multiplies the costs of edges: inf for those that a request must not use; empty where all are open."""
        if not avoid_elevators and not graph:
            return NO_FACTOR
        known = self._factors.get((avoid_elevators, graph))
        if known is None:
            roads = self.roads
            shut = [
                (edge is None and roads.elevators[elevator] in avoid_elevators)
                or bool(graph and edge is not None and edge.graphs and graph not in edge.graphs)
                for edge, elevator in zip(roads.edges, roads.roads.elevator.tolist(), strict=True)
            ]
            known = np.where(shut, np.inf, 1.0)
            if len(self._factors) >= MOST_VARIANTS:
                self._factors.clear()
            self._factors[avoid_elevators, graph] = known
        return known


def _without_movables(building: Building, floors: frozenset[str]) -> Building:
    for thing, floor in movables(building).values() if floors else ():
        if floor in floors:
            building = building.without(ElementKind.OBJECT, floor, thing.name)
    return building
