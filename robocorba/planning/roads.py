"""The topological maps of a whole building as arrays for the search.

Only floors that an edit touched are compiled again; the others come from the previous roadmap.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.model import Building, FloorMap, PathEdge
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.elevators import ride
from robocorba.planning.request import MAX_RADIUS_M, IndexedNames
from robocorba.planning.road_rules import make_lanes
from robocorba.planning.space import FloorSpace, is_ground, line_clearance
from robocorba.system.kernels import kernel
from robocorba.system.lazy_property import lazy_property

#: Columns of RoadmapArrays.measures. Waiting and travelling are 0 s for a drive. The length of a ride is its climb and
#: the drive in the cabin between nodes at different places, DRIVEN [m], negative where that comes before the ride.
LENGTH, CLEARANCE, SPEED_LIMIT, WAIT, TRAVEL, DRIVEN = range(6)
#: Columns of measures.
MEASURES = 6
#: Nodes of a cabin nearer to each other than this are at the same place [m].
SAME_PLACE_M = 1e-6

#: Clearance of an edge that no robot can use, because an obstacle crosses or encloses it.
BLOCKED = -1.0


class RoadmapArrays(NamedTuple):
    """Nodes sorted by floor: xy (n, 2) [m], floor (n,). Edges of node i are first[i]:first[i + 1]: to (m,), elevator
    (m,) or -1 for a drive, measures (m, MEASURES) in m, m/s and s. fixed (m,) is 1 for edges that a drive must follow:
    one-way or with a speed limit."""

    xy: Floats
    floor: Longs
    first: Longs
    to: Longs
    elevator: Longs
    measures: Floats
    fixed: Longs


class FloorRoads:
    """Nodes and edges of one floor, with indices local to the floor."""

    def __init__(self, entry: FloorMap, space: FloorSpace) -> None:
        self.topological, self.space = entry.topological, space
        nodes = entry.topological.nodes
        self.names = list(nodes)
        self.cabins = [(i, node.elevator) for i, node in enumerate(nodes.values()) if node.elevator]
        self.xy = np.array([node.at for node in nodes.values()], float).reshape(-1, 2)
        index = {name: i for i, name in enumerate(self.names)}
        edges = list(entry.topological.edges.values())
        ends = np.array([(index[edge.a], index[edge.b]) for edge in edges], np.int64).reshape(-1, 2)
        clear = _clearances(space.grid, space.borders, space.rings, space.inside, self.xy, ends, MAX_RADIUS_M)
        declared = np.array([edge.clearance or np.inf for edge in edges])
        limits = np.array([edge.speed_limit or np.inf for edge in edges])
        lengths = np.hypot(*(self.xy[ends[:, 0]] - self.xy[ends[:, 1]]).T) if edges else np.empty(0)
        measures = np.column_stack([lengths, np.minimum(clear, declared), limits, np.zeros((len(edges), 3))])
        one_way = np.array([edge.one_way for edge in edges], bool)
        # Each edge forwards, then each two-way edge backwards.
        self.origin = np.concatenate([ends[:, 0], ends[~one_way, 1]])
        self.to = np.concatenate([ends[:, 1], ends[~one_way, 0]])
        self.measures = np.concatenate([measures, measures[~one_way]])
        self.edges: list[PathEdge] = edges + [edge for edge in edges if not edge.one_way]
        self.one_way = np.concatenate([one_way, np.zeros(int((~one_way).sum()), bool)])
        self._edge_ends = ends
        #: The edges that have rules (n, LANE_COLUMNS); see road_rules.py.
        self.lanes = make_lanes(edges, ends, self.xy)

    def lanes_of(self, graph: str) -> Floats:
        """The lanes for requests of a navigation graph: the edges of others are closed."""
        if not graph:
            return self.lanes
        return make_lanes(self.edges[: len(self._edge_ends)], self._edge_ends, self.xy, graph)


@kernel
def _clearances(
    grid: Grid, borders: Floats, rings: Floats, inside: int, xy: Floats, ends: Longs, reach: float
) -> Floats:
    """Distance from each edge to the nearest obstacle [m], at most `reach`; BLOCKED where an obstacle crosses or
    encloses it."""
    ground = np.empty(xy.shape[0], np.bool_)
    for i in range(xy.shape[0]):
        ground[i] = is_ground(borders, rings, inside, xy[i, 0], xy[i, 1])
    found = np.empty(ends.shape[0])
    for i in range(ends.shape[0]):
        a, b = ends[i]
        clear = line_clearance(grid, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], reach)[0]
        found[i] = clear if clear > 0.0 and ground[a] and ground[b] else BLOCKED
    return found


class RoadMap:
    """The roadmap of a building: `roads` for the search, and the names of its indices."""

    def __init__(self, building: Building, spaces: dict[str, FloorSpace], before: RoadMap | None = None) -> None:
        self.building = building
        self.floors = list(building.floors)
        self.floor_index = {name: i for i, name in enumerate(self.floors)}
        self.parts: dict[str, FloorRoads] = {}
        for name, entry in building.floors.items():
            known = before.parts.get(name) if before else None
            if known and known.topological is entry.topological and known.space is spaces[name]:
                self.parts[name] = known
            else:
                self.parts[name] = FloorRoads(entry, spaces[name])
        parts = list(self.parts.values())
        self.offset = np.concatenate([[0], np.cumsum([len(part.names) for part in parts])]).astype(np.int64)
        self.elevators = list(building.elevators)
        nodes = [name for part in parts for name in part.names]
        self.names = IndexedNames([*self.floors, ""], [*nodes, ""], [*self.elevators, ""])
        self.elevations = np.array([entry.floor.elevation for entry in building.floors.values()])
        self._join(parts)

    def _join(self, parts: list[FloorRoads]) -> None:
        """`roads`, from the roads of the floors."""
        count = int(self.offset[-1])
        origins = [part.origin + shift for part, shift in zip(parts, self.offset, strict=False)]
        targets = [part.to + shift for part, shift in zip(parts, self.offset, strict=False)]
        links, rides = self._rides(parts)
        origin = np.concatenate([*origins, links[:, 0]])
        to = np.concatenate([*targets, links[:, 1]])
        measures = np.concatenate([np.empty((0, MEASURES)), *(part.measures for part in parts), rides])
        drives = len(origin) - len(links)
        elevator = np.concatenate([np.full(drives, -1, np.int64), links[:, 2]])
        one_way = np.concatenate([np.empty(0, bool), *(part.one_way for part in parts), np.ones(len(links), bool)])
        order = np.argsort(origin, kind="stable")
        first = np.searchsorted(origin[order], np.arange(count + 1)).astype(np.int64)
        floor = np.repeat(np.arange(len(parts)), np.diff(self.offset)).astype(np.int64)
        xy = np.concatenate([np.empty((0, 2)), *(part.xy for part in parts)])
        fixed = (one_way[order] | np.isfinite(measures[order, SPEED_LIMIT])).astype(np.int64)
        self.roads = RoadmapArrays(xy, floor, first, to[order], elevator[order], measures[order], fixed)
        self._order = order

    @lazy_property
    def edges(self) -> list[PathEdge | None]:
        """The path edge of each index of `roads`; None for a ride."""
        flat: list[PathEdge | None] = [edge for part in self.parts.values() for edge in part.edges]
        flat += [None] * (len(self._order) - len(flat))
        return [flat[i] for i in self._order.tolist()]

    def _rides(self, parts: list[FloorRoads]) -> tuple[Longs, Floats]:
        """Rides between any two floors of an elevator: (from, to, elevator) and measures."""
        building = self.building
        stops: dict[str, list[tuple[str, int]]] = {}
        for floor, part, shift in zip(self.floors, parts, self.offset, strict=False):
            for node, elevator in part.cabins:
                served = building.elevators.get(elevator)
                if served and floor in served.floors():
                    stops.setdefault(elevator, []).append((floor, node + int(shift)))
        links, rides = [], []
        for name, places in stops.items():
            for (origin, a), (destination, b) in permutations(places, 2):
                if origin != destination:
                    wait, travel, climb = ride(building, building.elevators[name], origin, destination)
                    driven, clearance = self._drive_in_cabin(origin, a, destination, b)
                    links.append((a, b, self.elevators.index(name)))
                    rides.append((climb + abs(driven), clearance, np.inf, wait, travel, driven))
        return np.array(links, np.int64).reshape(-1, 3), np.array(rides, float).reshape(-1, MEASURES)

    def _drive_in_cabin(self, origin: str, a: int, destination: str, b: int) -> tuple[float, float]:
        """DRIVEN [m] and the clearance [m] of the drive between the places of a cabin's nodes on two floors. It comes
        after the ride, or before it where there is more room."""
        parts = self.parts[origin], self.parts[destination]
        local = a - self.offset[self.floor_index[origin]], b - self.offset[self.floor_index[destination]]
        ends = np.array([part.xy[node] for part, node in zip(parts, local, strict=True)])
        length = float(np.hypot(*(ends[1] - ends[0])))
        if length < SAME_PLACE_M:
            return 0.0, np.inf
        drive = np.array([[0, 1]])
        before, after = (
            float(_clearances(space.grid, space.borders, space.rings, space.inside, ends, drive, MAX_RADIUS_M)[0])
            for space in (part.space for part in parts)
        )
        return (length, after) if after >= before else (-length, before)
