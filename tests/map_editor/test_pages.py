"""What readers of a building get: copies in pages, also while it is edited; which element is which after renamings; one
long request at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest

from robocorba.errors.maps import ServerBusy, VersionUnavailable
from robocorba.map_editor import pages
from robocorba.map_editor.changes import ChangeKind, elements_of
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.long_requests import LongRequests
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathNode,
)
from robocorba.map_editor.pages import (
    EVERYTHING,
    ChangePage,
    ChangePosition,
    Selection,
    building_of,
    size_of_copy,
    with_changes_of,
)
from robocorba.map_editor.store import MapLimits, MapStore
from tests.map_editor.elements import ELEVATOR, FLOOR, WALL, wall


@pytest.fixture
def editor(store: MapStore) -> BuildingEditor:
    return BuildingEditor(store, MapLimits(commits=7))


def nodes(editor: BuildingEditor, count: int, floor: str = "L2") -> int:
    """One edit of many nodes."""
    transaction = editor.begin()
    for number in range(count):
        transaction.create(floor, PathNode(name=f"n{number}", at=(float(number), 50.0)))
    return transaction.commit()


def changes_from(
    editor: BuildingEditor, start: ChangePosition, part: Selection = EVERYTHING, limit: int = 2
) -> Iterator[ChangePage]:
    while True:
        page = editor.change_page(start, part, limit)
        yield page
        if page.is_last:
            return
        start = page.next


def map_changes(found: Iterator[ChangePage]) -> list[MapChange]:
    return [
        MapChange(change.version, change.kind, change.floor, change.element)
        for page in found
        for change in page.changes
    ]


def loaded(
    editor: BuildingEditor, limit: int, part: Selection = EVERYTHING, meanwhile: Callable[[int], Any] = int
) -> Building:
    """A copy, as clients make it; meanwhile: called after each page."""
    found, start, read_at, is_last = [], 0, 0, False
    while not is_last:
        page = editor.element_page(start, part, limit)
        assert len(page.elements) <= limit
        read_at = read_at or page.read_at
        found += [(floor, element) for floor, element, _ in page.elements]
        start, is_last = page.next, page.is_last
        meanwhile(start)
    changes = map_changes(changes_from(editor, ChangePosition(read_at), part))
    copy = with_changes_of(building_of(editor.building.name, found), changes)
    assert with_changes_of(copy, changes) == copy  # repeated changes change nothing
    return copy


@pytest.mark.parametrize("limit", [1, 3, 5000])
def test_a_building_is_read_in_pages_also_while_it_is_edited(editor: BuildingEditor, limit: int) -> None:
    assert loaded(editor, limit) == editor.building
    assert size_of_copy(editor.building) == sum(1 for _ in elements_of(editor.building))
    edits = iter(
        [
            lambda: editor.create("L1", wall("a")),
            lambda: (editor.create("", Floor(name="L9", level=9, elevation=40.0)), editor.create("L9", wall("on top"))),
            lambda: editor.remove(FLOOR, "", "L9", editor.read(FLOOR, "", "L9")[1]),
            lambda: (editor.create("", Floor(name="L9", level=9, elevation=50.0)), editor.create("L9", wall("b"))),
            lambda: editor.remove(WALL, "L1", "w", editor.read(WALL, "L1", "w")[1]),
        ]
    )
    assert loaded(editor, limit, meanwhile=lambda start: next(edits, int)()) == editor.building
    copy = loaded(editor, limit, Selection((FLOOR, WALL), "L1"))
    assert list(copy.floors) == list(editor.building.floors)
    walls = copy.floors["L1"].geometrical.walls
    assert walls == editor.building.floors["L1"].geometrical.walls and "a" in walls
    assert size_of_copy(copy) == len(copy.floors) + len(walls)


def test_changes_come_in_pages_that_end_anywhere_in_an_edit(editor: BuildingEditor) -> None:
    began = editor.version
    editor.create("L1", wall("first"))
    last = nodes(editor, 5)
    found = list(changes_from(editor, ChangePosition(began)))
    assert [len(page.changes) for page in found] == [2, 2, 2]
    assert [page.next for page in found] == [(began + 1, 1), (began + 1, 3), (last, 0)]
    assert [page.left for page in found] == [4, 2, 0]
    assert [change for page in found for change in page.changes] == editor.changes_since(began)
    page = editor.change_page(ChangePosition(last))
    assert page == ChangePage([], ChangePosition(last), True, 0)
    editor.create("L2", wall("elsewhere"))
    page = editor.change_page(ChangePosition(began), Selection((FLOOR, WALL), "L1"), 1)
    assert ([change.key.name for change in page.changes], page.is_last) == (["first"], True)
    assert page.next == (editor.version, 0)


def test_a_page_is_small_however_large_its_elements(editor: BuildingEditor, monkeypatch: pytest.MonkeyPatch) -> None:
    began = editor.version
    for name in "abc":
        polygon = tuple((float(x), float(y) + 30) for y, x in ((0, 0), (0, 20), (10, 20), (10, 0)))
        editor.create("L2", Area(name=name, polygon=polygon))
    monkeypatch.setattr("robocorba.map_editor.store.MAX_PAGE_LENGTH", 100)
    assert [len(page.changes) for page in changes_from(editor, ChangePosition(began), limit=5)] == [1, 1, 1]
    assert loaded(editor, pages.MAX_PAGE) == editor.building


def test_positions_that_do_not_exist(editor: BuildingEditor) -> None:
    began = editor.version
    for number in range(8):
        editor.create("L1", wall(f"w{number}"))
    for since in (began, 0, editor.version + 1, 2**64 - 1):
        with pytest.raises(VersionUnavailable):
            editor.change_page(ChangePosition(since))
    beyond = editor.change_page(ChangePosition(editor.version, 2**32 - 1))
    assert beyond == ChangePage([], ChangePosition(editor.version), True, 0)
    assert editor.element_page(2**64 - 1) == (editor.version, [], 0, True)
    assert editor.element_page(0, Selection((), "no floor")).elements[0][0] == ""


OBJECT = ElementKind.OBJECT
CHAIR = MapObject("chair", BoxShape((0.4, 0.4)), (2.5, 3.5), movable=True)


@pytest.fixture
def since(editor: BuildingEditor) -> int:
    """The version of the earlier map, which has a chair on L1."""
    return editor.create("L1", CHAIR)


def lineage(editor: BuildingEditor, since: int) -> Lineage:
    changes = editor.changes_since(since)
    return Lineage(MapChange(each.version, each.kind, each.floor, each.element) for each in changes)


def test_a_renamed_object_is_followed_over_further_edits(editor: BuildingEditor, since: int) -> None:
    renamed = editor.rename(OBJECT, "L1", "chair", "stool", since)
    editor.change("L1", msgspec.structs.replace(CHAIR, name="stool", height=2.0), renamed)
    editor.rename(FLOOR, "", "L1", "lobby", editor.read(FLOOR, "", "L1")[1])
    again = editor.rename(OBJECT, "lobby", "stool", "seat", editor.version)
    found = lineage(editor, since)
    assert found.floors(editor.building.floors) == {"L1": "lobby", "L2": "L2"}
    assert found.origin(OBJECT, "lobby", "seat") == (OBJECT, "L1", "chair")
    assert found.origin(ELEVATOR, "", "E1") == (ELEVATOR, "", "E1")
    editor.undo(again)
    assert lineage(editor, since).origin(OBJECT, "lobby", "stool") == (OBJECT, "L1", "chair")


def test_an_object_that_was_removed_is_another_one_than_its_successor(editor: BuildingEditor, since: int) -> None:
    assert Lineage().origin(OBJECT, "L1", "chair") == (OBJECT, "L1", "chair")  # without changes
    assert Lineage().floors(["L1", "L2"]) == {"L1": "L1", "L2": "L2"}
    editor.remove(OBJECT, "L1", "chair", since)
    editor.create("L1", CHAIR)
    editor.create("", Floor("L3", 3, 8.0))
    assert lineage(editor, since).floors(editor.building.floors) == {"L1": "L1", "L2": "L2"}
    assert lineage(editor, since).origin(OBJECT, "L1", "chair") is None


def test_an_equal_object_in_the_same_edit_is_the_same(editor: BuildingEditor, since: int) -> None:
    transaction = editor.begin()
    transaction.remove(OBJECT, "L1", "chair", since)
    transaction.create("L1", msgspec.structs.replace(CHAIR, name="stool"))
    transaction.create("L1", msgspec.structs.replace(CHAIR, name="other", at=(1.0, 1.0)))
    transaction.commit()
    found = lineage(editor, since)
    assert found.origin(OBJECT, "L1", "stool") == (OBJECT, "L1", "chair")
    assert found.origin(OBJECT, "L1", "other") is None


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


@pytest.mark.parametrize(
    ("wait_limit_s", "max_waiting", "reason"), [(0.0, 1, "took more than 0 s"), (30.0, 0, "too many")]
)
def test_requests_that_would_wait_too_long_are_refused(wait_limit_s: float, max_waiting: int, reason: str) -> None:
    requests = LongRequests(wait_limit_s=wait_limit_s, max_waiting=max_waiting)
    for _ in range(2):
        with requests.admitted(), pytest.raises(ServerBusy, match=reason), requests.admitted():
            pass
