"""Which floors, elevators and objects of a building are those of an earlier version, whatever their names are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby

import msgspec

from robocorba.map_editor.changes import ChangeKind, ElementKey, key_of
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.model import Element, ElementKind, Elevator

#: The kinds of elements that are followed: those that carry bodies, or are bodies.
FOLLOWED = (ElementKind.FLOOR, ElementKind.ELEVATOR, ElementKind.OBJECT)


class Lineage:
    """The origins of elements in an earlier version, by all changes since then, oldest first. Without changes every
    element is the one of its name.

    An edit that removes an element and adds one that differs in nothing but its name has renamed it, by whatever calls;
    so has one that reverts or repeats this. An element that is removed in one edit and added in another one is new."""

    def __init__(self, changes: Iterable[MapChange] = ()) -> None:
        #: Where they are not the elements of the same key; None for elements that are new.
        self._origins: dict[ElementKey, ElementKey | None] = {}
        for _, edit in groupby(changes, lambda change: change.version):
            self._add(list(edit))

    def origin(self, kind: ElementKind, floor: str, name: str) -> ElementKey | None:
        """The key that an element had; None if it is new. `floor` is empty for floors and elevators."""
        now = ElementKey(kind, floor, name)
        return self._origins.get(now, now)

    def floors(self, now: Iterable[str]) -> dict[str, str]:
        """The present names of floors by their former ones, of those that are not new."""
        found = ((self.origin(ElementKind.FLOOR, "", name), name) for name in now)
        return {origin.name: name for origin, name in found if origin}

    def _add(self, edit: list[MapChange]) -> None:
        removed, added = (dict(_elements(edit, kind)) for kind in (ChangeKind.REMOVED, ChangeKind.CREATED))
        renamed = _renamed(removed, added)
        origins = {key: before and self._origins.get(before, before) for key, before in renamed.items()}
        self._origins.update(dict.fromkeys(removed))
        self._origins.update(origins)


#: Of an edit that has renamed nothing.
SAME_NAMES = Lineage()


def _elements(edit: Iterable[MapChange], kind: ChangeKind) -> Iterator[tuple[ElementKey, Element]]:
    for change in edit:
        key = key_of(change.floor, change.element)
        if change.kind is kind and key.kind in FOLLOWED:
            yield key, change.element


def _renamed(
    removed: Mapping[ElementKey, Element], added: Mapping[ElementKey, Element]
) -> dict[ElementKey, ElementKey | None]:
    """The key that each added element had before, None if it is new."""
    found: dict[ElementKey, ElementKey | None] = {}
    floors: dict[str, str] = {}
    for kinds in ((ElementKind.FLOOR,), (ElementKind.ELEVATOR, ElementKind.OBJECT)):
        left: dict[tuple[ElementKind, str, Element], list[ElementKey]] = {}
        for key, element in removed.items():
            if key.kind in kinds:
                left.setdefault(_nameless(key, element, {}), []).append(key)
        for key, element in added.items():
            if key.kind in kinds:
                equal = left.get(_nameless(key, element, floors), [])
                same = next((before for before in equal if before.name == key.name), None)
                found[key] = before = same or next(iter(equal), None)
                if before:
                    equal.remove(before)
        floors = {key.name: before.name for key, before in found.items() if before}
    return found


def _nameless(key: ElementKey, element: Element, floors: Mapping[str, str]) -> tuple[ElementKind, str, Element]:
    """All of an element but its name, with the former names of floors."""
    element = msgspec.structs.replace(element, name="")
    if isinstance(element, Elevator):
        doors = tuple(msgspec.structs.replace(door, floor=floors.get(door.floor, door.floor)) for door in element.doors)
        element = msgspec.structs.replace(element, doors=doors)
    return key.kind, floors.get(key.floor, key.floor), element
