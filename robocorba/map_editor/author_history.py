"""The edits of authors: each undoes its own, also after others have edited other elements.

An edit can be reverted while every element that it changed still is as the edit left it. Otherwise somebody else has
changed it since, and reverting would destroy that change.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor.changes import Change, ElementKey
from robocorba.map_editor.element_rules import name_violations
from robocorba.map_editor.model import COLLECTION_OF, Building, ElementKind


class OwnEdit(NamedTuple):
    """An edit of an author, made as `version`. A rename moves nothing, so its nodes may stay on obstacles."""

    version: int
    summary: str
    is_rename: bool = False


class AuthorHistory:
    """The edits that an author can undo and redo, newest last. Guarded by the lock of the editor."""

    def __init__(self, author: str) -> None:
        self.author = author
        self.done: deque[OwnEdit] = deque(maxlen=1000)  # the store keeps their changes
        self.undone: list[OwnEdit] = []

    def add(self, edit: OwnEdit) -> None:
        """A new edit; what was undone before can't be redone any more."""
        self.done.append(edit)
        self.undone.clear()


def check_author(author: str) -> None:
    """Raise InvalidElement unless `author` is a name of 1 to 60 printable characters."""
    for reason in author_violations("the author's name", author):
        raise InvalidElement(ElementKind.FLOOR.value, "", "", reason)


def author_violations(what: str, name: str) -> Iterator[str]:
    """Why `name` is not that of a person or robot, 1 to 60 printable characters. `what` names it in messages."""
    yield from name_violations(what, name)
    if len(name) > 60:
        yield f"{what} has {len(name)} characters, at most 60 are allowed"


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
