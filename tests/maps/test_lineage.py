"""What has been renamed stays what it is, however that was done; what was removed and added in two edits does not."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from robocorba.maps.changes import ChangeKind
from robocorba.maps.edits import MapChange
from robocorba.maps.lineage import Lineage
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import BoxShape, ElementKind, Elevator, ElevatorDoor, Floor, MapObject
from robocorba.maps.transactions import Transaction

FLOOR, OBJECT, ELEVATOR = ElementKind.FLOOR, ElementKind.OBJECT, ElementKind.ELEVATOR
CHAIR = MapObject("chair", BoxShape((0.4, 0.4)), (2.5, 3.5), movable=True)


@pytest.fixture
def since(editor: BuildingEditor) -> int:
    """The version of the earlier map, which has a chair on L1."""
    return editor.create("L1", CHAIR)


def lineage(editor: BuildingEditor, since: int) -> Lineage:
    changes = editor.changes_since(since)
    return Lineage(MapChange(each.version, each.kind, each.floor, each.element) for each in changes)


def in_one_edit(editor: BuildingEditor, *operations: Callable[[Transaction], object]) -> None:
    transaction = editor.begin()
    for operation in operations:
        operation(transaction)
    transaction.commit()


def test_without_changes_elements_go_by_their_names() -> None:
    assert Lineage().origin(OBJECT, "L1", "chair") == (OBJECT, "L1", "chair")
    assert Lineage().floors(["L1", "L2"]) == {"L1": "L1", "L2": "L2"}


def test_a_renamed_object_is_followed_over_further_edits(editor: BuildingEditor, since: int) -> None:
    renamed = editor.rename(OBJECT, "L1", "chair", "stool", since)
    editor.change("L1", msgspec.structs.replace(CHAIR, name="stool", height=2.0), renamed)
    again = editor.rename(OBJECT, "L1", "stool", "seat", editor.version)
    found = lineage(editor, since)
    assert found.origin(OBJECT, "L1", "seat") == (OBJECT, "L1", "chair")
    editor.undo(again)
    assert lineage(editor, since).origin(OBJECT, "L1", "stool") == (OBJECT, "L1", "chair")


def test_an_object_that_was_removed_is_another_one_than_its_successor(editor: BuildingEditor, since: int) -> None:
    editor.remove(OBJECT, "L1", "chair", since)
    editor.create("L1", CHAIR)
    assert lineage(editor, since).origin(OBJECT, "L1", "chair") is None


def test_an_equal_object_in_the_same_edit_is_the_same(editor: BuildingEditor, since: int) -> None:
    in_one_edit(
        editor,
        lambda edit: edit.remove(OBJECT, "L1", "chair", since),
        lambda edit: edit.create("L1", msgspec.structs.replace(CHAIR, name="stool")),
        lambda edit: edit.create("L1", msgspec.structs.replace(CHAIR, name="other", at=(1.0, 1.0))),
    )
    found = lineage(editor, since)
    assert found.origin(OBJECT, "L1", "stool") == (OBJECT, "L1", "chair")
    assert found.origin(OBJECT, "L1", "other") is None


def test_a_renamed_floor_takes_its_objects_along(editor: BuildingEditor, since: int) -> None:
    editor.rename(FLOOR, "", "L1", "lobby", editor.read(FLOOR, "", "L1")[1])
    editor.rename(OBJECT, "lobby", "chair", "stool", editor.version)
    found = lineage(editor, since)
    assert found.floors(editor.building.floors) == {"L1": "lobby", "L2": "L2"}
    assert found.origin(OBJECT, "lobby", "stool") == (OBJECT, "L1", "chair")
    assert found.origin(ELEVATOR, "", "E1") == (ELEVATOR, "", "E1")


def test_floors_may_exchange_their_names(editor: BuildingEditor, since: int) -> None:
    for before, after in (("L1", "x"), ("L2", "L1"), ("x", "L2")):
        editor.rename(FLOOR, "", before, after, editor.read(FLOOR, "", before)[1])
    found = lineage(editor, since)
    assert found.floors(editor.building.floors) == {"L1": "L2", "L2": "L1"}
    assert found.origin(OBJECT, "L2", "chair") == (OBJECT, "L1", "chair")


def test_an_elevator_is_the_same_if_a_floor_gets_another_name_in_the_same_edit() -> None:
    doors = {name: (ElevatorDoor(name), ElevatorDoor("L2")) for name in ("L1", "lobby")}
    edit = [
        (ChangeKind.REMOVED, Elevator("E1", (0.0, 0.0), (2.0, 2.0), doors["L1"])),
        (ChangeKind.REMOVED, Floor("L1", 1, 0.0)),
        (ChangeKind.CREATED, Floor("lobby", 1, 0.0)),
        (ChangeKind.CREATED, Elevator("lift", (0.0, 0.0), (2.0, 2.0), doors["lobby"])),
    ]
    found = Lineage(MapChange(2, kind, "", element) for kind, element in edit)
    assert found.origin(ELEVATOR, "", "lift") == (ELEVATOR, "", "E1")


def test_a_new_floor_has_no_origin(editor: BuildingEditor, since: int) -> None:
    editor.create("", Floor("L3", 3, 8.0))
    assert lineage(editor, since).floors(editor.building.floors) == {"L1": "L1", "L2": "L2"}
