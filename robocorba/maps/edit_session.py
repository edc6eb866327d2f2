"""Sessions of authors: each undoes its own edits, also after others have edited other elements.

An edit can be reverted while every element that it changed still is as the edit left it. Otherwise somebody else has
changed it since, and reverting would destroy that change.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.maps.changes import Change, ElementKey, inverse
from robocorba.maps.element_rules import name_violations
from robocorba.maps.model import COLLECTION_OF, Building, Element, ElementKind

if TYPE_CHECKING:
    from robocorba.maps.map_building_agent import BuildingEditor, Transaction

#: Maximum length of an author's name [characters].
MAX_AUTHOR = 60
#: Maximum number of edits that a session can undo; the store keeps their changes.
MAX_OWN_EDITS = 1000


class OwnEdit(NamedTuple):
    """An edit of an author, made as `version`. A rename moves nothing, so its nodes may stay on obstacles."""

    version: int
    summary: str
    is_rename: bool = False


class AuthorHistory:
    """The edits that an author can undo and redo, newest last. Guarded by the lock of the editor."""

    def __init__(self, author: str) -> None:
        self.author = author
        self.done: deque[OwnEdit] = deque(maxlen=MAX_OWN_EDITS)
        self.undone: list[OwnEdit] = []

    def add(self, edit: OwnEdit) -> None:
        """A new edit; what was undone before can't be redone any more."""
        self.done.append(edit)
        self.undone.clear()


def check_author(author: str) -> None:
    """Raise InvalidElement unless `author` is a name of 1 to MAX_AUTHOR printable characters."""
    for reason in name_violations("the author's name", author):
        raise InvalidElement(ElementKind.FLOOR.value, "", "", reason)
    if len(author) > MAX_AUTHOR:
        reason = f"the author's name has {len(author)} characters, at most {MAX_AUTHOR} are allowed"
        raise InvalidElement(ElementKind.FLOOR.value, "", "", reason)


def reverting(changes: Sequence[Change], version: int) -> list[Change]:
    """The changes of `version` that revert those of an edit."""
    return inverse(changes, version)


def repeating(changes: Sequence[Change], version: int) -> list[Change]:
    """The changes of `version` that make those of an edit again."""
    return [msgspec.structs.replace(change, version=version) for change in changes]


def foreign_changes(building: Building, changes: Sequence[Change]) -> Iterator[ElementKey]:
    """The elements that are not as `changes` expect them, or that would be lost with their floor or have none."""
    touched = {change.key for change in changes}
    floors = building.floors.keys() | {change.key.name for change in changes if change.key.kind is ElementKind.FLOOR}
    for change in changes:
        kind, floor, name = change.key
        if building.find(kind, floor, name) != change.before:
            yield change.key
        elif floor and floor not in floors:
            yield ElementKey(ElementKind.FLOOR, "", floor)
        elif kind is ElementKind.FLOOR and change.after is None:
            on_it = (ElementKey(each, name, other) for each in COLLECTION_OF for other in building.elements(each, name))
            yield from (key for key in on_it if key not in touched)


class EditSession:
    """The edits of one author. Every method raises SessionEnded after `close`, or after an hour without a call.

    Edits as in BuildingEditor; they return the building's new version."""

    def __init__(self, editor: BuildingEditor, author: str, now: float) -> None:
        self._editor, self._used_at = editor, now
        self._history = AuthorHistory(author)

    @property
    def author(self) -> str:
        """The author's name."""
        return self._history.author

    @property
    def is_open(self) -> bool:
        """Whether it was neither closed nor has timed out."""
        return self in self._editor._sessions

    @property
    def undoable(self) -> str:
        """A summary of the edit that `undo` would revert; empty if there is none."""
        done = self._in_use().done
        return done[-1].summary if done else ""

    @property
    def redoable(self) -> str:
        """A summary of the edit that `redo` would repeat; empty if there is none."""
        undone = self._in_use().undone
        return undone[-1].summary if undone else ""

    def create(self, floor: str, element: Element) -> int:
        """As BuildingEditor.create."""
        return self._editor.create(floor, element, self._in_use())

    def change(self, floor: str, element: Element, expected: int) -> int:
        """As BuildingEditor.change."""
        return self._editor.change(floor, element, expected, self._in_use())

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> int:
        """As BuildingEditor.remove."""
        return self._editor.remove(kind, floor, name, expected, self._in_use())

    def rename(self, kind: ElementKind, floor: str, name: str, new_name: str, expected: int) -> int:
        """As BuildingEditor.rename."""
        return self._editor.rename(kind, floor, name, new_name, expected, self._in_use())

    def begin(self) -> Transaction:
        """As BuildingEditor.begin; its commit is one edit of this author."""
        return self._editor.begin(self._in_use())

    def undo(self) -> int:
        """Revert this author's last edit.

        Raises NothingToUndo, InvalidElement if the result would break a rule, and EditedByOthers if somebody else has
        changed an element of the edit since. The next undo then takes the author's edit before it."""
        return self._editor.undo_own(self._in_use())

    def redo(self) -> int:
        """Repeat the edit that this author undid last. Raises NothingToRedo, InvalidElement, EditedByOthers."""
        return self._editor.redo_own(self._in_use())

    def close(self) -> None:
        """End the session. Its edits stay."""
        self._editor.close_session(self)

    def _in_use(self) -> AuthorHistory:
        self._editor.use_session(self)
        return self._history
