"""Copies of a building, of any size: its elements and changes in pages, and how a copy applies them.

A reader of all pages of elements, which may be edited meanwhile, applies the changes since the version of the first
page. Each page is small, so a reader that has vanished leaves no work behind.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from robocorba.map_editor.changes import Change, ChangeKind, ElementKey
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.model import COLLECTION_OF, KIND_OF, Building, Element, ElementKind, FloorMap, by_level

#: Maximum number of elements or changes in a page: about 20 ms of work for the server and as much for the reader, so
#: that no call of others waits noticeably for one.
MAX_PAGE = 5_000
#: Maximum length of the elements in a page [characters as JSON]. CORBA messages are hardly longer, and any client
#: accepts 2 MiB by default. One element has at most 0.5 MiB.
MAX_PAGE_LENGTH = 1024 * 1024


class Selection(NamedTuple):
    """The part of the building that a copy holds. kinds: empty for all. floor: empty for all; elevators and floors
    belong to each."""

    kinds: tuple[ElementKind, ...] = ()
    floor: str = ""


EVERYTHING = Selection()


class ChangePosition(NamedTuple):
    """A place in the list of changes: after all changes up to version `since` and `taken` of the next version."""

    since: int
    taken: int = 0


class ChangePage(NamedTuple):
    """Changes, the position after them, whether they reach the current version, and how many follow (of any kind)."""

    changes: list[Change]
    next: ChangePosition
    is_last: bool
    left: int


class ElementPage(NamedTuple):
    """Elements, the position after them, and whether more follow. read_at: the building's version. elements: each
    with its floor (empty for floors and elevators) and the version that last changed it."""

    read_at: int
    elements: list[tuple[str, Element, int]]
    next: int
    is_last: bool


def building_of(name: str, elements: Iterable[tuple[str, Element]]) -> Building:
    """A building of elements with their floors, in any order. Elements on other floors are left out."""
    collections: dict[tuple[ElementKind, str], dict[str, Element]] = {}
    for floor, element in elements:
        collections.setdefault((KIND_OF[type(element)], floor), {})[element.name] = element
    floors: Mapping[str, Element] = collections.get((ElementKind.FLOOR, ""), {})
    entries = {
        floor: FloorMap.of(
            element,  # type: ignore[arg-type]
            {kind: collections.get((kind, floor), {}) for kind in COLLECTION_OF},
        )
        for floor, element in floors.items()
    }
    elevators: dict[str, Element] = collections.get((ElementKind.ELEVATOR, ""), {})
    return Building(name, by_level(entries), elevators)  # type: ignore[arg-type]


def with_changes_of(building: Building, changes: Iterable[MapChange]) -> Building:
    """A copy of a building after changes, oldest first, at a cost linear in the changes.

    Some of them may have been made before the elements were read, also on floors that have been removed since."""
    last: dict[ElementKey, Element | None] = {}
    for change in changes:
        key = ElementKey(KIND_OF[type(change.element)], change.floor, change.element.name)
        last[key] = None if change.kind is ChangeKind.REMOVED else change.element
    floors = {key.name: element for key, element in last.items() if key.kind is ElementKind.FLOOR}
    known = {name for name in building.floors if floors.get(name, True)} | {name for name in floors if floors[name]}
    made: list[tuple[ElementKind, str, str, Element | None]] = [
        (ElementKind.FLOOR, "", name, element)
        for name, element in floors.items()
        if element is not None or name in building.floors
    ]
    made += [
        (*key, element)
        for key, element in last.items()
        if key.kind is not ElementKind.FLOOR
        and (not key.floor or key.floor in known)
        and (element is not None or _has(building, key))
    ]
    return building.with_changes(made)


def size_of_copy(building: Building) -> int:
    """The number of elements in a copy."""
    return (
        len(building.floors)
        + len(building.elevators)
        + sum(len(building.elements(kind, floor)) for floor in building.floors for kind in COLLECTION_OF)
    )


def _has(building: Building, key: ElementKey) -> bool:
    if key.kind is ElementKind.ELEVATOR:
        return key.name in building.elevators
    return key.name in building.elements(key.kind, key.floor)
