"""Operations of the map page, with a building editor in this process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from robocorba.console.arguments import InvalidArguments
from robocorba.console.map_edits import InvalidEdits
from robocorba.console.map_operations import MapOperations
from robocorba.console.map_sessions import NoSession
from robocorba.errors.maps import InvalidElement
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Building, ElementKind
from robocorba.maps.store import MapStore
from robocorba.maps.validation import problems
from robocorba.testing.buildings import two_floors
from tests.console.editor import LocalEditor

Edit = dict[str, Any]


@pytest.fixture
def editor(tmp_path: Path) -> Iterator[LocalEditor]:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        yield LocalEditor(BuildingEditor(store))


@pytest.fixture
def page(editor: LocalEditor) -> Page:
    return Page(editor)


class Page:
    """A tab of the map page."""

    def __init__(self, editor: LocalEditor, author: str = "A.", operations: MapOperations | None = None) -> None:
        self.editor = editor
        self.operations = operations or MapOperations(cast(Any, None), cast(Any, editor))
        self.session = self.operations.map_open(author)["session"]

    @property
    def building(self) -> Building:
        return self.editor.editor.building

    def record(self, kind: str, name: str, floor: str = "L1") -> Edit:
        elements = self.operations.map_floor(floor)["elements"]
        return next(dict(each) for each in elements if (each["kind"], each["name"]) == (kind, name))

    def edit(self, *edits: Edit) -> Edit:
        return self.operations.map_edit(self.session, list(edits))

    def change(self, kind: str, name: str, floor: str = "L1", **members: Any) -> Edit:
        record = self.record(kind, name, floor)
        return {**record, "do": "change", "members": {**record["members"], **members}}

    def remove(self, kind: str, name: str, floor: str = "L1") -> Edit:
        return {**self.record(kind, name, floor), "do": "remove"}


def wall(name: str, *ends: tuple[float, float]) -> Edit:
    return {
        "do": "create",
        "kind": "wall",
        "floor": "L1",
        "name": name,
        "members": {"name": name, "from": ends[0], "to": ends[1]},
    }


def test_a_floor_has_its_elements_and_those_of_the_whole_building(page: Page) -> None:
    answer = page.operations.map_floor("L2")
    found = {(each["kind"], each["floor"], each["name"]) for each in answer["elements"]}
    assert found >= {("floor", "", "L1"), ("floor", "", "L2"), ("elevator", "", "E1"), ("node", "L2", "lift2")}
    assert not [key for key in found if key[1] == "L1"]
    assert (answer["version"], answer["building"]) == (page.editor.version(), "two floors")


def test_an_unknown_floor_has_no_elements_of_its_own(page: Page) -> None:
    assert {each["kind"] for each in page.operations.map_floor("attic")["elements"]} == {"floor", "elevator"}


def test_edits_together_are_one_step_for_undo(page: Page) -> None:
    before = page.building
    answer = page.edit(wall("a", (1, 1), (2, 1)), wall("b", (2, 1), (2, 2)))
    assert answer["version"] == page.editor.version()
    assert page.building.find(ElementKind.WALL, "L1", "b")
    news = page.operations.map_news(page.session, answer["version"] - 1)
    assert [(edit["author"], edit["changes"]) for edit in news["edits"]] == [("A.", 2)]
    assert news["undoable"]
    page.operations.map_undo(page.session)
    assert page.building == before
    page.operations.map_redo(page.session)
    assert page.building.find(ElementKind.WALL, "L1", "a")


def test_undo_leaves_the_edits_of_others(page: Page, editor: LocalEditor) -> None:
    other = Page(editor, "B.", page.operations)
    page.edit(wall("a", (1, 1), (2, 1)))
    other.edit(wall("b", (1, 2), (2, 2)))
    page.operations.map_undo(page.session)
    walls = page.building.floors["L1"].geometrical.walls
    assert ("a" in walls, "b" in walls) == (False, True)
    assert "refused" in page.operations.map_undo(page.session)


def test_the_edges_of_a_removed_node_go_with_it(page: Page) -> None:
    assert "version" in page.edit(page.remove("node", "east"))
    assert set(page.building.floors["L1"].topological.edges) == set()
    assert problems(page.building) == []


def test_a_node_in_a_cabin_is_kept(page: Page) -> None:
    refused = page.edit(page.remove("node", "lift1"))["refused"]
    assert "elevator 'E1' stops at it" in refused["reason"]
    assert page.building.find(ElementKind.NODE, "L1", "lift1")


def test_an_elevator_moves_with_its_nodes(page: Page) -> None:
    assert "version" in page.edit(page.change("elevator", "E1", at=[17.9, 5.0]))
    for floor, name in (("L1", "lift1"), ("L2", "lift2")):
        assert page.building.floors[floor].topological.nodes[name].at == pytest.approx((17.9, 5.0))


def test_a_new_floor_and_elevator_are_valid_at_once(page: Page) -> None:
    floor = {"name": "L3", "level": 3, "elevation": 8.0}
    lift = {"name": "E2", "at": [3, 3], "size": [2, 2], "doors": [{"floor": "L2"}, {"floor": "L3"}]}
    answer = page.edit(
        {"do": "create", "kind": "floor", "floor": "", "name": "L3", "members": floor},
        {"do": "create", "kind": "elevator", "floor": "", "name": "E2", "members": lift},
    )
    assert "version" in answer
    assert page.building.floors["L2"].topological.nodes["cabin-E2"].elevator == "E2"


def test_a_floor_is_removed_with_what_is_on_it(page: Page) -> None:
    assert "version" in page.edit(page.remove("floor", "L2"))
    assert list(page.building.floors) == ["L1"]
    assert page.building.elevators["E1"].floors() == ("L1",)
    page.operations.map_undo(page.session)
    assert page.building == two_floors()


def test_an_element_that_somebody_else_has_changed_is_named(page: Page, editor: LocalEditor) -> None:
    late = page.change("wall", "w", height=3.0)
    Page(editor, "B.", page.operations).edit(page.change("wall", "w", height=2.0))
    assert page.edit(late)["refused"]["stale"] == {"kind": "wall", "floor": "L1", "name": "w"}
    Page(editor, "B.", page.operations).edit(page.remove("wall", "w"))
    assert page.edit(late)["refused"]["stale"]["name"] == "w"


def test_a_taken_name_is_told(page: Page) -> None:
    refused = page.edit(wall("w", (1, 1), (2, 1)))["refused"]
    assert (refused["taken"], refused["stale"]) == (True, None)


def test_a_refused_edit_names_all_problems_with_their_places(page: Page) -> None:
    nodes = [
        {"do": "create", "kind": "node", "floor": "L1", "name": name, "members": {"name": name, "at": [10.0, y]}}
        for name, y in (("p", 1.0), ("q", 2.0))
    ]
    refused = page.edit(*nodes)["refused"]
    assert [(one["name"], one["x"], one["y"]) for one in refused["problems"]] == [("p", 10.0, 1.0), ("q", 10.0, 2.0)]
    assert page.building == two_floors()


def test_a_renamed_node_keeps_its_edges(page: Page) -> None:
    assert "version" in page.edit({**page.record("node", "east"), "do": "rename", "to": "<b>e</b>"})
    assert page.building.floors["L1"].topological.edges["west-east"].b == "<b>e</b>"


@pytest.mark.parametrize(
    "edits",
    [
        None,
        [],
        ["remove"],
        [{"do": "remove"}],
        [{"do": "paint", "kind": "wall", "floor": "L1", "name": "w"}],
        [{"do": "remove", "kind": "roof", "floor": "L1", "name": "w"}],
        [{"do": "remove", "kind": "wall", "floor": "L1", "name": "w", "version": "new"}],
        [{"do": "remove", "kind": "wall", "floor": "L1", "name": "w", "version": float("inf")}],
        [{"do": "remove", "kind": "wall", "floor": "L1", "name": "w", "version": 10**400}],
        [{"do": "remove", "kind": "wall", "floor": "L1\0", "name": "w", "version": 1}],
        [{"do": "remove", "kind": "wall", "floor": "L1", "name": "\ud800", "version": 1}],
        [{**wall("a", (0, 1), (1, 1)), "name": "b"}],
    ],
)
def test_other_requests_are_refused(page: Page, edits: Any) -> None:
    with pytest.raises((InvalidEdits, InvalidElement, InvalidArguments)):
        page.operations.map_edit(page.session, edits)


@pytest.mark.parametrize("place", [None, [], {"floor": "L1"}, {"floor": 3, "x": 1, "y": 1}, {"x": 1, "y": 1}])
@pytest.mark.parametrize("x", [1, "1", None, float("nan"), 10**400])
def test_paths_between_other_things_than_places_are_refused(page: Page, place: Any, x: Any) -> None:
    wrong = {**place, "x": x} if isinstance(place, dict) else place
    with pytest.raises(InvalidArguments):
        page.operations.map_paths({"floor": "L1", "x": 1, "y": 1}, wrong)


def test_a_session_that_the_map_editor_has_ended_is_replaced(page: Page, editor: LocalEditor) -> None:
    editor.sessions[-1].is_closed = True
    answer = page.edit(wall("a", (1, 1), (2, 1)))
    assert "can't be undone any more" in answer["note"]
    assert page.building.find(ElementKind.WALL, "L1", "a")


def test_a_closed_session_is_unknown(page: Page, editor: LocalEditor) -> None:
    page.operations.map_close(page.session)
    page.operations.map_close(page.session)
    assert editor.sessions[-1].is_closed
    with pytest.raises(NoSession):
        page.edit(wall("a", (1, 1), (2, 1)))
