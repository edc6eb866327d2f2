"""A store of records that survives a kill -9: msgpack values by kind and key in one SQLite file."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import msgspec

from robocorba.errors.services import AlreadyRunning, ServiceError

T = TypeVar("T")
S = TypeVar("S", bound="RecordFile")

_RECORDS = "CREATE TABLE records (kind TEXT NOT NULL, key TEXT NOT NULL, value BLOB NOT NULL, PRIMARY KEY (kind, key))"


class RecordFile:
    """One process at a time opens the store; any of its threads may use it. What a call has written survives a kill -9.

    application_id, schema_version: identify the program and release that wrote the file. tables: SQL statements that
    create further tables and their first rows. All methods raise AlreadyRunning while another process uses the file,
    and ServiceError for an unusable file."""

    def __init__(self, file: Path, application_id: int, schema_version: int, tables: Sequence[str] = ()) -> None:
        self.file = file
        self._lock = threading.Lock()
        self._identity = {"application_id": application_id, "user_version": schema_version}
        with self._guarded():
            file.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(file, isolation_level=None, check_same_thread=False, timeout=0.5)
            with contextlib.ExitStack() as stack:
                stack.callback(self._db.close)
                self._open(tables)
                stack.pop_all()

    def _open(self, tables: Sequence[str]) -> None:
        self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
        self._db.execute("PRAGMA journal_mode = WAL")
        # Commits survive a kill of the process; the last ones may be lost in a power failure.
        self._db.execute("PRAGMA synchronous = NORMAL")
        self._db.execute("BEGIN EXCLUSIVE")
        if not self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            identity = (f"PRAGMA {what} = {value}" for what, value in self._identity.items())
            for statement in (_RECORDS, *tables, *identity):
                self._db.execute(statement)
        self._db.execute("COMMIT")
        found = {what: self._db.execute(f"PRAGMA {what}").fetchone()[0] for what in self._identity}
        if found != self._identity:
            raise ServiceError(f"{self.file} was not written by this release; move it to another folder")

    def __enter__(self: S) -> S:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._db.close()

    def all(self, kind: str, schema: type[T]) -> list[T]:
        """The records of a kind, in the order in which they were first saved."""
        with self._guarded():
            rows = self._db.execute("SELECT value FROM records WHERE kind = ? ORDER BY rowid", (kind,)).fetchall()
            return [msgspec.msgpack.decode(value, type=schema) for (value,) in rows]

    def save(self, kind: str, key: str, record: object) -> None:
        with self._guarded():
            value = msgspec.msgpack.encode(record)
            # Not INSERT OR REPLACE, which would change the order.
            done = self._db.execute("UPDATE records SET value = ? WHERE kind = ? AND key = ?", (value, kind, key))
            if not done.rowcount:
                self._db.execute("INSERT INTO records VALUES (?, ?, ?)", (kind, key, value))

    def delete(self, kind: str, key: str) -> None:
        with self._guarded():
            self._db.execute("DELETE FROM records WHERE kind = ? AND key = ?", (kind, key))

    def replace(self, kind: str, records: Iterable[tuple[str, object]]) -> None:
        """Replace all records of a kind."""
        rows = [(kind, key, msgspec.msgpack.encode(record)) for key, record in records]
        with self._guarded():
            self._db.execute("BEGIN")
            try:
                self._db.execute("DELETE FROM records WHERE kind = ?", (kind,))
                self._db.executemany("INSERT INTO records VALUES (?, ?, ?)", rows)
                self._db.execute("COMMIT")
            finally:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")

    def clear(self) -> None:
        """Delete all records."""
        with self._guarded():
            self._db.execute("DELETE FROM records")

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Serialise access, because threads share the connection and transactions must not interleave. Translates
        errors."""
        try:
            with self._lock:
                yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise AlreadyRunning(f"another process uses {self.file}") from None
            raise ServiceError(f"can't use {self.file}: {error}") from error
        except (OSError, sqlite3.Error, msgspec.MsgspecError) as error:
            raise ServiceError(f"can't use {self.file}: {error}") from error
