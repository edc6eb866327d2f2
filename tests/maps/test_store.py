"""The store: a killed process loses nothing that was accepted, damage and strangers are told apart, disks fill up."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from robocorba.errors.maps import MapFileError
from robocorba.errors.services import AlreadyRunning
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Building
from robocorba.maps.store import FIRST_VERSION, MapLimits, MapStore
from robocorba.testing.buildings import grid
from tests.maps.elements import wall

L1 = "L1"


def test_a_store_is_made_once(file: Path, building: Building) -> None:
    MapStore.create(file, building).close()
    with pytest.raises(MapFileError, match="there is such a file already"):
        MapStore.create(file, Building("other"))
    with MapStore(file) as store:
        stored = store.load()
    assert (stored.building, stored.version) == (building, FIRST_VERSION)
    assert set(stored.versions.values()) == {FIRST_VERSION}
    assert list(stored.building.floors) == ["L1", "L2"]


def test_the_lock_of_a_living_process_holds(file: Path, building: Building) -> None:
    MapStore.create(file, building).close()
    code = "import sys; from robocorba.maps.store import *; s = MapStore(sys.argv[1]); print(1, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "1\n"
        with pytest.raises(AlreadyRunning, match=r"map\.db is in use"):
            MapStore(file)
        other.kill()
        other.wait()
        MapStore(file).close()


def _sqlite(path: Path, *statements: str) -> None:
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def test_strange_and_damaged_files(file: Path, building: Building, tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="there is no map store"):
        MapStore(file)
    with pytest.raises(MapFileError, match="No such file or directory"):
        MapStore.create(tmp_path / "no" / "map.db", building)
    for content in (b"", b"\x89PNG\r\n\x1a\n" * 1000, b"x"):
        strange = tmp_path / "strange"
        strange.write_bytes(content)
        with pytest.raises(MapFileError, match="not a"):
            MapStore(strange)
        assert strange.read_bytes() == content
    foreign = tmp_path / "foreign.db"
    _sqlite(foreign, "CREATE TABLE building (name TEXT)")
    with pytest.raises(MapFileError, match="not a map store of RoboCorba"):
        MapStore(foreign)
    MapStore.create(file, building).close()
    _sqlite(file, "PRAGMA user_version = 99")
    with pytest.raises(MapFileError, match="its schema is version 99, this release reads 1"):
        MapStore(file)


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("UPDATE elements SET value = '{' WHERE name = 'w'", "damaged"),
        ("UPDATE elements SET value = '{\"name\": 1}' WHERE name = 'w'", "damaged"),
        ("UPDATE elements SET kind = 'cow' WHERE name = 'w'", "damaged"),
        ("UPDATE elements SET floor = 'L9' WHERE name = 'w'", "'L9', which is no floor"),
        ("DELETE FROM building", "it holds no building"),
        ("DROP TABLE elements", "no such table"),
    ],
)
def test_damaged_content(file: Path, building: Building, statement: str, reason: str) -> None:
    MapStore.create(file, building).close()
    _sqlite(file, statement)
    with MapStore(file) as store, pytest.raises(MapFileError, match=reason):
        store.load()


def test_damaged_pages(file: Path) -> None:
    MapStore.create(file, grid(20, 0)).close()
    content = bytearray(file.read_bytes())
    content[4096 : 4096 * 4] = b"\xff" * 4096 * 3
    file.write_bytes(content)
    with pytest.raises(MapFileError, match=r"damaged|malformed"):
        MapStore(file)


def test_leftovers_of_a_crash_and_of_a_deleted_store_do_no_harm(file: Path, building: Building) -> None:
    with MapStore.create(file, grid(10, 0)) as store:
        editor = BuildingEditor(store)
        editor.create("L0", wall("a", -3.0))
        log = Path(f"{file}-wal").read_bytes()
    file.unlink()
    Path(f"{file}-wal").write_bytes(log)
    Path(f"{file}.new").write_bytes(b"half a store")
    with MapStore.create(file, building) as store:
        assert store.load().building == building


def test_a_full_disk_refuses_the_edit_and_changes_nothing(file: Path, building: Building) -> None:
    with MapStore.create(file, building) as store:
        editor = BuildingEditor(store)
        editor.create(L1, wall("a"))
        before, heard = editor.building, []
        editor.subscribe(lambda *event: heard.append(event))
        pages = store._writer.execute("PRAGMA page_count").fetchone()[0]
        store._writer.execute(f"PRAGMA max_page_count = {pages}")
        change = editor.begin()
        for number in range(500):
            change.create(L1, wall(f"b{number}"))
        with pytest.raises(MapFileError, match="database or disk is full"):
            change.commit()
        assert (editor.building, editor.version, heard) == (before, 2, [])
        assert editor.changes_since(1)[-1].key.name == "a"
        store._writer.execute("PRAGMA max_page_count = 1000000")
        assert editor.create(L1, wall("c")) == 3
    with MapStore(file) as store:
        assert set(store.load().building.floors[L1].geometrical.walls) == {"w", "a", "c"}


def test_the_journal_is_bounded_by_what_it_holds(file: Path, building: Building) -> None:
    with MapStore.create(file, building) as store:
        editor = BuildingEditor(store, MapLimits(journal_changes=10))
        for batch in range(4):
            change = editor.begin()
            for number in range(4):
                change.create(L1, wall(f"{batch}.{number}"))
            change.commit()
        assert len(editor.changes_since(3)) == 8
        with pytest.raises(Exception, match="outside the kept history 3 to 5"):
            editor.changes_since(2)
        change = editor.begin()
        for number in range(20):
            change.create(L1, wall(f"many{number}"))
        change.commit()
        assert len(editor.changes_since(5)) == 20
        editor.undo(6)
    with MapStore(file) as store:
        assert len(BuildingEditor(store).building.floors[L1].geometrical.walls) == 17


_WRITER = """
import sys
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import ElementKind, Wall
from robocorba.maps.store import MapStore

editor = BuildingEditor(MapStore(sys.argv[1]))
print("ready", flush=True)
number = 0
while True:
    number += 1
    change = editor.begin()
    for part in "abcd":
        change.create("L1", Wall(name=f"{sys.argv[2]}.{number}.{part}", a=(2.0, 1.0), b=(2.0, 2.0)))
    print(change.commit(), flush=True)
    if number % 5 == 0:
        print(editor.undo(editor.version), flush=True)
"""


def test_kill_9_in_the_middle_of_edits(file: Path, building: Building) -> None:
    MapStore.create(file, building).close()
    for turn in range(3):
        with subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(file), str(turn)], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "ready\n"
            accepted = [int(writer.stdout.readline()) for _ in range(8 + turn)]
            os.kill(writer.pid, signal.SIGKILL)
            accepted += [int(line) for line in writer.stdout.read().split("\n")[:-1]]
            writer.wait()
        assert accepted == list(range(accepted[0], accepted[-1] + 1))
        with MapStore(file) as store:
            editor = BuildingEditor(store)
            # An edit may be on disk that the process did not live to report, but none is missing or half there.
            assert accepted[-1] <= editor.version <= accepted[-1] + 1
            journal = editor.changes_since(FIRST_VERSION)
            assert [change.version for change in journal] == [v for v in range(2, editor.version + 1) for _ in "abcd"]
            there = {change.key.name: change.after for change in journal}
            walls = editor.building.floors[L1].geometrical.walls
            assert set(walls) == {"w"} | {name for name, after in there.items() if after is not None}
            assert len(walls) % 4 == 1
