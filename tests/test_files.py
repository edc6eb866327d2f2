"""Files of the state folder: private, written again when they were removed, and refused when they are damaged."""

from __future__ import annotations

import os
import random
import shutil
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.map_editor import native
from robocorba.servers.initial_building import open_store
from robocorba.system import private_files, sqlite_files
from robocorba.system.private_files import claim_state, exposure, make_folder
from robocorba.system.record_file import RecordFile
from testkit.buildings import two_floors
from tests.damage import damage

#: A user who is not this one.
OTHER = 12345


@pytest.fixture(autouse=True)
def umask() -> Iterator[None]:
    former = os.umask(0o022)
    yield
    os.umask(former)


def mode_of(path: Path) -> int:
    return path.stat().st_mode & 0o7777


def test_a_folder_is_private_and_an_earlier_one_is_mended(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    new, state = tmp_path / "a" / "state", tmp_path / "state"
    claim_state(new)
    (new / "file").touch()
    assert (mode_of(new), mode_of(new / "file"), caplog.text) == (0o700, 0o600, "")
    os.umask(0o022)
    (state / "logs").mkdir(parents=True)
    for name in ("lock", "simulation.sqlite", "simulation.sqlite-wal", "up.json"):
        (state / name).touch()
    (state / "link.json").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").touch()
    claim_state(state)
    assert "was open to other users" in caplog.text
    for path in (state, *state.iterdir()):
        assert path.is_symlink() or mode_of(path) & 0o077 == 0, path
    assert mode_of(tmp_path / "elsewhere") == 0o644
    caplog.clear()
    claim_state(state)
    assert caplog.text == ""


def test_a_folder_that_is_there_for_more_keeps_its_mode(tmp_path: Path) -> None:
    """--state /tmp by mistake must not lock everybody out of it."""
    for name, before in (("project", 0o755), ("sticky", 0o1755)):
        os.umask(0o022)
        folder = tmp_path / name
        folder.mkdir()
        thesis, database = folder / "thesis.tex", folder / "simulation.sqlite"
        thesis.touch()
        database.touch()
        folder.chmod(before)
        claim_state(folder)
        assert [mode_of(path) for path in (folder, thesis, database)] == [before, 0o644, 0o600]


def test_a_folder_of_others_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "thesis.tex").touch()
    shared.chmod(0o1777)
    with pytest.raises(ServiceError, match="others can write"):
        claim_state(shared)
    assert mode_of(shared) == 0o1777
    monkeypatch.setattr(private_files.os, "geteuid", lambda: OTHER)
    if tmp_path.stat().st_uid == 0:
        monkeypatch.setattr(private_files, "_trusted", lambda: (OTHER,))
    with pytest.raises(ServiceError, match="belongs to user"):
        claim_state(tmp_path)


def test_who_could_replace_something(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, inner = tmp_path / "a", tmp_path / "a" / "b"
    make_folder(inner)
    assert mode_of(folder) == mode_of(inner) == 0o700
    assert exposure(inner) == ""
    folder.chmod(0o1777)  # as /tmp
    assert (exposure(inner), exposure(folder)) == ("", f"others can write to {folder}")
    folder.chmod(0o777)
    assert exposure(inner) == f"others can write to {folder}"
    folder.chmod(0o770)
    for is_own, found in ((True, ""), (False, f"others can write to {folder}")):
        monkeypatch.setattr(private_files, "_is_own_group", lambda group, is_own=is_own: is_own)
        assert exposure(folder) == found
    folder.chmod(0o755)
    (tmp_path / "link").symlink_to(inner)
    assert exposure(tmp_path / "link") == ""
    monkeypatch.setattr(private_files, "_trusted", lambda: (OTHER,))
    assert "belongs to" in exposure(inner)


SUFFIXES = ("", sqlite_files.LOG, sqlite_files.SHARED)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "file.sqlite"


def opened(file: Path) -> RecordFile:
    return RecordFile(file, 7, 1)


def content(file: Path) -> list[int]:
    with opened(file) as store:
        return sorted(store.all("kind", int))


def copy_of(file: Path) -> Path:
    """What a kill -9 would leave."""
    folder = file.parent / "copy"
    folder.mkdir(exist_ok=True)
    for suffix in SUFFIXES:
        copy = sqlite_files.beside(folder / file.name, suffix)
        copy.unlink(missing_ok=True)
        if sqlite_files.beside(file, suffix).exists():
            shutil.copy(sqlite_files.beside(file, suffix), copy)
    return folder / file.name


@pytest.mark.parametrize("removed", [("",), SUFFIXES, (sqlite_files.LOG,), (sqlite_files.SHARED,)])
def test_removed_files_are_rewritten(file: Path, removed: tuple[str, ...], caplog: pytest.LogCaptureFixture) -> None:
    with opened(file) as store:
        store.save("kind", "before", 1)
        for suffix in removed:
            sqlite_files.beside(file, suffix).unlink()
        store.save("kind", "after", 2)
        assert "was removed while it is in use" in caplog.text
        assert content(copy_of(file)) == [1, 2]
        store.save("kind", "later", 3)
    assert content(file) == [1, 2, 3]


def test_a_removed_file_is_written_again_without_a_change_or_at_the_end_but_over_no_other(file: Path) -> None:
    with opened(file) as store:
        store.save("kind", "key", 1)
        file.unlink()
        store.keep()
        assert content(copy_of(file)) == [1]
        shutil.rmtree(file.parent)
    assert content(file) == [1]
    with opened(file.with_name("other")) as other:
        other.save("kind", "key", 2)
    with opened(file) as store:
        file.with_name("other").replace(file)
        with pytest.raises(ServiceError, match="was replaced"):
            store.save("kind", "key", 3)
    assert content(file) == [2]


@pytest.mark.parametrize(
    ("where", "name", "error"),
    [(sqlite_files, "copy", "No space left on device"), (Path, "rename", "Input/output error")],
)
def test_a_removed_file_is_written_later(file: Path, where: Any, name: str, error: str) -> None:
    """It can be read while there is no room, or while its removal has not ended yet."""

    def fail(*_: object) -> None:
        raise OSError(28, error)

    with opened(file) as store:
        store.save("kind", "key", 1)
        sqlite_files.remove_database(file)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(where, name, fail)
            with pytest.raises(ServiceError, match=error):
                store.save("kind", "second", 2)
            assert store.all("kind", int) == [1]
        store.save("kind", "third", 3)
    assert content(file) == [1, 3]


@pytest.mark.parametrize("suffix", SUFFIXES[:2])
def test_a_damaged_beginning_is_refused_in_one_line_with_advice(file: Path, suffix: str) -> None:
    with opened(file) as store:
        store.save("kind", "key", 1)
        copy = copy_of(file)
    if not suffix:
        copy = copy_of(file)  # without a log, which would hold all pages of the file
    damage(sqlite_files.beside(copy, suffix))
    with pytest.raises(ServiceError) as refused:
        opened(copy)
    text = str(refused.value)
    assert text.startswith(f"{copy} is damaged (") and "robocorba restore" in text and "\n" not in text


def test_one_process_at_a_time_with_room_and_nothing_is_left_of_what_was_deleted(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(file) as store:
        with pytest.raises(AlreadyRunning):
            opened(file)
        for number in range(100):
            store.save("kind", str(number), number)
        assert content(copy_of(file)) == list(range(100))  # the intact log of a killed process is read
        store.save("other", "key", "a secret")
        store.delete("other", "key")
        store.compact()
        for suffix in SUFFIXES:
            assert b"a secret" not in sqlite_files.beside(file, suffix).read_bytes()
    # Without room it is not opened: SQLite would end the process by SIGBUS where blocks are small.
    monkeypatch.setattr(sqlite_files, "MIN_ROOM", 2**62)
    with pytest.raises(ServiceError, match="the disk is full"):
        opened(file)


def test_a_store_can_be_closed_while_a_thread_writes(tmp_path: Path) -> None:
    """What comes too late is an error, and not a crash of SQLite."""
    for number in range(20):
        begun = threading.Event()

        def write(store: RecordFile, begun: threading.Event = begun) -> None:
            while True:
                store.replace("a", ((str(key), key) for key in range(100)))
                begun.set()

        with ThreadPoolExecutor(1) as threads, opened(tmp_path / f"{number}.sqlite") as store:
            writing = threads.submit(write, store)
            assert begun.wait(60.0)
        with pytest.raises(ServiceError, match="closed"):
            writing.result(60.0)


def test_what_is_blocked_in_a_new_map_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    building = two_floors()
    door = building.floors["L1"].geometrical.doors["d"]
    locked = building.with_element("L1", msgspec.structs.replace(door, locked=True))
    file = tmp_path / "locked.yaml"
    native.save(locked, file)
    for _ in range(2):  # a store that was made before is opened without a word
        with open_store(tmp_path / "state" / "map.sqlite", file) as store:
            assert store.load().building == locked
    assert [record.getMessage() for record in caplog.records] == [
        f"{file}: blocked edges of L1 (1): west-east (locked door 'd' near 10, 5)"
    ]


def test_a_damaged_origin_is_set_aside(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file, map_file, origin = tmp_path / "two.yaml", tmp_path / "map.sqlite", tmp_path / "map.origin.json"
    native.save(two_floors(), file)
    open_store(map_file, file).close()
    good = origin.read_bytes()
    for damaged in (random.Random(1).randbytes(200), b"[" * 100_000, b"{}", b""):
        caplog.clear()
        origin.write_bytes(damaged)
        open_store(map_file, file).close()
        assert f"{origin} is damaged" in caplog.text
        assert ((tmp_path / "map.origin.json.damaged").read_bytes(), origin.read_bytes()) == (damaged, good)
