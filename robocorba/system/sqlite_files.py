"""What all SQLite files of the state folder need: one process at a time, no silent loss of the latest transactions, and
a file that stays where it is."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

from robocorba.errors.services import AlreadyRunning
from robocorba.system.damaged_files import restore_advice

#: SQLite keeps the latest transactions, and what processes share, beside the file.
LOG, SHARED, JOURNAL = "-wal", "-shm", "-journal"
#: Free space that a database needs to be opened [bytes].
MIN_ROOM = 256 * 1024
#: Beginning of a write-ahead log: magic number, format, page size, checkpoint, salts, checksums.
_LOG_HEADER = struct.Struct(">8I")


def lock(file: Path) -> int:
    """Lock a database by a file beside it. The lock ends when the returned descriptor or the process is closed.

    Raises AlreadyRunning, OSError."""
    descriptor = os.open(f"{file}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise AlreadyRunning(f"{file} is in use by another process") from None
    return descriptor


def check_room(file: Path) -> None:
    """To be called before a database is opened: SQLite maps what processes share into memory, and where blocks are
    smaller than 4 KiB, as in a small ext4, a full disk would end this process by SIGBUS. Raises OSError."""
    found = os.statvfs(file.parent)
    if (free := found.f_bavail * found.f_frsize) < MIN_ROOM:
        raise OSError(errno.ENOSPC, f"the disk is full: {free} bytes are free, {MIN_ROOM} are needed to open it")


def beside(file: Path, suffix: str) -> Path:
    return file.with_name(file.name + suffix)


def log_damage(file: Path) -> str:
    """Why the latest transactions of a database that no process uses can't be read, empty if they can, or there are
    none. SQLite ignores a log whose beginning is damaged: it would silently go back to an earlier state."""
    try:
        with beside(file, LOG).open("rb") as log:
            header = log.read(_LOG_HEADER.size)
    except FileNotFoundError:
        return ""
    if not header:
        return ""
    if len(header) < _LOG_HEADER.size:
        return f"{file.name}{LOG} is too short"
    magic, format, _, _, _, _, *checksums = _LOG_HEADER.unpack(header)
    if magic & ~1 != 0x377F0682 or format != 3007000 or checksums != _checksums(header[:24], bool(magic & 1)):
        return f"{file.name}{LOG} does not begin as a log"
    return ""


def _checksums(data: bytes, is_big_endian: bool) -> list[int]:
    first = second = 0
    words = struct.unpack(f"{'>' if is_big_endian else '<'}{len(data) // 4}I", data)
    for even, odd in zip(words[::2], words[1::2], strict=True):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return [first, second]


def is_damage(error: sqlite3.Error) -> bool:
    """Whether an error says that the file is damaged, rather than locked, missing or on a full disk."""
    return type(error) is sqlite3.DatabaseError


def damage_text(file: Path, reason: object) -> str:
    """One line for the user."""
    return f"{file} is damaged ({reason}); {restore_advice(file)}"


class Place:
    """Whether an open database still has its names in the folder. Made when the file is open and has a log."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._identities = self._now()

    @property
    def is_kept(self) -> bool:
        """Whether all is as it was. Takes some microseconds."""
        return self._now() == self._identities

    def write_back(self, connection: sqlite3.Connection) -> None:
        """Give the database its name again, by a copy from the open connection, which must be opened again then.

        Raises OSError, also if another file has the name: its owner decides. Raises sqlite3.Error."""
        file = self.file
        now = self._now()
        if now[0] not in (None, self._identities[0]):
            for suffix, mine, found in zip((LOG, SHARED), self._identities[1:], now[1:], strict=True):
                if mine is not None and mine == found:  # SQLite would apply it to the other file
                    beside(file, suffix).unlink()
            raise OSError(0, f"{file} was replaced while a process uses it; restart the process to use it")
        file.parent.mkdir(parents=True, exist_ok=True)
        new = beside(file, ".new")
        remove_database(new)
        copy(connection, new)
        remove_database(file)
        new.rename(file)
        connection.close()  # not before: if anything fails, it still has all that the next attempt copies

    def _now(self) -> tuple[tuple[int, int] | None, ...]:
        return tuple(map(_identity, (self.file, beside(self.file, LOG), beside(self.file, SHARED))))


def copy(connection: sqlite3.Connection, file: Path) -> None:
    """Write what a connection reads now to a durable file; none if that fails. Raises OSError, sqlite3.Error."""
    try:
        with closing(sqlite3.connect(file)) as target:
            connection.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")
        descriptor = os.open(file, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except BaseException:
        remove_database(file)
        raise


def remove_database(file: Path) -> None:
    """Remove a database and what belongs to it. Raises OSError."""
    for suffix in ("", LOG, SHARED, JOURNAL):
        beside(file, suffix).unlink(missing_ok=True)


def _identity(file: Path) -> tuple[int, int] | None:
    with contextlib.suppress(OSError):
        found = file.stat()
        return found.st_dev, found.st_ino
    return None
