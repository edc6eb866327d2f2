"""Transactions of the map building agent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robocorba.maps.draft import Draft
from robocorba.maps.edit_session import AuthorHistory
from robocorba.maps.edits import Finding
from robocorba.maps.model import Element, ElementKind

if TYPE_CHECKING:
    from robocorba.maps.map_building_agent import BuildingEditor


class Transaction:
    """Several edits that take effect together or not at all. Nobody else sees them before `commit`.

    The version of an element does not rise within a transaction: a second change of an element
    expects the same version as the first, and 0 for an element that the transaction created.
    Each edit checks the rules of its element alone; `commit` checks those between elements.
    Every operation raises TransactionClosed if the transaction is closed or has timed out."""

    def __init__(self, editor: BuildingEditor, now: float, by: AuthorHistory | None = None) -> None:
        self._editor, self._used_at, self._by = editor, now, by
        self._draft = Draft()

    @property
    def is_open(self) -> bool:
        """Whether it was neither committed nor rolled back, also not by its timeout."""
        return self in self._editor._open

    def create(self, floor: str, element: Element) -> None:
        """As BuildingEditor.create."""
        self._editor._add_edit(self, lambda draft, state: draft.create(state, floor, element), element)

    def change(self, floor: str, element: Element, expected: int) -> None:
        """As BuildingEditor.change."""
        self._editor._add_edit(self, lambda draft, state: draft.change(state, floor, element, expected), element)

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> None:
        """As BuildingEditor.remove."""
        self._editor._add_edit(self, lambda draft, state: draft.remove(state, kind, floor, name, expected), None)

    def problems(self) -> list[Finding]:
        """Every rule that `commit` would break now, and every edit of others that it would overwrite, with places.

        Changes nothing. Conflicts are listed alone: the rules depend on their solution."""
        return self._editor._problems(self)

    def commit(self) -> int:
        """Make all edits as one, and close the transaction. Returns the building's version, new if anything was edited.

        Raises StaleEdit, DuplicateElement or UnknownElement if another client changed a touched element,
        InvalidElement if the result breaks a rule. The building is unchanged then."""
        return self._editor._close(self, commit=True)

    def roll_back(self) -> None:
        """Discard all edits."""
        self._editor._close(self, commit=False)
