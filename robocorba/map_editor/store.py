"""A building on disk: one SQLite file, one durable transaction for each accepted edit.

The file stores every element with the version that last changed it, and a journal of
commits that serves undo, redo and the list of changes, also after a crash. The row order
is the order of the building's dictionaries.

Every failure of the file, a full disk included, raises MapFileError.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from robocorba.errors.maps import MapFileError, VersionUnavailable
from robocorba.map_editor import underlay_table
from robocorba.map_editor.changes import Change, EditorState, ElementKey, Versions, elements_of
from robocorba.map_editor.edits import EditRecord
from robocorba.map_editor.element_rules import size_of
from robocorba.map_editor.model import TYPE_OF, Area, Building, Element, ElementKind
from robocorba.map_editor.pages import MAX_PAGE_LENGTH, ChangePage, ChangePosition, ElementPage, Selection, building_of
from robocorba.map_editor.underlays import Underlay
from robocorba.system import sqlite_files
from robocorba.system.damaged_files import restore_advice
from robocorba.system.decoding import decode_json

#: SQLite application id, "RoCo": identifies RoboCorba's map stores.
APPLICATION_ID = 0x526F436F
#: Version of the building in a new store.
FIRST_VERSION = 1

_SCHEMA = (
    "CREATE TABLE building (name TEXT NOT NULL, version INTEGER NOT NULL)",
    """CREATE TABLE elements (
        id INTEGER PRIMARY KEY, kind TEXT NOT NULL, floor TEXT NOT NULL, name TEXT NOT NULL,
        version INTEGER NOT NULL, value TEXT NOT NULL, UNIQUE (kind, floor, name))""",
    """CREATE TABLE commits (
        version INTEGER PRIMARY KEY, state INTEGER NOT NULL, size INTEGER NOT NULL,
        name_before TEXT NOT NULL, name_after TEXT NOT NULL)""",
    "CREATE INDEX commits_by_state ON commits (state, version)",
    """CREATE TABLE changes (
        version INTEGER NOT NULL, position INTEGER NOT NULL,
        kind TEXT NOT NULL, floor TEXT NOT NULL, name TEXT NOT NULL, before TEXT, after TEXT,
        PRIMARY KEY (version, position)) WITHOUT ROWID""",
    f"PRAGMA application_id = {APPLICATION_ID}",
    "PRAGMA user_version = 1",
)
#: Tables that stores of earlier releases lack. These releases ignore them, so they need no other schema version.
_ADDED_TABLES = (
    """CREATE TABLE IF NOT EXISTS edits (
        version INTEGER PRIMARY KEY, author TEXT NOT NULL, time REAL NOT NULL, summary TEXT NOT NULL)""",
    underlay_table.TABLE,
    "CREATE TABLE IF NOT EXISTS proposals (value BLOB NOT NULL)",
)
_ELEMENT_COLUMNS = "kind, floor, name, version, value"
_CHANGE_COLUMNS = "version, kind, floor, name, before, after"


@dataclass(frozen=True)
class MapLimits:
    """Limits of an edited map.

    commits: kept for undo and for the list of changes. journal_changes: changed elements in them, over all commits.
    building_size, pending_size: of the building, and of all open transactions together (see size_of); they bound
    memory. replacement_size: of what one replacement of the building may bring, so that it ends while its client still
    waits. transactions, sessions: open at the same time. client_transactions: of one session, and of all clients
    without a session together. transaction_timeout_s: after which an idle one is rolled back; session_timeout_s: after
    which an idle session ends. forgotten_s, forgotten_session_s: after which an idle one ends if another client needs
    its place."""

    commits: int = 10_000
    journal_changes: int = 1_000_000
    building_size: int = 2_000_000
    pending_size: int = 500_000
    replacement_size: int = 500_000
    transactions: int = 64
    client_transactions: int = 32
    transaction_timeout_s: float = 300.0
    sessions: int = 64
    session_timeout_s: float = 3600.0
    forgotten_s: float = 10.0
    forgotten_session_s: float = 300.0


DEFAULT_LIMITS = MapLimits()


class CommitState(IntEnum):
    """State of a commit in the history: undo reverts the newest DONE one, redo repeats the oldest UNDONE one."""

    PAST = 0
    DONE = 1
    UNDONE = 2


class Commit(NamedTuple):
    """A commit of the journal, with the building's name before and after it."""

    version: int
    name_before: str
    name_after: str
    changes: list[Change]


_log = logging.getLogger(__name__)


class MapStore:
    """The file of a building. One process opens it at a time; one thread writes, any thread reads the journal.

    Raises AlreadyRunning if another process has it open, MapFileError if the file is missing, damaged
    or not a map store of this release."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with _guarded(self.path):
            if not self.path.exists():
                raise MapFileError(str(self.path), 0, "", "there is no map store")
            self._lock = sqlite_files.lock(self.path)
            try:
                self._check()
                self._reading = threading.Lock()
                self._open()
                self._journaled = self._writer.execute("SELECT total(size) FROM commits").fetchone()[0]
            except BaseException:
                os.close(self._lock)
                raise

    def _open(self) -> None:
        sqlite_files.check_room(self.path)
        self._writer = _connect(self.path, "rw")
        self._writer.execute("PRAGMA journal_mode = WAL")
        self._writer.execute("PRAGMA synchronous = FULL")
        with _transaction(self._writer):
            for statement in _ADDED_TABLES:
                self._writer.execute(statement)
        self._reader = _connect(self.path, "ro")
        #: None while the file has to be opened again.
        self._place: sqlite_files.Place | None = sqlite_files.Place(self.path)

    def _keep_place(self) -> None:
        """If somebody has removed the file, write it again: all of it is still here."""
        if self._place and self._place.is_kept:
            return
        with self._reading:
            if self._place:
                self._place.write_back(self._writer)
                self._place = None
                self._reader.close()
                _log.warning("%s was removed while it is in use; it is written again", self.path)
            self._open()  # also if there was no room for it the last time

    def keep(self) -> None:
        """Write the file again if somebody has removed it, also when nothing is to be changed."""
        with _guarded(self.path):
            self._keep_place()

    @contextmanager
    def _changing(self) -> Iterator[sqlite3.Connection]:
        """A durable transaction: found after a restart."""
        with _guarded(self.path):
            self._keep_place()
            with _transaction(self._writer) as writer:
                yield writer

    @classmethod
    def create(cls, path: str | Path, building: Building) -> MapStore:
        """Create a store with `building` at FIRST_VERSION, atomically: it gets its name once it is complete.

        Raises MapFileError if the file exists, AlreadyRunning as the constructor does."""
        file = Path(path)
        fresh = Path(f"{file}.new")
        with _guarded(file):
            lock = sqlite_files.lock(file)
            try:
                if file.exists():
                    raise MapFileError(str(file), 0, "", "there is such a file already")
                # SQLite would apply the leftover log of a deleted store to the new one.
                for leftover in (fresh, Path(f"{fresh}-journal"), Path(f"{file}-wal"), Path(f"{file}-shm")):
                    leftover.unlink(missing_ok=True)
                with closing(_connect(fresh, "rwc")) as connection:
                    connection.execute("PRAGMA synchronous = FULL")
                    with _transaction(connection):
                        _fill(connection, building)
                fresh.rename(file)
                folder = os.open(file.absolute().parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)
            finally:
                os.close(lock)
        return cls(file)

    def _check(self) -> None:
        if damage := sqlite_files.log_damage(self.path):
            raise MapFileError(str(self.path), 0, "", _damaged(self.path, damage))
        sqlite_files.check_room(self.path)
        with closing(_connect(self.path, "rw")) as connection:
            if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
                raise MapFileError(str(self.path), 0, "", "not a map store of RoboCorba")
            schema = connection.execute("PRAGMA user_version").fetchone()[0]
            if schema != 1:
                reason = f"its schema is version {schema}, this release reads 1"
                raise MapFileError(str(self.path), 0, "", reason)
            found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                raise MapFileError(str(self.path), 0, "", _damaged(self.path, found))

    def close(self) -> None:
        """Close the file. Commits are durable without it."""
        with suppress(OSError, sqlite3.Error):
            self._keep_place()
        with self._reading:
            self._reader.close()
        self._writer.close()
        os.close(self._lock)

    def __enter__(self) -> MapStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def load(self) -> EditorState:
        """The building as of the last commit."""
        with _guarded(self.path):
            row = self._writer.execute("SELECT name, version FROM building").fetchone()
            if row is None:
                raise MapFileError(str(self.path), 0, "", _damaged(self.path, "it holds no building"))
            elements: list[tuple[str, Element]] = []
            versions: Versions = {}
            query = f"SELECT {_ELEMENT_COLUMNS} FROM elements ORDER BY id"
            for kind, floor, name, version, value in self._writer.execute(query):
                versions.setdefault((ElementKind(kind), floor), {})[name] = version
                elements.append((floor, decode_json(value, TYPE_OF[ElementKind(kind)])))
        building = building_of(row[0], elements)
        lost = next((floor for floor, _ in elements if floor and floor not in building.floors), None)
        if lost is not None:
            reason = _damaged(self.path, f"it has elements on {lost!r}, which is no floor")
            raise MapFileError(str(self.path), 0, "", reason)
        return EditorState(building, row[1], versions, sum(size_of(element) for _, element in elements))

    def commit(
        self,
        changes: Sequence[Change],
        version: int,
        names: tuple[str, str],
        turned: tuple[int, CommitState] | None = None,
        limits: MapLimits = DEFAULT_LIMITS,
        note: tuple[str, float, str] = ("", 0.0, ""),
    ) -> None:
        """Make the changes of `version`, the next one, durable: all of them, or none if this raises.

        names: the building's before and after. turned: for an undo (UNDONE) or a redo (DONE), the version of the commit
        that it reverts or repeats. note: author, seconds since 1970 and summary for edits_since. Drops the oldest
        commits beyond `limits`. Underlays follow their floors."""
        with self._changing() as writer:
            current = writer.execute("SELECT version FROM building").fetchone()[0]
            assert version == current + 1, (version, current)
            writer.execute("UPDATE building SET name = ?, version = ?", (names[1], version))
            _write_elements(writer, changes)
            if turned is None:
                writer.execute("UPDATE commits SET state = ? WHERE state = ?", (CommitState.PAST, CommitState.UNDONE))
            else:
                writer.execute("UPDATE commits SET state = ? WHERE version = ?", (turned[1], turned[0]))
            dropped = self._drop_commits(version - limits.commits, limits.journal_changes - len(changes))
            underlay_table.follow(writer, changes)
            state = CommitState.PAST if turned else CommitState.DONE
            # An earlier release may have left rows of commits that it has dropped.
            writer.execute("INSERT OR REPLACE INTO edits VALUES (?, ?, ?, ?)", (version, *note))
            writer.execute("INSERT INTO commits VALUES (?, ?, ?, ?, ?)", (version, state, len(changes), *names))
            writer.executemany(
                "INSERT INTO changes VALUES (?, ?, ?, ?, ?, ?, ?)",
                (
                    (version, position, *change.key.words, _text(change.before), _text(change.after))
                    for position, change in enumerate(changes)
                ),
            )
        self._journaled += len(changes) - dropped

    def _drop_commits(self, up_to: int, kept: int) -> int:
        """Drop the commits up to a version, and more until at most `kept` changes remain; the number dropped."""
        dropped = 0
        query = "SELECT version, size, state FROM commits ORDER BY version"
        last, redo_lost = 0, False
        for version, size, state in self._writer.execute(query):
            if version > up_to and self._journaled - dropped <= kept:
                break
            last, dropped, redo_lost = version, dropped + size, redo_lost or state == CommitState.UNDONE
        if last:
            self._writer.execute("DELETE FROM changes WHERE version <= ?", (last,))
            self._writer.execute("DELETE FROM commits WHERE version <= ?", (last,))
            self._writer.execute("DELETE FROM edits WHERE version <= ?", (last,))
            underlay_table.forget(self._writer, last)
        if redo_lost:
            # Later redos depend on the dropped one.
            self._writer.execute("UPDATE commits SET state = ? WHERE state = ?", (CommitState.PAST, CommitState.UNDONE))
        return dropped

    def undoable(self) -> Commit | None:
        """The commit that undo reverts, None if there is none."""
        return self._commit("DESC", CommitState.DONE)

    def redoable(self) -> Commit | None:
        """The commit that redo repeats, None if there is none."""
        return self._commit("ASC", CommitState.UNDONE)

    def _commit(self, order: str, state: CommitState) -> Commit | None:
        return self._commit_where(f"state = ? ORDER BY version {order} LIMIT 1", state)

    def commit_of(self, version: int) -> Commit | None:
        """The commit of a version, None if the journal does not hold it any more."""
        return self._commit_where("version = ?", version)

    def _commit_where(self, condition: str, value: int) -> Commit | None:
        query = f"SELECT version, name_before, name_after FROM commits WHERE {condition}"
        with _guarded(self.path):
            row = self._writer.execute(query, (value,)).fetchone()
            if row is None:
                return None
            query = f"SELECT {_CHANGE_COLUMNS} FROM changes WHERE version = ? ORDER BY position"
            return Commit(row[0], row[1], row[2], _changes(self._writer.execute(query, (row[0],))))

    def last_author(self, key: ElementKey, since: int) -> str:
        """The author of the last change of an element after version `since`; empty if none is known."""
        query = (
            "SELECT author FROM changes JOIN edits USING (version) WHERE version > ? AND kind = ? AND floor = ? "
            "AND name = ? ORDER BY version DESC LIMIT 1"
        )
        with _guarded(self.path):
            row = self._writer.execute(query, (since, *key.words)).fetchone()
        return row[0] if row else ""

    def changes_since(self, since: int, current: int) -> list[Change]:
        """The changes after version `since` up to `current`, in order.

        Raises VersionUnavailable if the journal does not reach back to `since`, or `since` is after `current`."""
        query = f"SELECT {_CHANGE_COLUMNS} FROM changes WHERE version > ? AND version <= ? ORDER BY version, position"
        with self._journal(since, current) as reader:
            return _changes(reader.execute(query, (since, current)))

    def edits_since(self, since: int, current: int) -> list[EditRecord]:
        """The edits after version `since` up to `current`, in order. Edits of earlier releases have no time.

        Raises VersionUnavailable as changes_since does."""
        query = (
            "SELECT version, coalesce(author, ''), coalesce(time, 0.0), size, coalesce(summary, size || ' changes') "
            "FROM commits LEFT JOIN edits USING (version) WHERE version > ? AND version <= ? ORDER BY version"
        )
        with self._journal(since, current) as reader:
            return [EditRecord(*row) for row in reader.execute(query, (since, current))]

    def change_page(self, start: ChangePosition, part: Selection, limit: int, current: int) -> ChangePage:
        """At most `limit` changes of a part of the building, from a position on, up to version `current`.

        Raises VersionUnavailable as changes_since does."""
        selected, values = _condition(part)
        query = (
            "SELECT version, position, kind, floor, name, before, after FROM changes "
            f"WHERE (version, position) >= (?, ?) AND version <= ? AND {selected} ORDER BY version, position LIMIT ?"
        )
        with self._journal(start.since, current) as reader:
            rows = reader.execute(query, (start.since + 1, start.taken, current, *values, limit + 1))
            found, following = _page(rows, limit, lambda row: len(row[3]) + len(row[5] or "") + len(row[6] or ""))
            position = ChangePosition(current) if following is None else ChangePosition(following[0] - 1, following[1])
            total = "SELECT total(size) FROM commits WHERE version > ? AND version <= ?"
            left = int(reader.execute(total, (position.since, current)).fetchone()[0]) - position.taken
        changes = [(row[0], *row[2:]) for row in found]
        return ChangePage(_changes(changes), position, following is None, left)

    def element_page(self, start: int, part: Selection, limit: int, version: int) -> ElementPage:
        """At most `limit` elements of a part of the building, from a position on, at `version` or later."""
        selected, values = _condition(part)
        query = f"SELECT id, kind, floor, version, value FROM elements WHERE id >= ? AND {selected} ORDER BY id LIMIT ?"
        with _guarded(self.path), self._reading:
            # The largest integer of SQLite is 2^63 - 1.
            rows = self._reader.execute(query, (min(start, 2**63 - 1), *values, limit + 1))
            found, following = _page(rows, limit, lambda row: len(row[2]) + len(row[4]))
        elements: list[tuple[str, Element, int]] = [
            (floor, decode_json(value, TYPE_OF[ElementKind(kind)]), changed) for _, kind, floor, changed, value in found
        ]
        return ElementPage(version, elements, following[0] if following else 0, following is None)

    def count_changes(self, since: int, current: int) -> int:
        """The number of changes after version `since` up to `current`.

        Raises VersionUnavailable as changes_since does."""
        total = "SELECT total(size) FROM commits WHERE version > ? AND version <= ?"
        with self._journal(since, current) as reader:
            return int(reader.execute(total, (since, current)).fetchone()[0])

    def oldest_within(self, changes: int, current: int) -> int:
        """The oldest version from which on there are at most so many changes up to `current`."""
        count, oldest = 0, current
        with _guarded(self.path), self._reading:
            query = "SELECT version, size FROM commits WHERE version <= ? ORDER BY version DESC"
            for version, size in self._reader.execute(query, (current,)):
                count += size
                if count > changes:
                    break
                oldest = version - 1
        return oldest

    @contextmanager
    def _journal(self, since: int, current: int) -> Iterator[sqlite3.Connection]:
        """A reader for versions after `since` up to `current`. Raises VersionUnavailable."""
        with _guarded(self.path), self._reading, _transaction(self._reader, "DEFERRED") as reader:
            first = reader.execute("SELECT min(version) FROM commits").fetchone()[0]
            oldest = current if first is None else min(first - 1, current)
            if not oldest <= since <= current:
                raise VersionUnavailable(since, oldest, current)
            yield reader

    def underlay(self, floor: str) -> Underlay | None:
        """The picture below a floor."""
        with _guarded(self.path), self._reading:
            return underlay_table.read(self._reader, floor)

    def set_underlay(self, floor: str, underlay: Underlay | None) -> None:
        """Set or remove the picture below a floor, durably. Raises InvalidElement if there is no room for it."""
        with self._changing() as writer:
            underlay_table.write(writer, floor, underlay)

    def proposals(self) -> bytes:
        """What `save_proposals` has stored last; empty if nothing."""
        with _guarded(self.path):
            row = self._writer.execute("SELECT value FROM proposals").fetchone()
        return bytes(row[0]) if row else b""

    def save_proposals(self, value: bytes) -> None:
        """Store the proposals, durably."""
        with self._changing() as writer:
            writer.execute("DELETE FROM proposals")
            writer.execute("INSERT INTO proposals VALUES (?)", (value,))


def stored_areas(path: Path) -> list[Area]:
    """The areas of all floors of a store, which may be open. Raises MapFileError."""
    with _guarded(path), closing(_connect(path, "ro")) as connection:
        rows = connection.execute("SELECT value FROM elements WHERE kind = 'area' ORDER BY id")
        return [decode_json(value, Area) for (value,) in rows]


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    uri = f"{path.absolute().as_uri()}?mode={mode}"
    return sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)


@contextmanager
def _transaction(connection: sqlite3.Connection, kind: str = "IMMEDIATE") -> Iterator[sqlite3.Connection]:
    connection.execute(f"BEGIN {kind}")
    try:
        yield connection
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


@contextmanager
def _guarded(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise MapFileError(str(path), 0, "", error.strerror or str(error)) from None
    except sqlite3.Error as error:
        reason = _damaged(path, error) if sqlite_files.is_damage(error) else str(error)
        raise MapFileError(str(path), 0, "", reason) from error
    except (msgspec.DecodeError, ValueError) as error:
        raise MapFileError(str(path), 0, "", _damaged(path, error)) from error


def _damaged(path: Path, reason: object) -> str:
    return f"damaged: {reason}; {restore_advice(path)}"


def _fill(connection: sqlite3.Connection, building: Building) -> None:
    for statement in _SCHEMA:
        connection.execute(statement)
    connection.execute("INSERT INTO building VALUES (?, ?)", (building.name, FIRST_VERSION))
    _write_elements(connection, [Change(FIRST_VERSION, key, None, element) for key, element in elements_of(building)])


def _write_elements(connection: sqlite3.Connection, changes: Sequence[Change]) -> None:
    connection.executemany(
        "DELETE FROM elements WHERE kind = ? AND floor = ? AND name = ?",
        (change.key.words for change in changes if change.after is None),
    )
    # An update keeps the row's id, as a dictionary keeps the position of a key.
    connection.executemany(
        f"INSERT INTO elements ({_ELEMENT_COLUMNS}) VALUES (?, ?, ?, ?, ?) ON CONFLICT (kind, floor, name) "
        "DO UPDATE SET version = excluded.version, value = excluded.value",
        ((*change.key.words, change.version, _text(change.after)) for change in changes if change.after is not None),
    )


def _text(element: Element | None) -> str | None:
    return None if element is None else msgspec.json.encode(element).decode()


def _condition(part: Selection) -> tuple[str, list[str]]:
    """The condition for the rows of a part of the building, and its parameters."""
    conditions, values = ["TRUE"], []
    if part.kinds:
        # Not by the index of kinds: each page would sort all rows behind it.
        conditions.append(f"+kind IN ({', '.join('?' * len(part.kinds))})")
        values += [kind.value for kind in part.kinds]
    if part.floor:
        conditions.append("floor IN ('', ?)")
        values.append(part.floor)
    return " AND ".join(conditions), values


def _page(
    rows: Iterable[tuple[Any, ...]], limit: int, length: Callable[[tuple[Any, ...]], int]
) -> tuple[list[tuple[Any, ...]], tuple[Any, ...] | None]:
    """The rows of a page, at most `limit` or MAX_PAGE_LENGTH characters but at least one, and the row that follows."""
    found: list[tuple[Any, ...]] = []
    total = 0
    for row in rows:
        total += length(row)
        if len(found) == limit or (found and total > MAX_PAGE_LENGTH):
            return found, row
        found.append(row)
    return found, None


def _changes(rows: Iterable[tuple[Any, ...]]) -> list[Change]:
    found = []
    for version, kind, floor, name, before, after in rows:
        key = ElementKey(ElementKind(kind), floor, name)
        old, new = (value and decode_json(value, TYPE_OF[key.kind]) for value in (before, after))
        found.append(Change(version, key, old, new))
    return found
