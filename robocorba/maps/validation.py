"""The rules of a building, each stated once: checked in full on load, and where an edit can have broken them.

`problems` looks at everything. `check_change` trusts that the building was in order
before and looks only at what the touched elements can affect; both go through the
same rules, so they agree.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import islice, pairwise

import numpy as np
import shapely
from shapely import LineString, Polygon, STRtree

from robocorba.errors import InvalidElement, describe
from robocorba.maps.element_rules import MIN_LENGTH, SLACK_M, faults, name_faults
from robocorba.maps.geometry import DOOR_REACH_M, Obstacle, obstacles, shaft_polygon
from robocorba.maps.model import (
    KIND_OF,
    Building,
    Element,
    ElementKind,
    Elevator,
    FloorMap,
    PathEdge,
    PathNode,
    TopologicalMap,
)
from robocorba.maps.vicinity import (
    Box,
    Same,
    around,
    elevator_box,
    enclose,
    line_box,
    object_box,
    point_box,
    walls_cut_by,
)

#: A node nearer than this to an obstacle stands on it, m.
TOUCH_M = 1e-3
#: Shafts that share less than this touch but don't overlap, m².
SHARED_M2 = 1e-6


def problems(building: Building, limit: int = 100) -> list[InvalidElement]:
    """The first `limit` broken rules of a building, none when it is in order.

    Rules between elements are looked at once each element is right by itself."""
    found = list(islice(_alone(building), limit))
    return found or list(islice(_together(building), limit))


def check_element(floor: str, element: Element) -> None:
    """Raise InvalidElement when `element` breaks a rule by itself."""
    for reason in faults(element):
        raise _invalid(floor, element, reason)


def check_change(after: Building, touched: Iterable[tuple[ElementKind, str, str]], before: Building) -> None:
    """Raise the first InvalidElement that a change can have caused.

    `before` is in order; `after` differs from it only in the `touched` elements, named by
    kind, floor ("" for floors and elevators) and name: new, changed or removed ones."""
    names: dict[str, dict[ElementKind, set[str]]] = {}
    for kind, floor, name in touched:
        names.setdefault(floor, {}).setdefault(kind, set()).add(name)
        element = after.find(kind, floor, name)
        if element is not None:
            check_element(floor, element)
    for wrong in _changed(after, names, before):
        raise wrong


def _alone(building: Building) -> Iterator[InvalidElement]:
    for reason in name_faults("the name", building.name):
        yield InvalidElement("building", "", building.name, reason)
    for kind in ElementKind:
        for floor in [""] if kind in (ElementKind.FLOOR, ElementKind.ELEVATOR) else building.floors:
            for element in building.elements(kind, floor).values():
                for reason in faults(element):
                    yield _invalid(floor, element, reason)


def _together(building: Building) -> Iterator[InvalidElement]:
    yield from _storeys(building)
    yield from _service(building, building.elevators.values())
    yield from _shafts(building, building.elevators)
    for name, entry in building.floors.items():
        topology = entry.topological
        yield from _cabins(building, name, topology.nodes.values())
        yield from _ends(name, topology.nodes, topology.edges.values())
        paths = _all_paths(Same(topology))
        yield from _outside(entry, paths)
        yield from _collisions(name, paths, obstacles(building, name))


Names = dict[ElementKind, set[str]]


def _changed(after: Building, names: dict[str, Names], before: Building) -> Iterator[InvalidElement]:
    whole = names.get("", {})
    floors = whole.get(ElementKind.FLOOR, set())
    lifts = whole.get(ElementKind.ELEVATOR, set())
    if floors:
        yield from _storeys(after, floors)
        yield from _service(after, after.elevators.values())
    if lifts:
        changed = [after.elevators[name] for name in lifts if name in after.elevators]
        yield from _service(after, changed)
        yield from _shafts(after, [elevator.name for elevator in changed])
    for floor, entry in after.floors.items():
        here = names.get(floor, {})
        if not (here or lifts or floor in floors):
            continue
        if floor in before.floors:
            yield from _changed_paths(after, floor, here, before.floors[floor].topological)
        else:
            yield from _changed_paths(after, floor, here, TopologicalMap())
        if lifts:
            riders = (node for node in _riders(Same(entry.topological)) if node.elevator in lifts)
            yield from _cabins(after, floor, riders)
        if floor in floors:
            yield from _outside(entry, _all_paths(Same(entry.topological)))
        yield from _changed_obstacles(after, floor, here, lifts, floor in floors, before)


def _changed_paths(after: Building, floor: str, here: Names, before: TopologicalMap) -> Iterator[InvalidElement]:
    """New and changed nodes and edges, and the edges whose nodes moved or went, against the whole floor."""
    entry = after.floors[floor]
    nodes, edges = entry.topological.nodes, entry.topological.edges
    touched = here.get(ElementKind.NODE, set())
    moved = touched & before.nodes.keys()
    some_nodes = {name: nodes[name] for name in touched if name in nodes}
    some_edges = {name: edges[name] for name in here.get(ElementKind.EDGE, ()) if name in edges}
    if moved:
        some_edges.update((name, edge) for name, edge in edges.items() if edge.a in moved or edge.b in moved)
    if not (some_nodes or some_edges):
        return
    yield from _cabins(after, floor, some_nodes.values())
    yield from _ends(floor, nodes, some_edges.values())
    paths = _Paths(some_nodes.values(), some_edges.values(), nodes)
    yield from _outside(entry, paths)
    yield from _collisions(floor, paths, around(after, floor, paths.box()))


def _changed_obstacles(
    after: Building, floor: str, here: Names, lifts: set[str], outline: bool, before: Building
) -> Iterator[InvalidElement]:
    """All nodes and edges of a floor against what is new in their way: walls that lost a door count as new."""
    plan = after.floors[floor].geometrical
    suspects = {(kind.value, name) for kind, names in here.items() for name in names}
    suspects |= {("elevator", name) for name in lifts} | ({("floor", floor)} if outline else set())
    openings = [elevator_box(before.elevators[name]) for name in lifts if name in before.elevators]
    if floor in before.floors:
        doors = before.floors[floor].geometrical.doors
        openings += [
            line_box(doors[name], 2 * DOOR_REACH_M) for name in here.get(ElementKind.DOOR, ()) if name in doors
        ]
    reopened = set(walls_cut_by(after, floor, openings))
    suspects |= {("wall", name) for name in reopened}

    walls = reopened | here.get(ElementKind.WALL, set())
    boxes = [line_box(plan.walls[name]) for name in walls if name in plan.walls]
    boxes += [line_box(plan.doors[name]) for name in here.get(ElementKind.DOOR, ()) if name in plan.doors]
    boxes += [object_box(plan.objects[name]) for name in here.get(ElementKind.OBJECT, ()) if name in plan.objects]
    boxes += [elevator_box(after.elevators[name]) for name in lifts if name in after.elevators]
    if outline:
        boxes += [point_box(point, TOUCH_M) for point in after.floors[floor].floor.outline]
    box = enclose(boxes)
    if box is not None:
        found = [item for item in around(after, floor, box) if (item.kind, item.name) in suspects]
        yield from _collisions(floor, _all_paths(Same(after.floors[floor].topological)), found)


def _storeys(building: Building, blamed: Collection[str] = ()) -> Iterator[InvalidElement]:
    """Floors differ in level, and a higher level is higher. Of two floors that clash, one in `blamed` is named."""
    ordered = sorted((entry.floor for entry in building.floors.values()), key=lambda floor: floor.level)
    for lower, upper in pairwise(ordered):
        floor, other = (lower, upper) if lower.name in blamed and upper.name not in blamed else (upper, lower)
        if lower.level == upper.level:
            yield _invalid("", floor, f"level {floor.level} is that of {describe('floor', '', other.name)}")
        elif lower.elevation >= upper.elevation:
            yield _invalid(
                "",
                floor,
                f"elevation {floor.elevation:g} m at level {floor.level} does not fit "
                f"{describe('floor', '', other.name)}: {other.elevation:g} m at level {other.level}",
            )


def _service(building: Building, elevators: Iterable[Elevator]) -> Iterator[InvalidElement]:
    """Elevators serve floors that exist."""
    for elevator in elevators:
        for floor in elevator.floors():
            if floor not in building.floors:
                yield _invalid("", elevator, f"it serves {describe('floor', '', floor)}, which does not exist")


def _shafts(building: Building, names: Collection[str]) -> Iterator[InvalidElement]:
    """Shafts keep apart: those of `names` from all."""
    others = [(elevator, elevator_box(elevator)) for elevator in building.elevators.values()]
    seen: set[str] = set()
    for name in names:
        elevator = building.elevators[name]
        box, shaft = elevator_box(elevator), shaft_polygon(elevator)
        seen.add(name)
        for other, reach in others:
            if other.name in seen or not reach.meets(box):
                continue
            if shaft.intersection(shaft_polygon(other)).area > SHARED_M2:
                yield _invalid("", elevator, f"its shaft overlaps that of {describe('elevator', '', other.name)}")


def _cabins(building: Building, floor: str, nodes: Iterable[PathNode]) -> Iterator[InvalidElement]:
    """A node that names an elevator stands in its shaft on a floor that it serves."""
    for node in nodes:
        if not node.elevator:
            continue
        elevator = building.elevators.get(node.elevator)
        what = describe("elevator", "", node.elevator)
        if elevator is None:
            yield _invalid(floor, node, f"it names {what}, which does not exist")
        elif floor not in elevator.floors():
            yield _invalid(floor, node, f"it names {what}, which does not serve this floor")
        elif shapely.distance(shaft_polygon(elevator), shapely.Point(node.at)) > SLACK_M:
            yield _invalid(floor, node, f"it names {what} but stands outside its shaft")


def _ends(floor: str, nodes: dict[str, PathNode], edges: Iterable[PathEdge]) -> Iterator[InvalidElement]:
    """An edge joins two nodes of its floor that are apart."""
    for edge in edges:
        missing = [name for name in (edge.a, edge.b) if name not in nodes]
        for name in missing:
            yield _invalid(floor, edge, f"{describe('node', '', name)} does not exist on this floor")
        if not missing and math.dist(nodes[edge.a].at, nodes[edge.b].at) < MIN_LENGTH:
            yield _invalid(floor, edge, "it has no length: its nodes stand at the same place")


def _outside(entry: FloorMap, paths: _Paths) -> Iterator[InvalidElement]:
    """Nodes stand within the outline; edges that leave it cross it, which `_collisions` sees."""
    if not (entry.floor.outline and paths.nodes):
        return
    outline = Polygon(entry.floor.outline)
    shapely.prepare(outline)
    for index in np.flatnonzero(~shapely.contains_xy(outline, paths.at)):
        yield _invalid(entry.floor.name, paths.nodes[index], "it stands outside the outline of the floor")


def _collisions(floor: str, paths: _Paths, found: Sequence[Obstacle]) -> Iterator[InvalidElement]:
    """Nodes stand and edges lead clear of every obstacle in `found`."""
    if not found:
        return
    tree = STRtree([item.geometry for item in found])
    x0, y0, x1, y1 = shapely.total_bounds(tree.geometries)
    nodes, edges = paths.within(Box(x0 - TOUCH_M, y0 - TOUCH_M, x1 + TOUCH_M, y1 + TOUCH_M))
    hits = tree.query(shapely.points(paths.at[nodes]), predicate="dwithin", distance=TOUCH_M)
    for index, hit in hits.T:
        thing = found[hit]
        how = "stands inside" if thing.geometry.geom_type == "Polygon" else "stands on"
        yield _invalid(floor, paths.nodes[nodes[index]], f"it {how} {_called(thing)}")
    hits = tree.query(shapely.linestrings(paths.ends[edges]), predicate="intersects")
    for index, hit in hits.T:
        thing, which = found[hit], edges[index]
        spot = thing.geometry.intersection(LineString(paths.ends[which])).representative_point()
        yield _invalid(floor, paths.edges[which], f"it leads through {_called(thing)} near {spot.x:g}, {spot.y:g}")


def _called(thing: Obstacle) -> str:
    if thing.kind == "elevator":
        return f"the shaft of {describe('elevator', '', thing.name)}"
    if thing.kind == "floor":
        return "the outline of the floor"
    return describe("locked door" if thing.kind == "door" else thing.kind, "", thing.name)


class _Paths:
    """Nodes and edges as arrays: `at` (n, 2) and `ends` (m, 2, 2), m. Edges without both nodes are left out."""

    def __init__(self, nodes: Iterable[PathNode], edges: Iterable[PathEdge], known: dict[str, PathNode]) -> None:
        self.nodes = list(nodes)
        self.edges = [edge for edge in edges if edge.a in known and edge.b in known]
        self.at = np.array([node.at for node in self.nodes], dtype=float).reshape(-1, 2)
        ends = [(*known[edge.a].at, *known[edge.b].at) for edge in self.edges]
        self.ends = np.array(ends, dtype=float).reshape(-1, 2, 2)
        self._node_columns = np.ascontiguousarray(self.at.T)
        a, b = self.ends[:, 0].T, self.ends[:, 1].T
        self._low, self._high = np.ascontiguousarray(np.minimum(a, b)), np.ascontiguousarray(np.maximum(a, b))

    def box(self) -> Box:
        """The box around all, grown by TOUCH_M. There must be a node or an edge."""
        points = np.concatenate([self.at, self.ends.reshape(-1, 2)])
        low, high = points.min(axis=0) - TOUCH_M, points.max(axis=0) + TOUCH_M
        return Box(float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    def within(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the nodes and of the edges that can reach into `box`."""
        nodes = _meeting(self._node_columns, self._node_columns, box)
        return nodes, _meeting(self._low, self._high, box)


def _meeting(low: np.ndarray, high: np.ndarray, box: Box) -> np.ndarray:
    return np.flatnonzero((high[0] >= box.x0) & (low[0] <= box.x1) & (high[1] >= box.y0) & (low[1] <= box.y1))


@lru_cache(maxsize=16)
def _all_paths(topology: Same[TopologicalMap]) -> _Paths:
    nodes = topology.value.nodes
    return _Paths(nodes.values(), topology.value.edges.values(), nodes)


@lru_cache(maxsize=16)
def _riders(topology: Same[TopologicalMap]) -> tuple[PathNode, ...]:
    return tuple(node for node in topology.value.nodes.values() if node.elevator)


def _invalid(floor: str, element: Element, reason: str) -> InvalidElement:
    return InvalidElement(KIND_OF[type(element)].value, floor, element.name, reason)
