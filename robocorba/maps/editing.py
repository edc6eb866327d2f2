"""The map building agent: a building that several editors change at the same time.

Every accepted edit is on disk before anybody sees it, raises the version by one and is
told to the listeners before the call returns. One lock orders the edits; who reads takes
the snapshot that is there and never waits.

An edit names the version that last changed the element, as its editor read it: when the
element has changed since, StaleEdit is raised. Edits of different elements never conflict.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence

import msgspec

from robocorba.errors.maps import (
    InvalidElement,
    NothingToRedo,
    NothingToUndo,
    StaleVersion,
    TooManyTransactions,
    TransactionClosed,
    UnknownElement,
)
from robocorba.maps.changes import Change, Key, apply, difference, elements_of, inverse, key, key_of, ordered
from robocorba.maps.collisions import Collision
from robocorba.maps.draft import Draft, State, Versions
from robocorba.maps.element_rules import size_of
from robocorba.maps.model import PLACE, Building, Element, ElementKind, TopologicalMap
from robocorba.maps.storage import MapStore, Step, Stored
from robocorba.maps.validation import check_change, problems

#: Most elements, points of polygons and the like in a building (see size_of): keeps memory bounded.
MAX_BUILDING_SIZE = 2_000_000
#: The same for all open transactions together.
MAX_PENDING_SIZE = 500_000
#: Blocked nodes and edges that the log names for one edit; the rest is counted.
BLOCKED_NAMED = 5

_log = logging.getLogger(__name__)

#: Called inside each edit with the new building, its version and what changed, in the order of versions.
Listener = Callable[[Building, int, Sequence[Change]], None]


class BuildingEditor:
    """Edits the building of a store. Safe from any thread.

    `history_limit` commits are kept for undo and changes_since. At most `transaction_limit`
    transactions are open; one left alone for `transaction_timeout_s` by `clock` is rolled back.
    Where the store fails, the edit raises MapFileError and nothing has changed."""

    def __init__(
        self,
        store: MapStore,
        history_limit: int = 10_000,
        clock: Callable[[], float] = time.monotonic,
        transaction_limit: int = 64,
        transaction_timeout_s: float = 300.0,
    ) -> None:
        self._store, self._history_limit, self._clock = store, history_limit, clock
        self._transaction_limit, self._transaction_timeout_s = transaction_limit, transaction_timeout_s
        self._lock = threading.Lock()
        self._listeners: list[Listener] = []
        self._open: set[Transaction] = set()
        self._state = _state(store.load())

    @property
    def building(self) -> Building:
        """The building as it stands; it never changes, the next edit makes another one."""
        return self._state.building

    @property
    def version(self) -> int:
        """The building's version; rises by one with each accepted edit, never falls."""
        return self._state.version

    @property
    def snapshot(self) -> tuple[Building, int]:
        """The building and its version, of the same moment."""
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
        if kind in PLACE and floor not in state.building.floors:
            raise UnknownElement(ElementKind.FLOOR.value, "", floor)
        versions = state.versions.get((kind, floor if kind in PLACE else ""), {})
        return [(element, versions[name]) for name, element in state.building.elements(kind, floor).items()]

    def create(self, floor: str, element: Element) -> int:
        """Add an element, `floor` being ignored for floors and elevators. Returns the new version.

        Raises DuplicateElement, UnknownElement for the floor, InvalidElement."""
        return self._edit(lambda draft, state: draft.create(state, floor, element))

    def change(self, floor: str, element: Element, expected: int) -> int:
        """Replace the element of that kind, floor and name. Returns the new version.

        Raises UnknownElement, StaleEdit, InvalidElement."""
        return self._edit(lambda draft, state: draft.change(state, floor, element, expected))

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> int:
        """Remove an element, a floor with all that is on it. Returns the new version.

        Raises UnknownElement, StaleEdit, InvalidElement where something left needs it."""
        return self._edit(lambda draft, state: draft.remove(state, kind, floor, name, expected))

    def begin(self) -> Transaction:
        """Open a transaction. Raises TooManyTransactions."""
        with self._lock:
            self._expire()
            if len(self._open) >= self._transaction_limit:
                raise TooManyTransactions(self._transaction_limit)
            transaction = Transaction(self, self._clock())
            self._open.add(transaction)
            return transaction

    def undo(self, expected: int) -> int:
        """Take back the last edit, transaction or replacement; `expected` is the building's version as the caller
        saw it. Returns the new version. Raises StaleVersion, NothingToUndo."""
        with self._lock:
            self._expect(expected)
            commit = self._store.undoable()
            if commit is None:
                raise NothingToUndo("there is nothing to undo")
            changes = inverse(commit.changes, self.version + 1)
            return self._commit(changes, commit.name_before, Step.UNDO, commit.version)

    def redo(self, expected: int) -> int:
        """Repeat the edit that was taken back last, while no other was made since. Returns the new version.

        Raises StaleVersion, NothingToRedo."""
        with self._lock:
            self._expect(expected)
            commit = self._store.redoable()
            if commit is None:
                raise NothingToRedo("there is nothing to redo")
            changes = [msgspec.structs.replace(change, version=self.version + 1) for change in commit.changes]
            return self._commit(changes, commit.name_after, Step.REDO, commit.version)

    def changes_since(self, version: int) -> list[Change]:
        """What happened after `version`, in order. Raises VersionUnavailable, MapFileError."""
        state = self._state
        if version == state.version:
            return []
        return self._store.changes_since(version, state.version)

    def replace(self, building: Building, expected: int) -> int:
        """Put another building in place of this one, as one edit; what is equal in both stays untouched.

        Returns the new version, the old one where nothing differs. Raises StaleVersion, InvalidElement."""
        for wrong in problems(building, limit=1):
            raise wrong
        with self._lock:
            self._expect(expected)
            return self._put(difference(self.building, building), building.name)

    def replace_topology(self, floor: str, topology: TopologicalMap) -> int:
        """Put another topological map in place of a floor's, as one edit.

        Returns the new version, the old one where nothing differs. Raises UnknownElement, InvalidElement."""
        with self._lock:
            building = self.building
            if floor not in building.floors:
                raise UnknownElement(ElementKind.FLOOR.value, "", floor)
            entry = msgspec.structs.replace(building.floors[floor], topological=topology)
            drawn = msgspec.structs.replace(building, floors={**building.floors, floor: entry})
            return self._put(difference(building, drawn), building.name, check=True)

    def subscribe(self, listener: Listener) -> tuple[Building, int]:
        """Have `listener` called for each edit after the returned building and version.

        It is called inside the edit, which waits for it: it must be quick, not raise and not edit."""
        with self._lock:
            self._listeners.append(listener)
            return self.snapshot

    def _edit(self, step: Callable[[Draft, State], None]) -> int:
        with self._lock:
            draft = Draft()
            step(draft, self._state)
            return self._finish(draft)

    def _finish(self, draft: Draft) -> int:
        changes = draft.changes(self._state, self.version + 1)
        return self._commit(changes, self.building.name, check=True) if changes else self.version

    def _put(self, elements: dict[Key, Element | None], name: str, check: bool = False) -> int:
        if not elements and name == self.building.name:
            return self.version
        changes = ordered(
            Change(self.version + 1, key, self.building.find(*key), element) for key, element in elements.items()
        )
        return self._commit(changes, name, check=check)

    def _expect(self, version: int) -> None:
        if version != self.version:
            raise StaleVersion(version, self.version)

    def _commit(
        self, changes: Sequence[Change], name: str, step: Step = Step.EDIT, source: int = 0, check: bool = False
    ) -> int:
        """Check, store, show and tell, in this order. With the lock held."""
        before = self._state
        building = apply(before.building, changes)
        if name != building.name:
            building = msgspec.structs.replace(building, name=name)
        size = before.size + sum(size_of(change.after) - size_of(change.before) for change in changes)
        if size > MAX_BUILDING_SIZE and size > before.size:
            reason = f"the building would have more than {MAX_BUILDING_SIZE} elements and points"
            raise InvalidElement(*changes[-1].key.words, reason)
        blocked = check_change(building, [change.key for change in changes], before.building) if check else []
        version = before.version + 1
        names = (before.building.name, name)
        self._store.commit(changes, version, names, step, source, self._history_limit)
        self._state = State(building, version, _stamped(before.versions, changes), size)
        if blocked:
            _log.warning("version %d blocks %s", version, _named(blocked))
        for listener in self._listeners:
            listener(building, version, changes)
        self._expire()
        return version

    def _expire(self) -> None:
        """Roll back what was left alone. With the lock held."""
        oldest = self._clock() - self._transaction_timeout_s
        for transaction in [each for each in self._open if each._used_at < oldest]:
            self._drop(transaction)

    def _drop(self, transaction: Transaction) -> Draft:
        """Close a transaction, which lets go of its draft: a caller may keep it for long. With the lock held."""
        self._open.discard(transaction)
        draft, transaction._draft = transaction._draft, Draft()
        return draft

    def _step(self, transaction: Transaction, step: Callable[[Draft, State], None], adds: Element | None) -> None:
        with self._lock:
            self._use(transaction)
            if adds and size_of(adds) + sum(other._draft.size for other in self._open) > MAX_PENDING_SIZE:
                reason = f"open transactions would hold more than {MAX_PENDING_SIZE} elements and points"
                raise InvalidElement(*key_of("", adds).words, reason)
            step(transaction._draft, self._state)

    def _use(self, transaction: Transaction) -> None:
        self._expire()
        if transaction not in self._open:
            raise TransactionClosed("the transaction was committed or rolled back, or it has timed out")
        transaction._used_at = self._clock()

    def _close(self, transaction: Transaction, commit: bool) -> int:
        with self._lock:
            self._use(transaction)
            draft = self._drop(transaction)
            return self._finish(draft) if commit else self.version


class Transaction:
    """Several edits that take effect together or not at all. Nobody else sees them before `commit`.

    The version of an element does not rise within a transaction: a second change of the same
    element expects the same version as the first, and 0 for an element that the transaction made.
    Rules of an element by itself are checked at each step, those between elements by `commit`.
    Every operation raises TransactionClosed once it is closed or has timed out."""

    def __init__(self, editor: BuildingEditor, now: float) -> None:
        self._editor, self._used_at = editor, now
        self._draft = Draft()

    @property
    def is_open(self) -> bool:
        """Whether it was neither committed nor rolled back, nor has been found to have timed out."""
        return self in self._editor._open

    def create(self, floor: str, element: Element) -> None:
        """As BuildingEditor.create."""
        self._editor._step(self, lambda draft, state: draft.create(state, floor, element), element)

    def change(self, floor: str, element: Element, expected: int) -> None:
        """As BuildingEditor.change."""
        self._editor._step(self, lambda draft, state: draft.change(state, floor, element, expected), element)

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> None:
        """As BuildingEditor.remove."""
        self._editor._step(self, lambda draft, state: draft.remove(state, kind, floor, name, expected), None)

    def commit(self) -> int:
        """Make all edits as one. Returns the building's version, a new one unless nothing was edited.

        Raises StaleEdit, DuplicateElement or UnknownElement where somebody else touched what it touches,
        InvalidElement where the result breaks a rule; nothing has changed then. It is closed either way."""
        return self._editor._close(self, commit=True)

    def roll_back(self) -> None:
        """Forget all edits."""
        self._editor._close(self, commit=False)


def _named(blocked: Sequence[Collision]) -> str:
    named = "; ".join(str(collision.error()) for collision in blocked[:BLOCKED_NAMED])
    rest = len(blocked) - BLOCKED_NAMED
    return named + (f"; and {rest} more" if rest > 0 else "")


def _state(stored: Stored) -> State:
    versions: Versions = {}
    for (kind, floor, name), version in stored.versions.items():
        versions.setdefault((kind, floor), {})[name] = version
    size = sum(size_of(element) for _, element in elements_of(stored.building))
    return State(stored.building, stored.version, versions, size)


def _stamped(versions: Versions, changes: Iterable[Change]) -> Versions:
    stamped, copied = dict(versions), set()
    for change in changes:
        place = change.key.kind, change.key.floor
        if place not in copied:
            stamped[place] = dict(versions.get(place, {}))
            copied.add(place)
        if change.after is None:
            del stamped[place][change.key.name]
        else:
            stamped[place][change.key.name] = change.version
    return stamped
