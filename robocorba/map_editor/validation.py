"""The rules of a building, each defined once: checked completely on load, and partially for an edit.

`problems` checks everything. `check_change` requires a valid building before the edit and
checks only what the touched elements can affect. Both use the same rules.

A wall, an object or a locked door may be placed on existing nodes and edges. It blocks them
(see checking.py), which breaks no rule. Placing a node or an edge on such an obstacle does
break a rule, and `check_change` reports it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import islice, pairwise

import numpy as np
import shapely
from shapely import Polygon

from robocorba.errors.maps import InvalidElement, describe
from robocorba.map_editor.collisions import (
    STRUCTURAL_KINDS,
    TOUCH_M,
    Collision,
    Pair,
    PathArrays,
    all_paths,
    collisions,
)
from robocorba.map_editor.element_rules import MIN_LENGTH, TOLERANCE_M, name_violations, violations
from robocorba.map_editor.geometry import DOOR_REACH_M, obstacles, shaft_polygon
from robocorba.map_editor.model import (
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
from robocorba.map_editor.vicinity import (
    bounding_box,
    elevator_box,
    line_box,
    named_obstacles,
    object_box,
    obstacles_near,
    point_box,
    walls_intersecting,
)


def problems(building: Building, limit: int = 100) -> list[InvalidElement]:
    """The first `limit` broken rules of a building, empty if it is valid.

    Rules between elements are checked only if each element alone is valid."""
    found = list(islice(_element_violations(building), limit))
    return found or list(islice(_relation_violations(building), limit))


def check_element(floor: str, element: Element) -> None:
    """Raise InvalidElement if `element` alone breaks a rule."""
    for reason in violations(element):
        raise _invalid(floor, element, reason)


def check_change(after: Building, touched: Iterable[tuple[ElementKind, str, str]], before: Building) -> list[Collision]:
    """Raise the first InvalidElement that a change causes, else return the nodes and edges that it blocks.

    `before` is valid. `after` differs from it only in the `touched` (new, changed or removed)
    elements, given by kind, floor ("" for floors and elevators) and name."""
    keys = list(touched)
    for kind, floor, name in keys:
        element = after.find(kind, floor, name)
        if element is not None:
            check_element(floor, element)
    blocked = []
    for found in _changed(after, _by_floor(keys), before):
        if isinstance(found, InvalidElement):
            raise found
        blocked.append(found)
    return blocked


def change_problems(
    after: Building, touched: Iterable[tuple[ElementKind, str, str]], before: Building, limit: int
) -> list[InvalidElement]:
    """At most `limit` broken rules, by kind, floor and name. Each touched element alone is valid."""
    found = (each for each in _changed(after, _by_floor(touched), before) if isinstance(each, InvalidElement))
    unique: dict[str, InvalidElement] = {}
    for problem in found:
        unique.setdefault(str(problem), problem)
        if len(unique) == limit:
            break
    return sorted(unique.values(), key=lambda problem: (problem.kind, problem.floor, problem.name))


def _element_violations(building: Building) -> Iterator[InvalidElement]:
    for reason in name_violations("the name", building.name):
        yield InvalidElement("building", "", building.name, reason)
    for kind in ElementKind:
        for floor in [""] if kind in (ElementKind.FLOOR, ElementKind.ELEVATOR) else building.floors:
            for element in building.elements(kind, floor).values():
                for reason in violations(element):
                    yield _invalid(floor, element, reason)


def _relation_violations(building: Building) -> Iterator[InvalidElement]:
    yield from _level_violations(building)
    yield from _served_floor_violations(building, building.elevators.values())
    yield from _shaft_overlaps(building, building.elevators)
    for name, entry in building.floors.items():
        topology = entry.topological
        yield from _cabin_node_violations(building, name, topology.nodes.values())
        yield from _edge_end_violations(name, topology.nodes, topology.edges.values())
        paths = all_paths(topology)
        yield from _nodes_outside_outline(entry, paths)
        structure = [item for item in obstacles(building, name) if item.kind in STRUCTURAL_KINDS]
        yield from (found.error() for found in collisions(name, paths, structure))


TouchedNames = dict[ElementKind, set[str]]


def _by_floor(touched: Iterable[tuple[ElementKind, str, str]]) -> dict[str, TouchedNames]:
    names: dict[str, TouchedNames] = {}
    for kind, floor, name in touched:
        names.setdefault(floor, {}).setdefault(kind, set()).add(name)
    return names


def _changed(after: Building, names: dict[str, TouchedNames], before: Building) -> Iterator[InvalidElement | Collision]:
    """The rules that a change breaks, then the collisions that it causes."""
    whole = names.get("", {})
    floors = whole.get(ElementKind.FLOOR, set())
    lifts = whole.get(ElementKind.ELEVATOR, set())
    if floors:
        yield from _level_violations(after, floors)
        yield from _served_floor_violations(after, after.elevators.values())
    if lifts:
        changed = [after.elevators[name] for name in lifts if name in after.elevators]
        yield from _served_floor_violations(after, changed)
        yield from _shaft_overlaps(after, [elevator.name for elevator in changed])
    for floor, entry in after.floors.items():
        on_floor = names.get(floor, {})
        new_shafts = _new_shafts(after, floor, before) if floors else set()
        if not (on_floor or lifts or new_shafts or floor in floors):
            continue
        yield from _changed_paths(after, floor, on_floor, before)
        if lifts:
            cabin_nodes = (node for node in entry.topological.nodes.values() if node.elevator in lifts)
            yield from _cabin_node_violations(after, floor, cabin_nodes)
        if floor in floors:
            yield from _nodes_outside_outline(entry, all_paths(entry.topological))
        found = _changed_obstacles(after, floor, on_floor, lifts | new_shafts, floor in floors, before)
        yield from (collision.error() for collision in found if collision.is_structural)
        known = _blocked_before(before, floor, found)
        yield from (collision for collision in found if collision.pair not in known)


def _new_shafts(after: Building, floor: str, before: Building) -> set[str]:
    """Elevators whose shaft passes a floor only now that floors have another height."""
    known = {elevator.name for elevator in before.elevators_through(floor)} if floor in before.floors else set()
    return {elevator.name for elevator in after.elevators_through(floor)} - known


def _changed_paths(after: Building, floor: str, on_floor: TouchedNames, before: Building) -> Iterator[InvalidElement]:
    """Check new and changed nodes and edges, and the edges whose nodes moved or disappeared, on the whole floor.

    New, moved and reconnected ones must be free of obstacles. An edge that only follows its
    nodes may stay on an obstacle that blocked it before."""
    entry = after.floors[floor]
    old = before.floors[floor].topological if floor in before.floors else TopologicalMap()
    nodes, edges = entry.topological.nodes, entry.topological.edges
    touched = on_floor.get(ElementKind.NODE, set())
    some_nodes = {name: nodes[name] for name in touched if name in nodes}
    some_edges = {name: edges[name] for name in on_floor.get(ElementKind.EDGE, ()) if name in edges}
    placed = {name: node for name, node in some_nodes.items() if name not in old.nodes or old.nodes[name].at != node.at}
    drawn = {
        name: edge
        for name, edge in some_edges.items()
        if name not in old.edges or {old.edges[name].a, old.edges[name].b} != {edge.a, edge.b}
    }
    moved = (touched & old.nodes.keys()) - (some_nodes.keys() - placed.keys())
    reshaped = {name: edge for name, edge in edges.items() if edge.a in moved or edge.b in moved} if moved else {}
    yield from _cabin_node_violations(after, floor, some_nodes.values())
    yield from _edge_end_violations(floor, nodes, {**reshaped, **some_edges}.values())
    if not (placed or drawn or reshaped):
        return
    paths = PathArrays(placed.values(), {**reshaped, **drawn}.values(), nodes)
    yield from _nodes_outside_outline(entry, paths)
    found = list(collisions(floor, paths, obstacles_near(after, floor, paths.box())))
    followers = [item for item in found if item.element.name not in drawn and isinstance(item.element, PathEdge)]
    known = _blocked_before(before, floor, followers)
    yield from (item.error() for item in found if item.pair not in known)


def _blocked_before(before: Building, floor: str, found: Sequence[Collision]) -> set[Pair]:
    """The given collisions that existed before, and possibly others."""
    if not found or floor not in before.floors:
        return set()
    topology = before.floors[floor].topological
    names = {item.element.name for item in found}
    nodes = [topology.nodes[name] for name in names if name in topology.nodes]
    edges = [topology.edges[name] for name in names if name in topology.edges]
    causes = named_obstacles(before, floor, {(item.obstacle.kind, item.obstacle.name) for item in found})
    return {item.pair for item in collisions(floor, PathArrays(nodes, edges, topology.nodes), causes)}


def _changed_obstacles(
    after: Building, floor: str, on_floor: TouchedNames, lifts: set[str], outline: bool, before: Building
) -> list[Collision]:
    """Collisions of all nodes and edges of a floor with new obstacles. Walls that lost a door count as new."""
    plan = after.floors[floor].geometrical
    suspects = {(kind.value, name) for kind, names in on_floor.items() for name in names}
    suspects |= {("elevator", name) for name in lifts} | ({("floor", floor)} if outline else set())
    openings = [elevator_box(before.elevators[name]) for name in lifts if name in before.elevators]
    if floor in before.floors:
        doors = before.floors[floor].geometrical.doors
        openings += [
            line_box(doors[name], 2 * DOOR_REACH_M) for name in on_floor.get(ElementKind.DOOR, ()) if name in doors
        ]
    reopened = set(walls_intersecting(after, floor, openings))
    suspects |= {("wall", name) for name in reopened}

    walls = reopened | on_floor.get(ElementKind.WALL, set())
    boxes = [line_box(plan.walls[name]) for name in walls if name in plan.walls]
    boxes += [line_box(plan.doors[name]) for name in on_floor.get(ElementKind.DOOR, ()) if name in plan.doors]
    boxes += [object_box(plan.objects[name]) for name in on_floor.get(ElementKind.OBJECT, ()) if name in plan.objects]
    boxes += [elevator_box(after.elevators[name]) for name in lifts if name in after.elevators]
    if outline:
        boxes += [point_box(point, TOUCH_M) for point in after.floors[floor].floor.outline]
    box = bounding_box(boxes)
    if box is None:
        return []
    found = [item for item in obstacles_near(after, floor, box) if (item.kind, item.name) in suspects]
    return list(collisions(floor, all_paths(after.floors[floor].topological), found))


def _level_violations(building: Building, preferred: Collection[str] = ()) -> Iterator[InvalidElement]:
    """Levels of floors are unique and rise with elevation. Of two conflicting floors, one in `preferred` is named."""
    ordered = sorted((entry.floor for entry in building.floors.values()), key=lambda floor: floor.level)
    for lower, upper in pairwise(ordered):
        floor, other = (lower, upper) if lower.name in preferred and upper.name not in preferred else (upper, lower)
        if lower.level == upper.level:
            yield _invalid("", floor, f"level {floor.level} is that of {describe('floor', '', other.name)}")
        elif lower.elevation >= upper.elevation:
            yield _invalid(
                "",
                floor,
                f"elevation {floor.elevation:g} m at level {floor.level} does not fit "
                f"{describe('floor', '', other.name)}: {other.elevation:g} m at level {other.level}",
            )


def _served_floor_violations(building: Building, elevators: Iterable[Elevator]) -> Iterator[InvalidElement]:
    """Elevators serve existing floors."""
    for elevator in elevators:
        for floor in elevator.floors():
            if floor not in building.floors:
                yield _invalid("", elevator, f"it serves {describe('floor', '', floor)}, which does not exist")


def _shaft_overlaps(building: Building, names: Collection[str]) -> Iterator[InvalidElement]:
    """The shafts of `names` overlap no other shaft."""
    others = [(elevator, elevator_box(elevator)) for elevator in building.elevators.values()]
    seen: set[str] = set()
    for name in names:
        elevator = building.elevators[name]
        box, shaft = elevator_box(elevator), shaft_polygon(elevator)
        seen.add(name)
        for other, reach in others:
            if other.name in seen or not reach.intersects(box):
                continue
            if shaft.intersection(shaft_polygon(other)).area > 1e-6:  # m²; less where they only touch
                yield _invalid("", elevator, f"its shaft overlaps that of {describe('elevator', '', other.name)}")


def _cabin_node_violations(building: Building, floor: str, nodes: Iterable[PathNode]) -> Iterator[InvalidElement]:
    """A node that names an elevator is in its shaft, on a floor that it serves."""
    for node in nodes:
        if not node.elevator:
            continue
        elevator = building.elevators.get(node.elevator)
        what = describe("elevator", "", node.elevator)
        if elevator is None:
            yield _invalid(floor, node, f"it names {what}, which does not exist")
        elif floor not in elevator.floors():
            yield _invalid(floor, node, f"it names {what}, which does not serve this floor")
        elif shapely.distance(shaft_polygon(elevator), shapely.Point(node.at)) > TOLERANCE_M:
            yield _invalid(floor, node, f"it names {what} but stands outside its shaft")


def _edge_end_violations(floor: str, nodes: dict[str, PathNode], edges: Iterable[PathEdge]) -> Iterator[InvalidElement]:
    """An edge connects two nodes of its floor at different positions."""
    for edge in edges:
        missing = [name for name in (edge.a, edge.b) if name not in nodes]
        for name in missing:
            yield _invalid(floor, edge, f"{describe('node', '', name)} does not exist on this floor")
        if not missing and math.dist(nodes[edge.a].at, nodes[edge.b].at) < MIN_LENGTH:
            yield _invalid(floor, edge, "it has no length: its nodes stand at the same place")


def _nodes_outside_outline(entry: FloorMap, paths: PathArrays) -> Iterator[InvalidElement]:
    """Nodes are within the outline. `collisions` finds edges that cross it."""
    if not (entry.floor.outline and paths.nodes):
        return
    outline = Polygon(entry.floor.outline)
    shapely.prepare(outline)
    for index in np.flatnonzero(~shapely.contains_xy(outline, paths.at)):
        yield _invalid(entry.floor.name, paths.nodes[index], "it stands outside the outline of the floor")


def _invalid(floor: str, element: Element, reason: str) -> InvalidElement:
    return InvalidElement(KIND_OF[type(element)].value, floor, element.name, reason)
