"""What readers of a building get: copies in pages, also while it is edited; which element is which after renamings; one
long request at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocorba.errors.maps import ServerBusy, VersionUnavailable
from robocorba.map_editor import pages
from robocorba.map_editor.changes import elements_of
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.long_requests import LongRequests
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Area, BoxShape, Building, Floor, MapObject
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
from tests.map_editor.elements import FLOOR, WALL, wall


@pytest.fixture
def editor(store: MapStore) -> BuildingEditor:
    return BuildingEditor(store, MapLimits(commits=7))


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


CHAIR = MapObject("chair", BoxShape((0.4, 0.4)), (2.5, 3.5), movable=True)


@pytest.fixture
def since(editor: BuildingEditor) -> int:
    """The version of the earlier map, which has a chair on L1."""
    return editor.create("L1", CHAIR)


def lineage(editor: BuildingEditor, since: int) -> Lineage:
    changes = editor.changes_since(since)
    return Lineage(MapChange(each.version, each.kind, each.floor, each.element) for each in changes)


@pytest.mark.parametrize(
    ("wait_limit_s", "max_waiting", "reason"), [(0.0, 1, "took more than 0 s"), (30.0, 0, "too many")]
)
def test_requests_that_would_wait_too_long_are_refused(wait_limit_s: float, max_waiting: int, reason: str) -> None:
    requests = LongRequests(wait_limit_s=wait_limit_s, max_waiting=max_waiting)
    for _ in range(2):
        with requests.admitted(), pytest.raises(ServerBusy, match=reason), requests.admitted():
            pass
