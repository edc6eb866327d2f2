"""Copies of a building that are read in pages, also while it is edited."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocorba.errors.maps import InvalidElement, VersionUnavailable
from robocorba.maps import pages
from robocorba.maps.edits import MapChange
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Area, Building, ElementKind, Floor, PathNode, Wall
from robocorba.maps.pages import (
    EVERYTHING,
    ChangePage,
    ChangePosition,
    Selection,
    building_of,
    size_of_copy,
    with_changes_of,
)
from robocorba.maps.store import MapLimits, MapStore
from robocorba.testing.buildings import two_floors

FLOOR, WALL, NODE = ElementKind.FLOOR, ElementKind.WALL, ElementKind.NODE


@pytest.fixture
def editor(tmp_path: Path) -> Iterator[BuildingEditor]:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        yield BuildingEditor(store, MapLimits(commits=6))


def wall(name: str, x: float = 0.0) -> Wall:
    return Wall(name=name, a=(x, 20.0), b=(x, 21.0))


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
        found += [(each.floor, each.element) for each in page.elements]
        start, is_last = page.next, page.is_last
        meanwhile(start)
    copy = building_of(editor.building.name, found)
    return with_changes_of(copy, map_changes(changes_from(editor, ChangePosition(read_at), part)))


@pytest.mark.parametrize("limit", [1, 3, 5000])
def test_a_building_is_read_in_pages(editor: BuildingEditor, limit: int) -> None:
    assert loaded(editor, limit) == editor.building
    assert size_of_copy(editor.building) == sum(
        len(editor.building.elements(kind, floor))
        for kind in ElementKind
        for floor in ([""] if kind in (FLOOR, ElementKind.ELEVATOR) else editor.building.floors)
    )


def test_what_is_edited_while_it_is_read_is_corrected(editor: BuildingEditor) -> None:
    names = iter("abc")

    def edit(start: int) -> None:
        name = next(names, None)
        if name == "a":
            editor.create("L1", wall("a"))
        elif name == "b":
            editor.create("", Floor(name="L9", level=9, elevation=40.0))
            editor.create("L9", wall("on top"))
        elif name == "c":
            editor.remove(FLOOR, "", "L9", editor.read(FLOOR, "", "L9")[1])
            removed = next(iter(editor.building.floors["L1"].geometrical.walls))
            editor.remove(WALL, "L1", removed, editor.read(WALL, "L1", removed)[1])

    assert loaded(editor, 1, meanwhile=edit) == editor.building
    assert "a" in editor.building.floors["L1"].geometrical.walls


def test_a_part_of_a_building(editor: BuildingEditor) -> None:
    nodes(editor, 3)
    copy = loaded(editor, 2, Selection((FLOOR, WALL), "L1"))
    assert list(copy.floors) == list(editor.building.floors)
    assert copy.floors["L1"].geometrical.walls == editor.building.floors["L1"].geometrical.walls
    assert size_of_copy(copy) == 2 + len(copy.floors["L1"].geometrical.walls)


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


def test_changes_of_other_kinds_are_not_sent(editor: BuildingEditor) -> None:
    began = editor.version
    nodes(editor, 5)
    editor.create("L1", wall("last"))
    editor.create("L2", wall("elsewhere"))
    part = Selection((FLOOR, WALL), "L1")
    page = editor.change_page(ChangePosition(began), part, 1)
    assert [change.key.name for change in page.changes] == ["last"]
    assert page.is_last
    assert page.next == (editor.version, 0)


def test_a_page_is_small_however_large_its_elements(editor: BuildingEditor, monkeypatch: pytest.MonkeyPatch) -> None:
    began = editor.version
    for name in "abc":
        polygon = tuple((float(x), float(y) + 30) for y, x in ((0, 0), (0, 20), (10, 20), (10, 0)))
        editor.create("L2", Area(name=name, polygon=polygon))
    monkeypatch.setattr("robocorba.maps.store.MAX_PAGE_LENGTH", 100)
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
    assert editor.element_page(0, Selection((), "no floor")).elements[0].floor == ""


def test_a_removed_floor_takes_its_elements_along(editor: BuildingEditor) -> None:
    editor.create("", Floor(name="L9", level=9, elevation=40.0))
    copy, began = editor.building, editor.version
    editor.create("L9", wall("a"))
    editor.remove(FLOOR, "", "L9", editor.read(FLOOR, "", "L9")[1])
    editor.create("", Floor(name="L9", level=9, elevation=50.0))
    editor.create("L9", wall("b"))
    found = map_changes(changes_from(editor, ChangePosition(began)))
    assert with_changes_of(copy, found) == editor.building
    assert with_changes_of(editor.building, found) == editor.building  # repeated changes change nothing


def test_a_replacement_brings_at_most_so_much(tmp_path: Path) -> None:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        editor = BuildingEditor(store, MapLimits(replacement_size=2))
        building = editor.building.with_element("L1", wall("a")).with_element("L1", wall("b"))
        too_much = building.with_element("L1", wall("c"))
        with pytest.raises(InvalidElement, match="3 new elements and points, one call may bring 2"):
            editor.replace(too_much, editor.version)
        editor.replace(building, editor.version)
        assert editor.replace(Building(building.name, {}, {}), editor.version)  # removing is not bringing
