"""What a channel must know again after it was killed: its proxies, its peers, the notices of the federation.

One SQLite file for each channel. Events are not in it: what waited in queues ends with the process.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import msgspec

from robocorba.errors import AlreadyRunning, ServiceError
from robocorba.events.federation import Notice
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Subscription

T = TypeVar("T")

#: "RoCe": tells our files from those of others.
APPLICATION_ID = 0x526F4365
SCHEMA_VERSION = 1
#: Numbers of events begin with the second of the start, counted from 2020 on, in their upper 32 bits.
FIRST_SECOND = 1_577_836_800
COUNT_BITS = 32
#: Those of proxies with the second in which the file was made, above so many bits.
ID_BITS = 10

_SCHEMA = (
    "CREATE TABLE starts (second INTEGER NOT NULL)",
    "CREATE TABLE ids (next INTEGER NOT NULL)",
    "CREATE TABLE records (kind TEXT NOT NULL, key TEXT NOT NULL, value BLOB NOT NULL, PRIMARY KEY (kind, key))",
    f"PRAGMA application_id = {APPLICATION_ID}",
    f"PRAGMA user_version = {SCHEMA_VERSION}",
)


class ProxyRecord(msgspec.Struct):
    """A proxy; `client` is the stringified reference of who is connected, empty for nil. policy: of outlets only."""

    id: str
    kind: str
    name: str = ""
    is_connected: bool = False
    is_suspended: bool = False
    client: str = ""
    subscription: Subscription = ()
    policy: QueuePolicy | None = None


class PeerRecord(msgspec.Struct):
    """A peer. address: empty for the naming service, else HOST:PORT or a URI. reference: where it was found last.
    removed: it was a peer, and must not link itself again."""

    name: str
    address: str = ""
    reference: str = ""
    foreign: bool = False
    removed: bool = False


class Store:
    """Opened by one process at a time. Raises AlreadyRunning, or ServiceError for whatever is wrong with the file."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._lock = threading.Lock()
        with self._guarded():
            file.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(file, isolation_level=None, check_same_thread=False, timeout=0.5)
            with contextlib.ExitStack() as stack:
                stack.callback(self._db.close)
                self._open()
                stack.pop_all()

    def _open(self) -> None:
        self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
        self._db.execute("PRAGMA journal_mode = WAL")
        # Survives the process that is killed, as the mapped watermarks do; not a power cut in the last moments.
        self._db.execute("PRAGMA synchronous = NORMAL")
        self._db.execute("BEGIN EXCLUSIVE")
        if not self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            for statement in _SCHEMA:
                self._db.execute(statement)
            # Where an older file was lost, its numbers must not come again: clients still hold them.
            self._db.execute("INSERT INTO ids VALUES (?)", ((int(time.time()) - FIRST_SECOND) << ID_BITS,))
        self._db.execute("COMMIT")
        found = [self._db.execute(f"PRAGMA {what}").fetchone()[0] for what in ("application_id", "user_version")]
        if found != [APPLICATION_ID, SCHEMA_VERSION]:
            raise ServiceError(f"{self.file} is not a channel's file of this release")

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._db.close()

    def first_number(self) -> int:
        """The number of the first event after this start: higher than any before, also where this file was lost."""
        with self._guarded():
            last = self._db.execute("SELECT max(second) FROM starts").fetchone()[0]
            second = max(int(time.time()) - FIRST_SECOND, (last or 0) + 1)
            self._db.execute("DELETE FROM starts")
            self._db.execute("INSERT INTO starts VALUES (?)", (second,))
        return (second << COUNT_BITS) + 1

    def next_id(self) -> int:
        """A number that no proxy of this channel had."""
        with self._guarded():
            ((id,),) = self._db.execute("UPDATE ids SET next = next + 1 RETURNING next - 1").fetchall()
            return int(id)

    def proxies(self) -> list[ProxyRecord]:
        return self._all("proxy", ProxyRecord)

    def save_proxy(self, record: ProxyRecord) -> None:
        self._save("proxy", record.id, record)

    def forget_proxy(self, id: str) -> None:
        self._forget("proxy", id)

    def peers(self) -> list[PeerRecord]:
        return self._all("peer", PeerRecord)

    def save_peer(self, record: PeerRecord) -> None:
        self._save("peer", record.name, record)

    def forget_peer(self, name: str) -> None:
        self._forget("peer", name)

    def notices(self) -> list[Notice]:
        return self._all("notice", Notice)

    def save_notices(self, notices: Iterable[Notice]) -> None:
        """Keep these, and no others."""
        rows = [("notice", notice.name, msgspec.msgpack.encode(notice)) for notice in notices]
        with self._guarded():
            self._db.execute("BEGIN")
            try:
                self._db.execute("DELETE FROM records WHERE kind = 'notice'")
                self._db.executemany("INSERT INTO records VALUES (?, ?, ?)", rows)
                self._db.execute("COMMIT")
            finally:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")

    def clear(self) -> None:
        """Forget all but the numbers: the channel was destroyed."""
        with self._guarded():
            self._db.execute("DELETE FROM records")

    def _all(self, kind: str, schema: type[T]) -> list[T]:
        with self._guarded():
            rows = self._db.execute("SELECT value FROM records WHERE kind = ? ORDER BY rowid", (kind,)).fetchall()
            return [msgspec.msgpack.decode(value, type=schema) for (value,) in rows]

    def _save(self, kind: str, key: str, record: object) -> None:
        with self._guarded():
            value = msgspec.msgpack.encode(record)
            # Not INSERT OR REPLACE, which would change the order.
            done = self._db.execute("UPDATE records SET value = ? WHERE kind = ? AND key = ?", (value, kind, key))
            if not done.rowcount:
                self._db.execute("INSERT INTO records VALUES (?, ?, ?)", (kind, key, value))

    def _forget(self, kind: str, key: str) -> None:
        with self._guarded():
            self._db.execute("DELETE FROM records WHERE kind = ? AND key = ?", (kind, key))

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """One thread at a time: all share a connection, and what one does must not get into another's transaction."""
        try:
            with self._lock:
                yield
        except sqlite3.OperationalError as wrong:
            if "locked" in str(wrong):
                raise AlreadyRunning(f"another process uses {self.file}") from None
            raise ServiceError(f"can't use {self.file}: {wrong}") from wrong
        except (OSError, sqlite3.Error, msgspec.MsgspecError) as wrong:
            raise ServiceError(f"can't use {self.file}: {wrong}") from wrong
