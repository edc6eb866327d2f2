"""The store: a killed process loses nothing that was accepted, damage and strangers are told apart, disks fill up; and
the pictures below floors."""

from __future__ import annotations

import io
import math
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from PIL import Image

from robocorba.errors.maps import InvalidElement, MapFileError, UnknownElement, VersionUnavailable
from robocorba.errors.services import AlreadyRunning
from robocorba.map_editor import underlay_table
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building, Floor
from robocorba.map_editor.store import FIRST_VERSION, MapLimits, MapStore
from robocorba.map_editor.underlays import MAX_PICTURE_BYTES, MAX_SIDE_PX, Underlay
from testkit.buildings import grid
from tests.map_editor.elements import FLOOR, wall

L1 = "L1"


def test_a_store_is_made_once(file: Path, building: Building) -> None:
    MapStore.create(file, building).close()
    with pytest.raises(MapFileError, match="there is such a file already"):
        MapStore.create(file, Building("other"))
    with MapStore(file) as store:
        stored = store.load()
    assert (stored.building, stored.version) == (building, FIRST_VERSION)
    assert {version for group in stored.versions.values() for version in group.values()} == {FIRST_VERSION}
    assert list(stored.building.floors) == ["L1", "L2"]


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
    strange = tmp_path / "strange"
    _sqlite(strange, "CREATE TABLE building (name TEXT)")
    for content in (b"", b"\x89PNG\r\n\x1a\n" * 1000, b"x", strange.read_bytes()):
        strange.write_bytes(content)
        with pytest.raises(MapFileError, match="not a"):
            MapStore(strange)
        assert strange.read_bytes() == content
    Path(f"{file}.new").write_bytes(b"half a store")
    with MapStore.create(tmp_path / "deleted.db", grid(10, 0)) as store:
        BuildingEditor(store).create("L0", wall("a", -3.0))
        Path(f"{file}-wal").write_bytes((tmp_path / "deleted.db-wal").read_bytes())
    with MapStore.create(file, building) as store:
        assert store.load().building == building
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
    content = file.read_bytes()
    file.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    with pytest.raises(MapFileError, match=r"damaged|malformed"):
        MapStore(file)


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
        with pytest.raises(VersionUnavailable, match="outside the kept history 3 to 5"):
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
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import ElementKind, Wall
from robocorba.map_editor.store import MapStore

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


def test_the_lock_holds_and_kill_9_in_the_middle_of_edits_loses_none(file: Path, building: Building) -> None:
    MapStore.create(file, building).close()
    for turn in range(3):
        with subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(file), str(turn)], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "ready\n"
            accepted = [int(writer.stdout.readline()) for _ in range(8 + turn)]
            with pytest.raises(AlreadyRunning, match=r"map\.db is in use"):
                MapStore(file)
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


def picture(kind: str = "PNG", size: tuple[int, int] = (8, 6), **options: bool) -> bytes:
    buffer = io.BytesIO()
    Image.new("L", size, 200).save(buffer, kind, **options)
    return buffer.getvalue()


PLAN = Underlay(picture(), (-1.5, 2.0), 0.05)


def test_an_underlay_is_no_edit_and_outlives_the_process(file: Path, building: Building) -> None:
    photo = Underlay(picture("JPEG", (300, 200)), (0.0, 0.0), 0.01)
    with MapStore.create(file, building) as store:
        editor = BuildingEditor(store)
        assert editor.underlay("L1") is None
        editor.set_underlay("L1", photo)
        editor.set_underlay("L1", PLAN)
        editor.set_underlay("L2", photo)
        assert (editor.version, editor.building) == (1, building)
    with MapStore(file) as store:
        editor = BuildingEditor(store)
        assert (editor.underlay("L1"), editor.underlay("L2")) == (PLAN, photo)
        editor.set_underlay("L2", None)
        assert editor.underlay("L2") is None


@pytest.mark.parametrize(
    ("underlay", "reason"),
    [
        (PLAN._replace(picture=b"GIF89a" + bytes(100)), "no PNG or JPEG that can be read"),
        (PLAN._replace(picture=picture("JPEG", (600, 400))[:-900]), "no PNG or JPEG that can be read"),
        (PLAN._replace(picture=picture(size=(MAX_SIDE_PX + 1, 1))), "12001 x 1 pixels, at most 12000 a side"),
        (
            PLAN._replace(picture=picture("JPEG", (4001, 4000), progressive=True)),
            "16 million are allowed: save it without",
        ),
        (PLAN._replace(picture=bytes(MAX_PICTURE_BYTES + 1)), "at most 8388608 are allowed"),
        (PLAN._replace(origin=(math.nan, 0.0)), "the x of its corner must be a number"),
        (PLAN._replace(origin=(0.0, math.inf)), "the y of its corner must be a number"),
        (PLAN._replace(resolution=math.nan), "its resolution must be from"),
        (PLAN._replace(resolution=0.0), "its resolution must be from"),
    ],
)
def test_what_is_no_underlay_is_refused(editor: BuildingEditor, underlay: Underlay, reason: str) -> None:
    with pytest.raises(InvalidElement, match=f"floor 'L1': its picture: .*{reason}"):
        editor.set_underlay("L1", underlay)
    assert editor.underlay("L1") is None


def test_the_picture_of_a_removed_floor_comes_back_with_an_undo_only_and_goes_with_the_journal(store: MapStore) -> None:
    editor, floor = BuildingEditor(store, MapLimits(commits=3)), Floor(name="L3", level=3, elevation=8.0)
    made = editor.create("", floor)
    editor.set_underlay("L3", PLAN)
    removed = editor.remove(FLOOR, "", "L3", made)
    for call in (lambda: editor.underlay("L3"), lambda: editor.set_underlay("L3", PLAN)):
        with pytest.raises(UnknownElement):
            call()
    again = editor.undo(removed)
    assert editor.underlay("L3") == PLAN
    editor.remove(FLOOR, "", "L3", again)
    editor.create("", msgspec.structs.replace(floor, height=4.0))
    assert editor.underlay("L3") is None
    editor.set_underlay("L3", PLAN)
    editor.remove(FLOOR, "", "L3", editor.version)
    count = "SELECT count(*) FROM underlays"
    for name, kept in (("a", 1), ("b", 1), ("c", 0)):
        editor.create("L1", wall(name))
        assert store._writer.execute(count).fetchone() == (kept,), name


def test_all_pictures_are_bounded_and_each_follows_its_floor(
    editor: BuildingEditor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(underlay_table, "MAX_TOTAL_BYTES", len(PLAN.picture))
    editor.set_underlay("L1", PLAN)
    editor.set_underlay("L1", PLAN)
    with pytest.raises(InvalidElement, match="the pictures of all floors together"):
        editor.set_underlay("L2", PLAN)
    renamed = editor.rename(FLOOR, "", "L1", "lobby", 1)
    assert editor.underlay("lobby") == PLAN
    editor.undo(renamed)
    assert editor.underlay("L1") == PLAN


def test_a_store_of_an_earlier_release(file: Path, building: Building) -> None:
    with MapStore.create(file, building) as store:
        BuildingEditor(store).create("L1", wall("a"))
    old = sqlite3.connect(file)
    for table in ("edits", "underlays"):
        old.execute(f"DROP TABLE {table}")
    old.commit()
    old.close()
    with MapStore(file) as store:
        editor = BuildingEditor(store, wall_clock=lambda: 5.0)
        EditSessions(editor).open("Ada").create("L1", wall("b"))
        editor.set_underlay("L1", PLAN)
    with MapStore(file) as store:
        editor = BuildingEditor(store)
        assert [tuple(edit) for edit in editor.edits_since(1)] == [
            (2, "", 0.0, 1, "1 changes"),
            (3, "Ada", 5.0, 1, "wall b on L1 created"),
        ]
        assert editor.underlay("L1") == PLAN
