"""The map building agent: a building that several clients edit concurrently, also by several edits as one.

Every accepted edit is on disk before anyone can read it, raises the version by one and
reaches the listeners before the call returns. One lock orders the edits. Readers take the
current snapshot and never wait.

An edit names the version of the element that its author read. If the element has changed
since, the edit raises StaleEdit. Edits of different elements never conflict.

`undo` and `redo` concern the edits of everybody. An author's own are undone in a session (EditSession).
"""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, MutableSequence, Sequence
from itertools import islice

import msgspec

from robocorba.errors.maps import (
    EditedByOthers,
    InvalidElement,
    MapError,
    NothingToRedo,
    NothingToUndo,
    StaleVersion,
    TransactionClosed,
    UnknownElement,
)
from robocorba.map_editor.author_history import AuthorHistory, OwnEdit, foreign_changes, repeating
from robocorba.map_editor.changes import (
    Change,
    EditorState,
    ElementKey,
    Versions,
    apply,
    difference,
    inverse,
    key,
    key_of,
    ordered,
)
from robocorba.map_editor.draft import Draft
from robocorba.map_editor.edits import EditRecord, Finding, placed, renamed, shortened, summary_of
from robocorba.map_editor.element_rules import size_of
from robocorba.map_editor.idle import Opened, OpenedByClients
from robocorba.map_editor.model import COLLECTION_OF, Building, Element, ElementKind, TopologicalMap, with_topology
from robocorba.map_editor.pages import EVERYTHING, MAX_PAGE, ChangePage, ChangePosition, ElementPage, Selection
from robocorba.map_editor.renaming import rename_changes
from robocorba.map_editor.store import DEFAULT_LIMITS, CommitState, MapLimits, MapStore
from robocorba.map_editor.underlays import Underlay, check_underlay
from robocorba.map_editor.validation import change_problems, check_change, problems

_log = logging.getLogger(__name__)

#: Makes an edit in a draft on top of a state.
Operation = Callable[[Draft, EditorState], None]
#: Called within each edit with the new building, its version and the changes, in order of versions.
Listener = Callable[[Building, int, Sequence[Change]], None]


class BuildingEditor:
    """Edits the building of a store. Safe from any thread.

    `clock` returns the time [s] for the timeouts of transactions, `wall_clock` the seconds since 1970 for
    the records of edits. `by`: the author of an edit, if it is made in a session. If the store fails, the edit raises
    MapFileError and changes nothing."""

    def __init__(
        self,
        store: MapStore,
        limits: MapLimits = DEFAULT_LIMITS,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._store, self._limits, self._clock, self._wall_clock = store, limits, clock, wall_clock
        self._lock = threading.Lock()
        self._listeners: list[Listener] = []
        self._transactions = OpenedByClients[Transaction](clock, limits.transaction_timeout_s, limits.forgotten_s)
        self._state = store.load()

    @property
    def building(self) -> Building:
        """The current building. It is immutable; the next edit replaces it."""
        return self._state.building

    @property
    def version(self) -> int:
        """The building's version. Each accepted edit raises it by one; it never falls."""
        return self._state.version

    @property
    def snapshot(self) -> tuple[Building, int]:
        """The building and its version, consistent with each other."""
        state = self._state
        return state.building, state.version

    def read(self, kind: ElementKind, floor: str, name: str) -> tuple[Element, int]:
        """An element and the version that last changed it. Raises UnknownElement."""
        state, wanted = self._state, key(kind, floor, name)
        element = state.building.find(*wanted)
        if element is None:
            raise UnknownElement(*wanted.words)
        return element, state.version_of(wanted)

    def elements(self, kind: ElementKind, floor: str = "") -> list[tuple[Element, int]]:
        """All elements of a kind on a floor with their versions; `floor` is ignored for floors and elevators.

        Raises UnknownElement for an unknown floor."""
        state = self._state
        if kind in COLLECTION_OF and floor not in state.building.floors:
            raise UnknownElement(ElementKind.FLOOR.value, "", floor)
        versions = state.versions.get((kind, floor if kind in COLLECTION_OF else ""), {})
        return [(element, versions[name]) for name, element in state.building.elements(kind, floor).items()]

    def count(self, kind: ElementKind, floor: str = "") -> int:
        """The number of elements of a kind on a floor, 0 for an unknown floor."""
        return len(self._state.versions.get((kind, floor if kind in COLLECTION_OF else ""), ()))

    def create(self, floor: str, element: Element, by: AuthorHistory | None = None) -> int:
        """Add an element. `floor` is ignored for floors and elevators. Returns the new version.

        Raises DuplicateElement, UnknownElement for the floor, InvalidElement."""
        return self._edit(lambda draft, state: draft.create(state, floor, element), by)

    def change(self, floor: str, element: Element, expected: int, by: AuthorHistory | None = None) -> int:
        """Replace the element of that kind, floor and name. Returns the new version.

        Raises UnknownElement, StaleEdit, InvalidElement."""
        return self._edit(lambda draft, state: draft.change(state, floor, element, expected), by)

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int, by: AuthorHistory | None = None) -> int:
        """Remove an element, a floor with all its elements. Returns the new version.

        Raises UnknownElement, StaleEdit, InvalidElement if a remaining element refers to it."""
        return self._edit(lambda draft, state: draft.remove(state, kind, floor, name, expected), by)

    def rename(
        self, kind: ElementKind, floor: str, name: str, new_name: str, expected: int, by: AuthorHistory | None = None
    ) -> int:
        """Rename an element, also where others refer to it: nodes in edges, elevators in nodes, floors in elevators.

        Returns the new version, the current one if it has that name. Raises UnknownElement, DuplicateElement,
        StaleEdit, InvalidElement."""
        with self._lock:
            wanted = key(kind, floor, name)
            changes = rename_changes(self._state, wanted, new_name, expected)
            if not changes:
                return self.version
            summary = renamed(kind, wanted.floor, name, new_name)
            version = self._commit(changes, self.building.name, summary, by)
            if by:
                by.add(OwnEdit(version, summary, is_rename=True))
            return version

    def undo_own(self, author: AuthorHistory) -> int:
        """Revert the last edit of an author. Returns the new version.

        Raises NothingToUndo, InvalidElement, EditedByOthers; after the latter the edit can't be undone any more."""
        with self._lock:
            nothing = NothingToUndo("there is nothing to undo")
            return self._take_last(author, author.done, author.undone, inverse, nothing)

    def redo_own(self, author: AuthorHistory) -> int:
        """Repeat the edit that an author undid last. Returns the new version.

        Raises NothingToRedo, InvalidElement, EditedByOthers; after the latter the edit can't be repeated any more."""
        with self._lock:
            nothing = NothingToRedo("there is nothing to redo")
            return self._take_last(author, author.undone, author.done, repeating, nothing)

    def last_summary(self, edits: Sequence[OwnEdit]) -> str:
        """The summary of the last of an author's edits; empty if there is none."""
        with self._lock:
            return edits[-1].summary if edits else ""

    def keep_stored(self) -> None:
        """Write the building's file again if somebody has removed it. Raises MapFileError."""
        with self._lock:
            self._store.keep()

    def end_idle(self) -> int:
        """Roll back the transactions that have timed out. Returns the size of what was pending."""
        with self._lock:
            size = sum(each.draft.size for each in self._transactions.timed_out())
            self._transactions.end_idle()
            return size

    def begin(self, by: AuthorHistory | None = None) -> Transaction:
        """Open a transaction, in place of one that its client has forgotten if there are too many.

        Raises TooManyTransactions."""
        with self._lock:
            self._transactions.end_idle()
            by_client: defaultdict[AuthorHistory | None, list[Transaction]] = defaultdict(list)
            for each in self._transactions.all:
                by_client[each.by].append(each)
            if len(by_client[by]) >= self._limits.client_transactions:
                self._transactions.make_place(by_client[by], self._limits.client_transactions)
            elif len(self._transactions.all) >= self._limits.transactions:
                self._transactions.make_place(max(by_client.values(), key=len), self._limits.transactions)
            transaction = Transaction(self, by)
            self._transactions.add(transaction)
            return transaction

    def add_edit(self, transaction: Transaction, operation: Operation, added: Element | None) -> None:
        """Edit in a transaction. Raises TransactionClosed, InvalidElement if `added` is too large beside all others."""
        with self._lock:
            self._use(transaction)
            if added and not self._make_room(transaction, size_of(added)):
                reason = f"open transactions would hold more than {self._limits.pending_size} elements and points"
                raise InvalidElement(*key_of("", added).words, reason)
            operation(transaction.draft, self._state)

    def problems_of(self, transaction: Transaction) -> list[Finding]:
        """What Transaction.problems returns."""
        with self._lock:
            self._use(transaction)
            state, draft, limit = self._state, transaction.draft, 1000
            found: list[MapError] = list(islice(draft.conflicts(state), limit))
            changes = [] if found else draft.changes(state, state.version + 1)
        after = apply(state.building, changes)
        found += change_problems(after, [change.key for change in changes], state.building, limit)
        return [placed(problem, after, state.building) for problem in found]

    def end(self, transaction: Transaction, commit: bool) -> int:
        """Close a transaction, and make its edits if `commit`. Returns the building's version."""
        with self._lock:
            self._use(transaction)
            draft = transaction.draft
            self._transactions.close(transaction)
            return self._finish(draft, transaction.by) if commit else self.version

    def undo(self, expected: int) -> int:
        """Revert the last edit, transaction or replacement. `expected` is the building's version that the caller
        read. Returns the new version. Raises StaleVersion, NothingToUndo."""
        with self._lock:
            self._expect(expected)
            commit = self._store.undoable()
            if commit is None:
                raise NothingToUndo("there is nothing to undo")
            changes = inverse(commit.changes, self.version + 1)
            summary, turned = f"undone: {summary_of(commit.changes)}", (commit.version, CommitState.UNDONE)
            return self._commit(changes, commit.name_before, summary, turned=turned)

    def redo(self, expected: int) -> int:
        """Repeat the edit that undo reverted last, unless another edit followed. Returns the new version.

        Raises StaleVersion, NothingToRedo."""
        with self._lock:
            self._expect(expected)
            commit = self._store.redoable()
            if commit is None:
                raise NothingToRedo("there is nothing to redo")
            changes = repeating(commit.changes, self.version + 1)
            summary, turned = f"redone: {summary_of(commit.changes)}", (commit.version, CommitState.DONE)
            return self._commit(changes, commit.name_after, summary, turned=turned)

    def changes_since(self, version: int) -> list[Change]:
        """The changes after `version`, in order. Raises VersionUnavailable, MapFileError."""
        return self._store.changes_since(version, self._state.version)

    def count_changes(self, since: int) -> int:
        """The number of changes after version `since`. Raises VersionUnavailable, MapFileError."""
        return self._store.count_changes(since, self._state.version)

    def oldest_within(self, changes: int) -> int:
        """The oldest version after which there are at most so many changes."""
        return self._store.oldest_within(changes, self._state.version)

    def change_page(self, start: ChangePosition, part: Selection = EVERYTHING, limit: int = MAX_PAGE) -> ChangePage:
        """At most `limit` changes of a part of the building from a position on. Raises VersionUnavailable,
        MapFileError."""
        return self._store.change_page(start, part, limit, self._state.version)

    def element_page(self, start: int, part: Selection = EVERYTHING, limit: int = MAX_PAGE) -> ElementPage:
        """At most `limit` elements of a part of the building from a position on, 0 for the first. Raises MapFileError.

        The pages of a building that is edited meanwhile need the changes since `read_at` of the first one."""
        return self._store.element_page(start, part, limit, self._state.version)

    def edits_since(self, version: int) -> list[EditRecord]:
        """The edits after `version`, oldest first. Raises VersionUnavailable, MapFileError."""
        return self._store.edits_since(version, self._state.version)

    def underlay(self, floor: str) -> Underlay | None:
        """The picture below a floor. Raises UnknownElement, MapFileError."""
        self._check_floor(floor)
        return self._store.underlay(floor)

    def set_underlay(self, floor: str, underlay: Underlay | None) -> None:
        """Set or remove the picture below a floor, durably; no edit. It follows the floor's renaming and removal.

        Raises UnknownElement, InvalidElement, MapFileError."""
        self._check_floor(floor)
        if underlay is not None:
            check_underlay(floor, underlay)
        with self._lock:
            self._check_floor(floor)
            self._store.set_underlay(floor, underlay)

    def replace(self, building: Building, expected: int) -> int:
        """Replace the building by another one, as one edit of the elements that differ.

        Returns the new version, the current one if nothing differs. Raises StaleVersion, InvalidElement."""
        self._expect(expected)
        elements = difference(self.building, building)
        size = sum(map(size_of, elements.values()))
        if size > self._limits.replacement_size:
            reason = (
                f"the file brings {size} new elements and points, one call may bring {self._limits.replacement_size}; "
                "make them by several transactions, or start the system with this building"
            )
            raise InvalidElement(*next(key for key, element in elements.items() if element).words, reason)
        for wrong in problems(building, limit=1):
            raise wrong
        with self._lock:
            self._expect(expected)  # the building that the difference is from
            return self._put(elements, building.name)

    def replace_topology(self, floor: str, topology: TopologicalMap) -> int:
        """Replace a floor's topological map, as one edit.

        Returns the new version, the current one if nothing differs. Raises UnknownElement, InvalidElement."""
        with self._lock:
            building = self.building
            if floor not in building.floors:
                raise UnknownElement(ElementKind.FLOOR.value, "", floor)
            return self._put(difference(building, with_topology(building, floor, topology)), building.name, check=True)

    def proposals(self) -> bytes:
        """The stored proposals. Raises MapFileError."""
        with self._lock:
            return self._store.proposals()

    def save_proposals(self, value: bytes) -> None:
        """Store the proposals, durably. Raises MapFileError."""
        with self._lock:
            self._store.save_proposals(value)

    def subscribe(self, listener: Listener) -> tuple[Building, int]:
        """Call `listener` for each edit after the returned building and version.

        The edit waits for the call: `listener` must be quick, and must neither raise nor edit."""
        with self._lock:
            self._listeners.append(listener)
            return self.snapshot

    def _edit(self, operation: Operation, by: AuthorHistory | None) -> int:
        with self._lock:
            draft = Draft()
            operation(draft, self._state)
            return self._finish(draft, by)

    def _finish(self, draft: Draft, by: AuthorHistory | None) -> int:
        changes = draft.changes(self._state, self.version + 1)
        if not changes:
            return self.version
        summary = summary_of(changes)
        version = self._commit(changes, self.building.name, summary, by, check=True)
        if by:
            by.add(OwnEdit(version, summary))
        return version

    def _take_last(
        self,
        author: AuthorHistory,
        edits: MutableSequence[OwnEdit],
        others: MutableSequence[OwnEdit],
        changes_of: Callable[[Sequence[Change], int], list[Change]],
        nothing: NothingToUndo | NothingToRedo,
    ) -> int:
        """Revert or repeat the last of `edits` by `changes_of` its changes, and move it to `others`. If others have
        changed its elements, it is dropped. Requires the lock."""
        commit = self._store.commit_of(edits[-1].version) if edits else None
        if commit is None:  # the journal keeps the newest: those before it are lost as well
            edits.clear()
            raise nothing
        edit, changes = edits[-1], changes_of(commit.changes, self.version + 1)
        foreign = next(foreign_changes(self.building, changes), None)
        if foreign is not None:
            edits.pop()
            raise EditedByOthers(*foreign.words, self._store.last_author(foreign, edit.version))
        if edit.is_rename:  # nothing moves, so what is blocked may stay blocked
            for wrong in problems(apply(self.building, changes), limit=1):
                raise wrong
        summary = f"{'undone' if others is author.undone else 'redone'}: {edit.summary}"
        version = self._commit(changes, self.building.name, summary, author, check=not edit.is_rename)
        others.append(edits.pop())
        return version

    def _use(self, transaction: Transaction) -> None:
        if not self._transactions.use(transaction):
            raise TransactionClosed("the transaction was committed or rolled back, or it has timed out")

    def _make_room(self, transaction: Transaction, size: int) -> bool:
        """Roll back forgotten transactions of others, the largest first, until `size` more fits; false if it never
        does. Requires the lock."""
        while size + sum(each.draft.size for each in self._transactions.all) > self._limits.pending_size:
            forgotten = [each for each in self._transactions.forgotten() if each is not transaction and each.draft.size]
            if not forgotten:
                return False
            self._transactions.close(max(forgotten, key=lambda each: each.draft.size))
        return True

    def _check_floor(self, floor: str) -> None:
        if floor not in self.building.floors:
            raise UnknownElement(ElementKind.FLOOR.value, "", floor)

    def _put(self, elements: dict[ElementKey, Element | None], name: str, check: bool = False) -> int:
        if not elements and name == self.building.name:
            return self.version
        changes = ordered(
            Change(self.version + 1, key, self.building.find(*key), element) for key, element in elements.items()
        )
        return self._commit(changes, name, summary_of(changes) or f"building renamed to {name}", check=check)

    def _expect(self, version: int) -> None:
        if version != self.version:
            raise StaleVersion(version, self.version)

    def _commit(
        self,
        changes: Sequence[Change],
        name: str,
        summary: str,
        by: AuthorHistory | None = None,
        turned: tuple[int, CommitState] | None = None,
        check: bool = False,
    ) -> int:
        """Check and store changes, then publish them to readers and listeners. Requires the lock. turned: as in
        MapStore.commit."""
        before = self._state
        building = apply(before.building, changes)
        if name != building.name:
            building = msgspec.structs.replace(building, name=name)
        size = before.size + sum(size_of(change.after) - size_of(change.before) for change in changes)
        if size > self._limits.building_size and size > before.size:
            reason = f"the building would have more than {self._limits.building_size} elements and points"
            raise InvalidElement(*changes[-1].key.words, reason)
        blocked = check_change(building, [change.key for change in changes], before.building) if check else []
        version = before.version + 1
        note = by.author if by else "", self._wall_clock(), shortened(summary)
        self._store.commit(changes, version, (before.building.name, name), turned, self._limits, note)
        self._state = EditorState(building, version, _updated_versions(before.versions, changes), size)
        if blocked:
            named, rest = "; ".join(str(collision.error()) for collision in blocked[:5]), len(blocked) - 5
            _log.warning("version %d blocks %s", version, named + (f"; and {rest} more" if rest > 0 else ""))
        for listener in self._listeners:
            listener(building, version, changes)
        self._transactions.end_idle()
        return version


class Transaction(Opened):
    """Several edits that take effect together or not at all. Nobody else sees them before `commit`.

    The version of an element does not rise within a transaction: a second change of an element
    expects the same version as the first, and 0 for an element that the transaction created.
    Each edit checks the rules of its element alone; `commit` checks those between elements.
    Every operation raises TransactionClosed if the transaction is closed or has timed out.

    is_open: whether it was neither committed nor rolled back, also not by its timeout. by: its author, if it belongs to
    a session. draft: the edits so far, guarded by the lock of the editor."""

    def __init__(self, editor: BuildingEditor, by: AuthorHistory | None) -> None:
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

    def find(self, kind: ElementKind, floor: str, name: str) -> Element | None:
        """An element as edited so far."""
        found: list[Element | None] = []
        wanted = key(kind, floor, name)
        self._editor.add_edit(self, lambda draft, state: found.append(draft.find(state, wanted)), None)
        return found[0]

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

    def end(self) -> None:
        """Close it and drop its edits."""
        super().end()
        self.draft = Draft()


def _updated_versions(versions: Versions, changes: Iterable[Change]) -> Versions:
    stamped, copied = dict(versions), set()
    for change in changes:
        group = change.key.kind, change.key.floor
        if group not in copied:
            stamped[group] = dict(versions.get(group, {}))
            copied.add(group)
        if change.after is None:
            del stamped[group][change.key.name]
        else:
            stamped[group][change.key.name] = change.version
    return stamped
