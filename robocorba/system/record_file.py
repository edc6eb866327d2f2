"""A store of records that survives a kill -9: msgpack values by kind and key in one SQLite file."""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import msgspec

from robocorba.errors.services import ServiceError
from robocorba.system import sqlite_files
from robocorba.system.decoding import decode_msgpack

#: Interval at which servers look whether somebody has removed their file [s].
KEEP_INTERVAL_S = 2.0

_log = logging.getLogger(__name__)
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
        self._tables = tables
        #: None while the file has to be opened again.
        self._place: sqlite_files.Place | None = None
        with contextlib.ExitStack() as stack, self._guarded():
            file.parent.mkdir(parents=True, exist_ok=True)
            stack.callback(os.close, sqlite_files.lock(file))
            if damage := sqlite_files.log_damage(file):
                raise ServiceError(sqlite_files.damage_text(file, damage))
            self._open()
            stack.callback(self._close)
            self._check()
            self._closing = stack.pop_all()

    def _open(self) -> None:
        sqlite_files.check_room(self.file)
        # After 5 s a backup, or another short reader, must have let this process write.
        self._db = sqlite3.connect(self.file, isolation_level=None, check_same_thread=False, timeout=5.0)
        with contextlib.ExitStack() as stack:
            stack.callback(self._db.close)
            self._db.execute("PRAGMA journal_mode = WAL")
            # Commits survive a kill of the process; the last ones may be lost in a power failure.
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.execute("BEGIN EXCLUSIVE")
            if not self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                identity = (f"PRAGMA {what} = {value}" for what, value in self._identity.items())
                for statement in (_RECORDS, *self._tables, *identity):
                    self._db.execute(statement)
            self._db.execute("COMMIT")
            stack.pop_all()
        self._place = sqlite_files.Place(self.file)

    def _check(self) -> None:
        found = {what: self._db.execute(f"PRAGMA {what}").fetchone()[0] for what in self._identity}
        if found != self._identity:
            raise ServiceError(f"{self.file} was not written by this release; move it to another folder")
        damage = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if damage != "ok":
            raise ServiceError(sqlite_files.damage_text(self.file, damage))

    def _close(self) -> None:
        with self._lock:  # SQLite crashes if a connection is closed while another thread uses it
            with contextlib.suppress(OSError, sqlite3.Error):
                self._keep_place()
            self._db.close()

    def _keep_place(self) -> None:
        """If somebody has removed the file, write it again: all of it is still here. Requires the lock."""
        if self._place and not self._place.is_kept:
            self._place.write_back(self._db)
            self._place = None
            _log.warning("%s was removed while it is in use; it is written again", self.file)
        if self._place is None:  # also if there was no room for it the last time
            self._open()

    def __enter__(self: S) -> S:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._closing.close()

    def keep(self) -> None:
        """Write the file again if somebody has removed it, also when nothing is to be changed."""
        with self._writing():
            pass

    def all(self, kind: str, schema: type[T]) -> list[T]:
        """The records of a kind, in the order in which they were first saved."""
        with self._guarded():
            rows = self._db.execute("SELECT value FROM records WHERE kind = ? ORDER BY rowid", (kind,)).fetchall()
            return [decode_msgpack(value, schema) for (value,) in rows]

    def save(self, kind: str, key: str, record: object) -> None:
        with self._writing():
            value = msgspec.msgpack.encode(record)
            # Not INSERT OR REPLACE, which would change the order.
            done = self._db.execute("UPDATE records SET value = ? WHERE kind = ? AND key = ?", (value, kind, key))
            if not done.rowcount:
                self._db.execute("INSERT INTO records VALUES (?, ?, ?)", (kind, key, value))

    def delete(self, kind: str, key: str) -> None:
        with self._writing():
            self._db.execute("DELETE FROM records WHERE kind = ? AND key = ?", (kind, key))

    def replace(self, kind: str, records: Iterable[tuple[str, object]]) -> None:
        """Replace all records of a kind."""
        rows = [(kind, key, msgspec.msgpack.encode(record)) for key, record in records]
        with self._writing():
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
        with self._writing():
            self._db.execute("DELETE FROM records")

    def compact(self) -> None:
        """Leave nothing in the file of what was deleted."""
        with self._writing():
            self._db.execute("VACUUM")
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """As `_guarded`, for changes: they must be found after a restart."""
        with self._guarded():
            self._keep_place()
            yield

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Serialise access, because threads share the connection and transactions must not interleave. Translates
        errors."""
        try:
            with self._lock:
                yield
        except sqlite3.Error as error:
            if sqlite_files.is_damage(error):
                raise ServiceError(sqlite_files.damage_text(self.file, error)) from error
            raise ServiceError(f"can't use {self.file}: {error}") from error
        except msgspec.MsgspecError as error:
            raise ServiceError(sqlite_files.damage_text(self.file, error)) from error
        except OSError as error:
            raise ServiceError(f"can't use {self.file}: {error.strerror}") from error
