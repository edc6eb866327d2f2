"""A store whose files are removed, replaced or damaged, or for which there is no room."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from robocorba import sqlite_files
from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.record_file import RecordFile
from tests.damage import damage

SUFFIXES = ("", sqlite_files.LOG, sqlite_files.SHARED)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "file.sqlite"


def opened(file: Path) -> RecordFile:
    return RecordFile(file, 7, 1)


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
def test_a_file_removed_while_it_is_in_use_is_written_again(
    file: Path, removed: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    store = opened(file)
    store.save("kind", "before", 1)
    for suffix in removed:
        sqlite_files.beside(file, suffix).unlink()
    store.save("kind", "after", 2)
    assert "was removed while it is in use" in caplog.text
    with opened(copy_of(file)) as killed:
        assert killed.all("kind", int) == [1, 2]
    store.save("kind", "later", 3)
    with store:
        pass
    with opened(file) as again:
        assert again.all("kind", int) == [1, 2, 3]


def test_a_removed_file_is_written_again_without_a_change(file: Path) -> None:
    store = opened(file)
    store.save("kind", "key", 1)
    file.unlink()
    store.keep()
    with opened(copy_of(file)) as killed:
        assert killed.all("kind", int) == [1]
    store.__exit__(None, None, None)


def test_a_file_removed_before_the_end_is_written_again(file: Path) -> None:
    with opened(file) as store:
        store.save("kind", "key", 1)
        shutil.rmtree(file.parent)
    with opened(file) as again:
        assert again.all("kind", int) == [1]


def test_another_file_in_its_place_is_not_overwritten(file: Path) -> None:
    with opened(file.with_name("other")) as other:
        other.save("kind", "key", 2)
    with opened(file) as store:
        store.save("kind", "key", 1)
        file.with_name("other").replace(file)
        with pytest.raises(ServiceError, match="was replaced"):
            store.save("kind", "key", 3)
    with opened(file) as again:
        assert again.all("kind", int) == [2]


def test_while_there_is_no_room_for_it_the_file_can_be_read(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with opened(file) as store:
        store.save("kind", "key", 1)
        file.unlink()
        with monkeypatch.context() as patch:
            patch.setattr(sqlite_files, "copy", fail)
            with pytest.raises(ServiceError, match="No space left"):
                store.save("kind", "key", 2)
            assert store.all("kind", int) == [1]
        store.save("kind", "key", 3)
    with opened(file) as again:
        assert again.all("kind", int) == [3]


def test_a_removed_file_is_written_again_at_a_later_attempt(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when its removal has not ended yet."""
    rename = Path.rename
    with opened(file) as store:
        store.save("kind", "key", 1)
        sqlite_files.remove_database(file)
        with monkeypatch.context() as failing:
            failing.setattr(Path, "rename", lambda *paths: (_ for _ in ()).throw(OSError(5, "Input/output error")))
            with pytest.raises(ServiceError):
                store.save("kind", "second", 2)
        assert Path.rename is rename
        store.save("kind", "third", 3)
    with opened(file) as again:
        assert sorted(again.all("kind", int)) == [1, 3]


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


def test_an_intact_log_of_a_killed_process_is_read(file: Path) -> None:
    with opened(file) as store:
        for number in range(100):
            store.save("kind", str(number), number)
        with opened(copy_of(file)) as killed:
            assert killed.all("kind", int) == list(range(100))


def test_one_process_at_a_time(file: Path) -> None:
    with opened(file), pytest.raises(AlreadyRunning):
        opened(file)


def test_nothing_is_left_of_what_was_deleted(file: Path) -> None:
    with opened(file) as store:
        store.save("kind", "key", "a secret")
        store.delete("kind", "key")
        store.compact()
        for suffix in SUFFIXES:
            assert b"a secret" not in sqlite_files.beside(file, suffix).read_bytes()


def test_without_room_it_is_not_opened(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite would end the process by SIGBUS where blocks are small."""
    monkeypatch.setattr(sqlite_files, "MIN_ROOM", 2**62)
    with pytest.raises(ServiceError, match="the disk is full"):
        opened(file)
