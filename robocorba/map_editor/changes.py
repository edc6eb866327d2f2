"""The changes that an edit makes to a building: they can be applied, reverted and stored.

The changes of a commit are in an order in which they can be made one by one: elements are
removed before their floor, and a floor is created before its elements.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import NamedTuple

import msgspec

from robocorba.map_editor.model import COLLECTION_OF, KIND_OF, Building, Element, ElementKind


class ElementKey(NamedTuple):
    """Identifies an element. `floor` is empty for floors and elevators."""

    kind: ElementKind
    floor: str
    name: str

    @property
    def words(self) -> tuple[str, str, str]:
        """Kind, floor and name as strings, as in errors and files."""
        return self.kind.value, self.floor, self.name


def key_of(floor: str, element: Element) -> ElementKey:
    """The key of an element on `floor`."""
    return key(KIND_OF[type(element)], floor, element.name)


def key(kind: ElementKind, floor: str, name: str) -> ElementKey:
    """A key; `floor` is ignored for floors and elevators."""
    return ElementKey(kind, floor if kind in COLLECTION_OF else "", name)


class ChangeKind(str, Enum):
    """What a change does to an element."""

    CREATED = "created"
    CHANGED = "changed"
    REMOVED = "removed"


#: By kind and floor: the version that last changed each element, by name. Never changed in place.
Versions = dict[tuple[ElementKind, str], dict[str, int]]


class EditorState(NamedTuple):
    """A building at a version, and the version that last changed each element. Never changed in place.

    `size` is the sum of size_of over its elements."""

    building: Building
    version: int
    versions: Versions
    size: int

    def version_of(self, key: ElementKey) -> int:
        """The version that last changed an element, 0 if it does not exist."""
        return self.versions.get((key.kind, key.floor), {}).get(key.name, 0)


class Change(msgspec.Struct, frozen=True, gc=False):
    """An element before and after the change to `version`; None if it did not exist before, or was removed."""

    version: int
    key: ElementKey
    before: Element | None
    after: Element | None

    @property
    def kind(self) -> ChangeKind:
        """Created, changed or removed."""
        if self.before is None:
            return ChangeKind.CREATED
        return ChangeKind.REMOVED if self.after is None else ChangeKind.CHANGED

    @property
    def floor(self) -> str:
        """The floor of the element, empty for floors and elevators."""
        return self.key.floor

    @property
    def element(self) -> Element:
        """The element after the change, or the removed element."""
        element = self.before if self.after is None else self.after
        assert element is not None
        return element

    def _rank(self) -> int:
        of_floor = self.key.kind is ElementKind.FLOOR
        return int(of_floor) if self.after is None else 3 - int(of_floor)


def ordered(changes: Iterable[Change]) -> list[Change]:
    """The changes of a commit, of different elements, in an order in which they can be made."""
    return sorted(changes, key=Change._rank)


def inverse(changes: Iterable[Change], version: int) -> list[Change]:
    """The changes of `version` that revert a commit."""
    return ordered(Change(version, change.key, change.after, change.before) for change in changes)


def difference(before: Building, after: Building) -> dict[ElementKey, Element | None]:
    """The elements that differ between two buildings, as in `after`; None for those that `after` does not have."""
    old, new = dict(elements_of(before)), dict(elements_of(after))
    removed = {key: None for key in old if key not in new}
    return {**removed, **{key: element for key, element in new.items() if old.get(key) != element}}


def elements_of(building: Building) -> Iterator[tuple[ElementKey, Element]]:
    """Every element of a building with its key, each floor before its elements."""
    for name, elevator in building.elevators.items():
        yield ElementKey(ElementKind.ELEVATOR, "", name), elevator
    for floor, entry in building.floors.items():
        yield ElementKey(ElementKind.FLOOR, "", floor), entry.floor
        for kind in COLLECTION_OF:
            for name, element in building.elements(kind, floor).items():
                yield ElementKey(kind, floor, name), element


def apply(building: Building, changes: Iterable[Change]) -> Building:
    """The building after `ordered` changes. Raises KeyError if the floor of a change does not exist."""
    return building.with_changes((*change.key, change.after) for change in changes)
