"""Renaming an element, also where others refer to it by its name."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from robocorba.errors.maps import DuplicateElement, StaleEdit, UnknownElement
from robocorba.map_editor.changes import Change, EditorState, ElementKey, ordered
from robocorba.map_editor.model import COLLECTION_OF, Building, Element, ElementKind
from robocorba.map_editor.validation import check_element


def rename_changes(state: EditorState, renamed: ElementKey, new_name: str, expected: int) -> list[Change]:
    """The changes that give an element another name; none if it has that name.

    They break no rule between elements, because nothing moves and all that refers to the element follows.
    Raises UnknownElement, StaleEdit, DuplicateElement, and InvalidElement for the name."""
    building = state.building
    element = building.find(*renamed)
    if element is None:
        raise UnknownElement(*renamed.words)
    current = state.version_of(renamed)
    if expected != current:
        raise StaleEdit(*renamed.words, expected, current)
    if new_name == renamed.name:
        return []
    after: Element = msgspec.structs.replace(element, name=new_name)
    check_element(renamed.floor, after)
    target = renamed._replace(name=new_name)
    if building.find(*target) is not None:
        raise DuplicateElement(*target.words)
    version = state.version + 1
    changes = [Change(version, renamed, element, None), Change(version, target, None, after)]
    for key, new_key, old, new in _followers(building, renamed, new_name):
        if key == new_key:
            changes.append(Change(version, key, old, new))
        else:
            changes += [Change(version, key, old, None), Change(version, new_key, None, new)]
    return ordered(changes)


def _followers(
    building: Building, renamed: ElementKey, new_name: str
) -> Iterator[tuple[ElementKey, ElementKey, Element, Element]]:
    """The elements that refer to the renamed one: their keys and values before and after."""
    kind, floor, name = renamed
    if kind is ElementKind.NODE:
        for edge in building.floors[floor].topological.edges.values():
            ends = {end: new_name for end in ("a", "b") if getattr(edge, end) == name}
            if ends:
                key = ElementKey(ElementKind.EDGE, floor, edge.name)
                yield key, key, edge, msgspec.structs.replace(edge, **ends)
    elif kind is ElementKind.ELEVATOR:
        for storey, entry in building.floors.items():
            for node in entry.topological.nodes.values():
                if node.elevator == name:
                    key = ElementKey(ElementKind.NODE, storey, node.name)
                    yield key, key, node, msgspec.structs.replace(node, elevator=new_name)
    elif kind is ElementKind.FLOOR:
        for each in COLLECTION_OF:
            for other, element in building.elements(each, name).items():
                yield ElementKey(each, name, other), ElementKey(each, new_name, other), element, element
        for elevator in building.elevators.values():
            if name in elevator.floors():
                doors = tuple(
                    msgspec.structs.replace(door, floor=new_name) if door.floor == name else door
                    for door in elevator.doors
                )
                key = ElementKey(ElementKind.ELEVATOR, "", elevator.name)
                yield key, key, elevator, msgspec.structs.replace(elevator, doors=doors)
