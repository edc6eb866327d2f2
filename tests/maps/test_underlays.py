"""Pictures below floors: only pictures, beside the map, following their floors."""

from __future__ import annotations

import io
import math
import sqlite3
from pathlib import Path

import msgspec
import pytest
from PIL import Image

from robocorba.errors.maps import InvalidElement, UnknownElement
from robocorba.maps import underlay_table
from robocorba.maps.edit_session import EditSessions
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Building, ElementKind, Floor, Wall
from robocorba.maps.store import MapLimits, MapStore
from robocorba.maps.underlays import MAX_PICTURE_BYTES, MAX_SIDE_PX, Underlay, check_underlay

FLOOR = ElementKind.FLOOR


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


def test_an_underlay_of_no_floor(editor: BuildingEditor) -> None:
    for call in (lambda: editor.underlay("L9"), lambda: editor.set_underlay("L9", PLAN)):
        with pytest.raises(UnknownElement):
            call()


@pytest.mark.parametrize(
    ("underlay", "reason"),
    [
        (PLAN._replace(picture=b"GIF89a" + bytes(100)), "no PNG or JPEG that can be read"),
        (PLAN._replace(picture=picture()[:-20]), "no PNG or JPEG that can be read"),
        (PLAN._replace(picture=picture("JPEG", (600, 400))[:-900]), "no PNG or JPEG that can be read"),
        (PLAN._replace(picture=picture("GIF")), "no PNG or JPEG that can be read"),
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


def test_a_large_picture_is_checked() -> None:
    check_underlay("L1", PLAN._replace(picture=picture(size=(MAX_SIDE_PX, 6000))))
    check_underlay("L1", PLAN._replace(picture=picture("JPEG", (4000, 4000), progressive=True)))
    check_underlay("L1", PLAN._replace(picture=picture("JPEG", (4001, 4000))))


def test_an_underlay_follows_its_floor(editor: BuildingEditor) -> None:
    editor.set_underlay("L1", PLAN)
    renamed = editor.rename(FLOOR, "", "L1", "lobby", 1)
    assert editor.underlay("lobby") == PLAN
    editor.undo(renamed)
    assert editor.underlay("L1") == PLAN
    editor.redo(editor.version)
    assert editor.underlay("lobby") == PLAN


def test_the_picture_of_a_removed_floor_comes_back_with_an_undo_only(editor: BuildingEditor) -> None:
    floor = Floor(name="L3", level=3, elevation=8.0)
    made = editor.create("", floor)
    editor.set_underlay("L3", PLAN)
    removed = editor.remove(FLOOR, "", "L3", made)
    with pytest.raises(UnknownElement):
        editor.underlay("L3")
    again = editor.undo(removed)
    assert editor.underlay("L3") == PLAN
    editor.remove(FLOOR, "", "L3", again)
    editor.create("", msgspec.structs.replace(floor, height=4.0))
    assert editor.underlay("L3") is None


def test_pictures_of_removed_floors_go_with_the_journal(store: MapStore) -> None:
    editor = BuildingEditor(store, MapLimits(commits=2))
    made = editor.create("", Floor(name="L3", level=3, elevation=8.0))
    editor.set_underlay("L3", PLAN)
    editor.remove(FLOOR, "", "L3", made)
    count = "SELECT count(*) FROM underlays"
    assert store._writer.execute(count).fetchone() == (1,)
    for name in "abc":
        editor.create("L1", Wall(name=name, a=(2.0, 1.0), b=(2.0, 2.0)))
    assert store._writer.execute(count).fetchone() == (0,)


def test_all_pictures_together_are_bounded(editor: BuildingEditor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(underlay_table, "MAX_TOTAL_BYTES", len(PLAN.picture))
    editor.set_underlay("L1", PLAN)
    editor.set_underlay("L1", PLAN)
    with pytest.raises(InvalidElement, match="the pictures of all floors together"):
        editor.set_underlay("L2", PLAN)
    assert editor.underlay("L1") == PLAN


def test_a_store_of_an_earlier_release(file: Path, building: Building) -> None:
    with MapStore.create(file, building) as store:
        BuildingEditor(store).create("L1", Wall(name="a", a=(2.0, 1.0), b=(2.0, 2.0)))
    old = sqlite3.connect(file)
    for table in ("edits", "underlays"):
        old.execute(f"DROP TABLE {table}")
    old.commit()
    old.close()
    with MapStore(file) as store:
        editor = BuildingEditor(store, wall_clock=lambda: 5.0)
        EditSessions(editor).open("Ada").create("L1", Wall(name="b", a=(2.0, 1.0), b=(2.0, 2.0)))
        editor.set_underlay("L1", PLAN)
    with MapStore(file) as store:
        editor = BuildingEditor(store)
        assert [tuple(edit) for edit in editor.edits_since(1)] == [
            (2, "", 0.0, 1, "1 changes"),
            (3, "Ada", 5.0, 1, "wall b on L1 created"),
        ]
        assert editor.underlay("L1") == PLAN
