"""Pending edits of a transaction.

A draft overlays the current building, not a copy. It records the version of each element
that it touches, so that it never overwrites a concurrent edit.
"""

from __future__ import annotations

from collections.abc import Iterator

from robocorba.errors.maps import DuplicateElement, StaleEdit, UnknownElement
from robocorba.map_editor.changes import Change, EditorState, ElementKey, key, key_of, ordered
from robocorba.map_editor.element_rules import size_of
from robocorba.map_editor.model import COLLECTION_OF, Element, ElementKind
from robocorba.map_editor.validation import check_element


class Draft:
    """Edits on top of a state. The version of an element does not rise within a draft: it is the version
    at which the draft first touched the element, and 0 for an element that the draft created."""

    def __init__(self) -> None:
        self._after: dict[ElementKey, Element | None] = {}
        self._read: dict[ElementKey, int] = {}
        self._removed_floors: set[str] = set()
        self.size = 0

    def find(self, state: EditorState, wanted: ElementKey) -> Element | None:
        """An element as edited so far."""
        return self._after[wanted] if wanted in self._after else state.building.find(*wanted)

    def create(self, state: EditorState, floor: str, element: Element) -> None:
        """Add an element. Raises DuplicateElement, UnknownElement for the floor, InvalidElement."""
        new = key_of(floor, element)
        if new.kind in COLLECTION_OF and not self._exists(state, _floor_key(new.floor)):
            raise UnknownElement(*_floor_key(new.floor).words)
        if self._exists(state, new):
            raise DuplicateElement(*new.words)
        check_element(new.floor, element)
        self._put(state, new, element)

    def change(self, state: EditorState, floor: str, element: Element, expected: int) -> None:
        """Replace an element. Raises UnknownElement, StaleEdit, InvalidElement."""
        changed = key_of(floor, element)
        self._check_version(state, changed, expected)
        check_element(changed.floor, element)
        self._put(state, changed, element)

    def remove(self, state: EditorState, kind: ElementKind, floor: str, name: str, expected: int) -> None:
        """Remove an element, a floor with all its elements. Raises UnknownElement, StaleEdit."""
        removed = key(kind, floor, name)
        self._check_version(state, removed, expected)
        if kind is ElementKind.FLOOR:
            for on_it in [other for other in self._after if other.floor == name]:
                self._drop(on_it)
        self._put(state, removed, None)
        if not self._read[removed]:
            self._drop(removed)
        elif kind is ElementKind.FLOOR:
            self._removed_floors.add(name)

    def changes(self, state: EditorState, version: int) -> list[Change]:
        """The edits as changes of `state` to `version`.

        Raises StaleEdit, DuplicateElement or UnknownElement if another edit changed a touched element."""
        for conflict in self.conflicts(state):
            raise conflict
        after = dict(self._after)
        for floor in self._removed_floors & state.building.floors.keys():
            for kind in COLLECTION_OF:
                for name in state.building.elements(kind, floor):
                    after.setdefault(ElementKey(kind, floor, name), None)
        pairs = ((touched, state.building.find(*touched), element) for touched, element in after.items())
        return ordered(
            Change(version, touched, before, element)
            for touched, before, element in pairs
            if before is not None or element is not None
        )

    def conflicts(self, state: EditorState) -> Iterator[StaleEdit | DuplicateElement | UnknownElement]:
        """Touched elements that another edit has changed, created or removed, then removed floors of the others."""
        for touched, read in self._read.items():
            current = state.version_of(touched)
            if current == read or touched.floor in self._removed_floors:
                continue
            if not read:
                yield DuplicateElement(*touched.words)
            elif not current:
                yield UnknownElement(*touched.words)
            else:
                yield StaleEdit(*touched.words, read, current)
        needed = dict.fromkeys(touched.floor for touched, element in self._after.items() if element and touched.floor)
        for floor in needed:
            if not self._exists(state, _floor_key(floor)):
                yield UnknownElement(*_floor_key(floor).words)

    def _exists(self, state: EditorState, wanted: ElementKey) -> bool:
        if wanted in self._after:
            return self._after[wanted] is not None
        return wanted.floor not in self._removed_floors and state.version_of(wanted) > 0

    def _check_version(self, state: EditorState, wanted: ElementKey, expected: int) -> None:
        if not self._exists(state, wanted):
            raise UnknownElement(*wanted.words)
        current = self._read.get(wanted, state.version_of(wanted))
        if expected != current:
            raise StaleEdit(*wanted.words, expected, current)

    def _put(self, state: EditorState, touched: ElementKey, element: Element | None) -> None:
        fresh = touched.floor in self._removed_floors
        self._read.setdefault(touched, 0 if fresh else state.version_of(touched))
        self.size += size_of(element) - size_of(self._after.get(touched))
        self._after[touched] = element

    def _drop(self, touched: ElementKey) -> None:
        self.size -= size_of(self._after.pop(touched))
        del self._read[touched]


def _floor_key(floor: str) -> ElementKey:
    return ElementKey(ElementKind.FLOOR, "", floor)
