"""Transactions of the map building agent: several edits that take effect together or not at all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Protocol

from robocorba.errors.maps import TransactionClosed
from robocorba.map_editor.author_history import AuthorHistory
from robocorba.map_editor.draft import Draft, EditorState
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.idle import Opened, idle_since, longest_idle
from robocorba.map_editor.model import Element, ElementKind
from robocorba.map_editor.store import MapLimits

#: Makes an edit in a draft on top of a state.
Operation = Callable[[Draft, EditorState], None]


class TransactionalEditor(Protocol):
    """What a transaction needs of its editor, the BuildingEditor."""

    def add_edit(self, transaction: Transaction, operation: Operation, added: Element | None) -> None:
        """Edit in a transaction. Raises TransactionClosed, InvalidElement if `added` is too large beside all others."""

    def problems_of(self, transaction: Transaction) -> list[Finding]:
        """The result of Transaction.problems."""

    def end(self, transaction: Transaction, commit: bool) -> int:
        """Close a transaction, and make its edits if `commit`. Returns the building's version."""


class Transaction(Opened):
    """Several edits that take effect together or not at all. Nobody else sees them before `commit`.

    The version of an element does not rise within a transaction: a second change of an element
    expects the same version as the first, and 0 for an element that the transaction created.
    Each edit checks the rules of its element alone; `commit` checks those between elements.
    Every operation raises TransactionClosed if the transaction is closed or has timed out.

    is_open: whether it was neither committed nor rolled back, also not by its timeout. by: its author, if it belongs to
    a session. draft: the edits so far, guarded by the lock of the editor."""

    def __init__(self, editor: TransactionalEditor, now: float, by: AuthorHistory | None = None) -> None:
        super().__init__(now)
        self._editor, self.by = editor, by
        self.draft = Draft()

    def create(self, floor: str, element: Element) -> None:
        """As BuildingEditor.create."""
        self._editor.add_edit(self, lambda draft, state: draft.create(state, floor, element), element)

    def change(self, floor: str, element: Element, expected: int) -> None:
        """As BuildingEditor.change."""
        self._editor.add_edit(self, lambda draft, state: draft.change(state, floor, element, expected), element)

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> None:
        """As BuildingEditor.remove."""
        self._editor.add_edit(self, lambda draft, state: draft.remove(state, kind, floor, name, expected), None)

    def problems(self) -> list[Finding]:
        """Every rule that `commit` would break now, and every edit of others that it would overwrite, with places.

        Changes nothing. Conflicts are listed alone: the rules depend on their solution."""
        return self._editor.problems_of(self)

    def commit(self) -> int:
        """Make all edits as one, and close the transaction. Returns the building's version, new if anything was edited.

        Raises StaleEdit, DuplicateElement or UnknownElement if another client changed a touched element,
        InvalidElement if the result breaks a rule. The building is unchanged then."""
        return self._editor.end(self, commit=True)

    def roll_back(self) -> None:
        """Discard all edits."""
        self._editor.end(self, commit=False)


class OpenTransactions:
    """The open transactions of an editor, whose lock is held in each call.

    If there are too many, or their edits are too large together, those that their clients have forgotten are rolled
    back. `clock` returns the time [s]."""

    def __init__(self, limits: MapLimits, clock: Callable[[], float]) -> None:
        self._limits, self._clock = limits, clock
        self._open: set[Transaction] = set()

    def begin(self, editor: TransactionalEditor, by: AuthorHistory | None) -> Transaction:
        """Open a transaction. Raises TooManyTransactions."""
        limits, forgotten = self._limits, self._clock() - self._limits.forgotten_s
        by_client: defaultdict[AuthorHistory | None, list[Transaction]] = defaultdict(list)
        for each in self._open:
            by_client[each.by].append(each)
        if len(by_client[by]) >= limits.client_transactions:
            self.close(longest_idle(by_client[by], limits.client_transactions, forgotten))
        elif len(self._open) >= limits.transactions:
            most = max(by_client.values(), key=len)
            self.close(longest_idle(most, limits.transactions, forgotten))
        transaction = Transaction(editor, self._clock(), by)
        self._open.add(transaction)
        return transaction

    def use(self, transaction: Transaction) -> None:
        """A transaction is called: its timeout starts again. Raises TransactionClosed."""
        if not transaction.is_open:
            raise TransactionClosed("the transaction was committed or rolled back, or it has timed out")
        transaction.used_at = self._clock()

    def close(self, transaction: Transaction) -> Draft:
        """Close a transaction and take its draft, since a caller may keep the closed transaction."""
        self._open.discard(transaction)
        transaction.is_open = False
        draft, transaction.draft = transaction.draft, Draft()
        return draft

    def make_room(self, transaction: Transaction, size: int) -> bool:
        """Roll back forgotten transactions of others, the largest first, until `size` more fits; false if it never
        does."""
        while size + sum(each.draft.size for each in self._open) > self._limits.pending_size:
            idle = idle_since(self._open, self._clock() - self._limits.forgotten_s)
            forgotten = [each for each in idle if each is not transaction and each.draft.size]
            if not forgotten:
                return False
            self.close(max(forgotten, key=lambda each: each.draft.size))
        return True

    def end_idle(self) -> int:
        """Roll back those that have timed out. Returns the size of their edits."""
        oldest = self._clock() - self._limits.transaction_timeout_s
        return sum(self.close(each).size for each in idle_since(self._open, oldest))
