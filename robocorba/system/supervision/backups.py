"""Backups of a state folder: one file with a consistent copy of everything that a system can't make again.

A backup is a compressed tar archive. Its first member, backup.json, lists the others with their digests. The databases
are copied by SQLite's online backup, so that servers may write meanwhile. The simulation is copied before the map: its
robots are on floors that the copied map has, unless they were removed in between, as after any edit.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import shutil
import sqlite3
import tarfile
import tempfile
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path

import msgspec

from robocorba import __version__
from robocorba.errors.files import LimitExceeded
from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.events import channel_store
from robocorba.map_editor import store as map_store
from robocorba.simulation import store as simulation_store
from robocorba.system import private_files, sqlite_files
from robocorba.system.damaged_files import LAST_BACKUP, BackupNote
from robocorba.system.decoding import decode_json
from robocorba.system.instances import instance_folder, instance_folders, json_member
from robocorba.system.names import PORTS
from robocorba.system.output_files import check_output
from robocorba.system.state_folder import StateFolder
from robocorba.system.supervision.naming_data import DATA, EARLIER, intact_part

#: The databases, in the order in which they are copied, and their application ids.
DATABASES: Mapping[str, int] = {
    r"channels/[A-Za-z0-9_][A-Za-z0-9_.-]*\.sqlite": channel_store.APPLICATION_ID,
    r"simulation\.sqlite": simulation_store.APPLICATION_ID,
    r"map\.sqlite": map_store.APPLICATION_ID,
}
_NAMING_DATA = f"omninames/{DATA}"
#: The other files.
FILES = (
    r"channels/[A-Za-z0-9_][A-Za-z0-9_.-]*\.seen",
    r"ports\.json",
    r"links\.json",
    r"map\.origin\.json",
    re.escape(_NAMING_DATA),
)
_LIST = "backup.json"
#: What the name of the folder with the former state begins with.
_FORMER = "before-restore-"


class BackupList(msgspec.Struct):
    """What a backup holds. made: POSIX time [s]. release: of RoboCorba. files: name to SHA-256."""

    made: float
    release: str
    files: dict[str, str]


def back_up(state: Path, file: Path, overwrite: bool = False) -> BackupList:
    """Write a backup of a state folder, whose system may run, and note in the folder where it is.

    Raises ServiceError: nothing is there to copy, a database is damaged, the file can't be written; OutputError."""
    os.umask(private_files.UMASK)
    file = file.absolute()
    names = list(_names_in(state))
    check_output(file, [state / name for name in names], replace=overwrite)
    if not names:
        raise ServiceError(f"nothing to back up in {state}")
    new = file.with_name(file.name + ".new")
    with _reporting(file), tempfile.TemporaryDirectory(prefix=".robocorba-backup-", dir=file.parent) as temporary:
        folder = Path(temporary)
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            _copy(state, folder, name)
        content = BackupList(time.time(), __version__, {name: _digest(folder / name) for name in names})
        try:
            _pack(folder, content, new)
            new.replace(file)
        finally:
            new.unlink(missing_ok=True)
        (state / LAST_BACKUP).write_bytes(msgspec.json.encode(BackupNote(str(file), content.made)))
    return content


def restore(file: Path, state: Path) -> Path | None:
    """Replace the state of a system that does not run by that of a backup, once all of it has been read and checked.

    Where another system of this user has the ports of the backup, of which this one becomes a copy, it gets others.
    Returns the folder in the state folder that holds the former state, None if there was none. Raises AlreadyRunning;
    ServiceError if the backup is damaged."""
    file = file.absolute()
    if not file.is_file():
        raise ServiceError(f"there is no backup {file}")
    with StateFolder(state).locked(), contextlib.ExitStack() as locks, _reporting(file):
        for name in _databases_in(state):
            locks.callback(os.close, sqlite_files.lock(state / name))
        new = state / "restore.new"
        shutil.rmtree(new, ignore_errors=True)
        try:
            content = _unpack(file, new)
            port = json_member(new / PORTS, "naming")
            others = {instance_folder(""), *instance_folders().values()} - {state.absolute()}
            if port and port in [json_member(other / PORTS, "naming") for other in others]:
                del content.files[PORTS]
            former = _move_aside(state)
            for name in content.files:
                (state / name).parent.mkdir(exist_ok=True)
                (new / name).rename(state / name)
        finally:
            shutil.rmtree(new, ignore_errors=True)
        (state / LAST_BACKUP).write_bytes(msgspec.json.encode(BackupNote(str(file), content.made)))
        return former


@contextlib.contextmanager
def _reporting(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        raise ServiceError(f"{file}: {getattr(error, 'strerror', None) or error}") from None


def _names_in(state: Path) -> Iterator[str]:
    """What a backup of a state folder holds, in the order of copying."""
    yield from _databases_in(state)
    yield from _matching(state, FILES)


def _databases_in(state: Path) -> Iterator[str]:
    return _matching(state, DATABASES)


def _matching(state: Path, patterns: Mapping[str, int] | tuple[str, ...]) -> Iterator[str]:
    there = sorted(path.relative_to(state).as_posix() for glob in ("*", "*/*") for path in state.glob(glob))
    for pattern in patterns:
        for name in there:
            if re.fullmatch(pattern, name) and (state / name).is_file():
                yield name


# ---- writing ----


def _copy(state: Path, folder: Path, name: str) -> None:
    """Raises OSError, sqlite3.Error, ServiceError."""
    source, target = state / name, folder / name
    if name == _NAMING_DATA:  # its last line may be written just now
        target.write_bytes(intact_part(source.read_bytes()))
    elif name.endswith(".sqlite"):
        with _unless_in_use(source) as is_in_use:
            damage = "" if is_in_use else sqlite_files.log_damage(source)
            if not damage:
                _copy_database(source, target)
                damage = _damage(target, name)
            if damage:
                raise ServiceError(sqlite_files.damage_text(source, damage))
    else:
        shutil.copyfile(source, target)


@contextlib.contextmanager
def _unless_in_use(file: Path) -> Iterator[bool]:
    """Keep servers from opening a database meanwhile; whether one uses it already."""
    try:
        lock = sqlite_files.lock(file)
    except AlreadyRunning:
        yield True
        return
    try:
        yield False
    finally:
        os.close(lock)


def _copy_database(source: Path, target: Path) -> None:
    uri = f"{source.absolute().as_uri()}?mode=rw"  # a reader, too, writes to what processes share
    with closing(sqlite3.connect(uri, uri=True, timeout=10.0)) as connection:
        try:
            sqlite_files.copy(connection, target)
        except sqlite3.DatabaseError as error:
            if sqlite_files.is_damage(error):
                raise ServiceError(sqlite_files.damage_text(source, error)) from None
            raise


def _pack(folder: Path, content: BackupList, target: Path) -> None:
    with target.open("wb") as out:
        with tarfile.open(fileobj=out, mode="w:gz", compresslevel=3) as archive:
            text = msgspec.json.format(msgspec.json.encode(content))
            member = tarfile.TarInfo(_LIST)
            member.size, member.mtime, member.mode = len(text), int(content.made), 0o600
            archive.addfile(member, io.BytesIO(text))
            for name in content.files:
                archive.add(folder / name, name)
        out.flush()
        os.fsync(out.fileno())


# ---- reading ----


def _unpack(file: Path, folder: Path) -> BackupList:
    """Raises OSError; ServiceError if anything of the backup is damaged."""
    folder.mkdir(mode=private_files.FOLDER_MODE)
    try:
        with tarfile.open(file, "r:gz") as archive:
            content = _read_list(archive)
            for name, digest in content.files.items():
                _unpack_member(archive, folder, name)
                if _digest(folder / name) != digest:
                    raise ServiceError(f"{file} is damaged: {name} is not what was saved")
                if damage := _damage(folder / name, name):
                    raise ServiceError(f"{file} is damaged: {name}: {damage}")
    except LimitExceeded:
        raise
    except (tarfile.TarError, zlib.error, EOFError, KeyError, ValueError, msgspec.MsgspecError) as error:
        raise ServiceError(f"{file} is damaged, or no backup of RoboCorba ({error})") from None
    except OSError as error:
        if isinstance(error, tarfile.ReadError) or error.errno is None:  # gzip's BadGzipFile
            raise ServiceError(f"{file} is damaged, or no backup of RoboCorba ({error})") from None
        raise
    return content


def _read_list(archive: tarfile.TarFile) -> BackupList:
    first = archive.next()
    if first is None or first.name != _LIST or not first.isfile() or first.size > 1024 * 1024:
        raise ValueError(f"it does not begin with {_LIST}")
    data = archive.extractfile(first)
    assert data is not None
    content = decode_json(data.read(), BackupList)
    known = (*DATABASES, *FILES)
    for name in content.files:
        if not any(re.fullmatch(pattern, name) for pattern in known):
            raise ValueError(f"it holds {name[:80]!r}, which is no part of a state folder")
    return content


def _unpack_member(archive: tarfile.TarFile, folder: Path, name: str) -> None:
    member = archive.getmember(name)
    data = archive.extractfile(member)
    if data is None or member.issparse():
        raise ValueError(f"{name} is no file")
    free = shutil.disk_usage(folder).free
    if member.size > free:
        raise LimitExceeded(
            f"{Path(str(archive.name)).name}: {name}", member.size, free, "bytes (free in the state folder)"
        )
    target = folder / name
    target.parent.mkdir(exist_ok=True)
    with target.open("wb") as out:
        shutil.copyfileobj(data, out)
        out.flush()
        os.fsync(out.fileno())


def _damage(file: Path, name: str) -> str:
    """What is wrong with a database of this name in the state folder; empty if nothing is, or it is none."""
    expected = next((id for pattern, id in DATABASES.items() if re.fullmatch(pattern, name)), None)
    if expected is None:
        return ""
    try:
        with closing(sqlite3.connect(file)) as connection:
            found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                return str(found)
            if connection.execute("PRAGMA application_id").fetchone()[0] != expected:
                return "a database of another kind"
    except sqlite3.DatabaseError as error:
        return str(error)
    return ""


def _move_aside(state: Path) -> Path | None:
    """Move what a restored state replaces, and all that belongs to it, to a folder of its own in the state folder."""
    names = list(_names_in(state))
    suffixes = (sqlite_files.LOG, sqlite_files.SHARED, sqlite_files.JOURNAL)
    names += [f"{name}{suffix}" for name in names if name.endswith(".sqlite") for suffix in suffixes]
    # A log without its database would be applied to the restored one.
    names += _matching(state, tuple(pattern + re.escape(suffix) for pattern in DATABASES for suffix in suffixes))
    names.append(f"omninames/{EARLIER}")
    there = [name for name in dict.fromkeys(names) if (state / name).exists() and not name.startswith(_FORMER)]
    if not there:
        return None
    former = state / (_FORMER + time.strftime("%Y%m%dT%H%M%S"))
    number = 1
    while former.exists():
        number += 1
        former = former.with_name(f"{former.name.partition('.')[0]}.{number}")
    former.mkdir(mode=private_files.FOLDER_MODE)
    with contextlib.ExitStack() as moved_back:
        for name in there:
            (former / name).parent.mkdir(exist_ok=True)
            (state / name).rename(former / name)
            moved_back.callback((former / name).rename, state / name)
        moved_back.pop_all()
    return former


def _digest(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as data:
        while chunk := data.read(1024 * 1024):
            digest.update(chunk)
    return digest.hexdigest()
