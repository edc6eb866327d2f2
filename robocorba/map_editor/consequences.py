"""What an edit changes beside its elements so that the building stays valid, such as the edges of a removed node."""

from __future__ import annotations

from collections.abc import Iterator, Set
from itertools import count

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor.changes import ElementKey
from robocorba.map_editor.element_rules import MAX_NAME
from robocorba.map_editor.model import Building, Element, ElementKind, Elevator, PathNode
from robocorba.map_editor.spatial.frames import turned

#: The elements that an edit leaves behind: None for a removed one.
Outcome = dict[ElementKey, Element | None]


def with_consequences(building: Building, wanted: Outcome) -> Outcome:
    """The wanted elements, and the others that have to change with them.

    The edges of a removed node go with it, and so do the nodes and doors of a removed elevator or floor. The nodes in a
    cabin follow their elevator, and an elevator gets one on each floor that it serves newly.
    Raises InvalidElement for the removal of a node in a cabin whose elevator stays."""
    removed_floors = {key.name for key, after in wanted.items() if key.kind is ElementKind.FLOOR and after is None}
    outcome = {**_without_doors(building, removed_floors), **wanted}
    for key, after in list(outcome.items()):
        before = building.find(*key)
        if isinstance(before, Elevator):
            for node_key, node in _nodes_of(building, before):
                outcome.setdefault(node_key, _following(node, node_key.floor, before, after))
        if isinstance(after, Elevator):
            served = before.floors() if isinstance(before, Elevator) else ()
            for floor in after.floors():
                if floor in building.floors and floor not in served:
                    outcome.setdefault(*_new_node(building, outcome, floor, after))
    for key, after in list(outcome.items()):
        before = building.find(*key)
        if isinstance(before, PathNode) and after is None:
            _check_removal(key, before, building, outcome)
            for name, edge in building.floors[key.floor].topological.edges.items():
                if key.name in (edge.a, edge.b) and not _leads_elsewhere(outcome, key, name):
                    outcome[ElementKey(ElementKind.EDGE, key.floor, name)] = None
    return {key: after for key, after in outcome.items() if key.floor not in removed_floors or not key.floor}


def _without_doors(building: Building, floors: Set[str]) -> Outcome:
    """The elevators without their doors on some floors; None for those that serve no other."""
    outcome: Outcome = {}
    for name, elevator in building.elevators.items():
        doors = tuple(door for door in elevator.doors if door.floor not in floors)
        if doors != elevator.doors:
            changed = msgspec.structs.replace(elevator, doors=doors) if doors else None
            outcome[ElementKey(ElementKind.ELEVATOR, "", name)] = changed
    return outcome


def _nodes_of(building: Building, elevator: Elevator) -> Iterator[tuple[ElementKey, PathNode]]:
    for floor, entry in building.floors.items():
        for name, node in entry.topological.nodes.items():
            if node.elevator == elevator.name:
                yield ElementKey(ElementKind.NODE, floor, name), node


def _following(node: PathNode, floor: str, before: Elevator, after: Element | None) -> PathNode | None:
    """A node in a cabin after its elevator has changed: at the same place in the cabin, or None if it stops there no
    more."""
    if not isinstance(after, Elevator) or floor not in after.floors():
        return None
    x, y = turned(node.at[0] - before.at[0], node.at[1] - before.at[1], after.heading - before.heading)
    return msgspec.structs.replace(node, at=(after.at[0] + x, after.at[1] + y))


def _new_node(building: Building, outcome: Outcome, floor: str, elevator: Elevator) -> tuple[ElementKey, Element]:
    """A node in the middle of the cabin; an element that is in the outcome already if that names the elevator."""
    for key, after in outcome.items():
        if key.floor == floor and isinstance(after, PathNode) and after.elevator == elevator.name:
            return key, after
    taken = building.floors[floor].topological.nodes.keys() | {key.name for key in outcome if key.floor == floor}
    first = f"cabin-{elevator.name}"[: MAX_NAME - 4]
    name = next(name for name in (first + (f"-{n}" if n > 1 else "") for n in count(1)) if name not in taken)
    return ElementKey(ElementKind.NODE, floor, name), PathNode(name, elevator.at, elevator.name)


def _check_removal(key: ElementKey, node: PathNode, building: Building, outcome: Outcome) -> None:
    elevator = ElementKey(ElementKind.ELEVATOR, "", node.elevator)
    floor = ElementKey(ElementKind.FLOOR, "", key.floor)
    lift = outcome.get(elevator, building.find(*elevator))
    stops = isinstance(lift, Elevator) and key.floor in lift.floors()
    if node.elevator and stops and outcome.get(floor, building.floors[key.floor]) is not None:
        reason = f"elevator {node.elevator!r} stops at it; remove the elevator, or clear the node's elevator first"
        raise InvalidElement(*key.words, reason)


def _leads_elsewhere(outcome: Outcome, node: ElementKey, edge: str) -> bool:
    after = outcome.get(ElementKey(ElementKind.EDGE, node.floor, edge))
    return after is not None and node.name not in (getattr(after, "a", ""), getattr(after, "b", ""))
