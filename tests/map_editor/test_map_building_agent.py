"""The editor: versions, conflicts, undo, renaming, transactions that take effect together or not at all, and that it
agrees with plain dictionaries."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import pytest

from robocorba.errors.maps import (
    DuplicateElement,
    InvalidElement,
    MapError,
    NothingToRedo,
    NothingToUndo,
    StaleEdit,
    StaleVersion,
    TooManyTransactions,
    TransactionClosed,
    UnknownElement,
    VersionUnavailable,
)
from robocorba.map_editor.changes import elements_of
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.element_rules import size_of
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Area, Building, Floor, PathEdge, PathNode, TopologicalMap, Wall
from robocorba.map_editor.store import MapLimits, MapStore
from robocorba.map_editor.validation import problems
from testkit.buildings import with_all
from tests.clock import Clock
from tests.map_editor.elements import ELEVATOR, FLOOR, NODE, WALL, wall

L1 = "L1"


def test_what_is_refused_changes_nothing(editor: BuildingEditor, building: Building) -> None:
    refused: list[tuple[type[MapError], Any]] = [
        (DuplicateElement, lambda: editor.create(L1, wall("w"))),
        (DuplicateElement, lambda: editor.create("", building.floors[L1].floor)),
        (UnknownElement, lambda: editor.create("L9", wall("a"))),
        (UnknownElement, lambda: editor.change(L1, wall("a"), 1)),
        (UnknownElement, lambda: editor.change("L9", wall("w"), 1)),
        (UnknownElement, lambda: editor.remove(FLOOR, "", "L9", 1)),
        (UnknownElement, lambda: editor.read(WALL, L1, "a")),
        (UnknownElement, lambda: editor.elements(WALL, "L9")),
        (UnknownElement, lambda: editor.replace_topology("L9", TopologicalMap())),
        (StaleEdit, lambda: editor.change(L1, wall("w"), 0)),
        (StaleEdit, lambda: editor.remove(WALL, L1, "w", 2)),
        (StaleVersion, lambda: editor.undo(0)),
        (StaleVersion, lambda: editor.redo(2)),
        (StaleVersion, lambda: editor.replace(building, 2)),
        (InvalidElement, lambda: editor.create(L1, wall("a", float("nan")))),
        (InvalidElement, lambda: editor.replace(building.without(NODE, L1, "west"), 1)),
        (
            InvalidElement,
            lambda: editor.replace_topology(L1, TopologicalMap({"n": PathNode(name="n", at=(10.0, 1.0))})),
        ),
        (UnknownElement, lambda: editor.rename(NODE, L1, "nobody", "x", 1)),
        (StaleEdit, lambda: editor.rename(NODE, L1, "east", "x", 2)),
        (DuplicateElement, lambda: editor.rename(NODE, L1, "east", "west", 1)),
        (DuplicateElement, lambda: editor.rename(FLOOR, "", L1, "L2", 1)),
        (InvalidElement, lambda: editor.rename(NODE, L1, "east", "", 1)),
        (InvalidElement, lambda: editor.rename(FLOOR, "", L1, "a/b", 1)),
        (VersionUnavailable, lambda: editor.changes_since(0)),
        (VersionUnavailable, lambda: editor.changes_since(2)),
    ]
    for error, edit in refused:
        with pytest.raises(error):
            edit()
    assert (editor.building, editor.version, editor.changes_since(1)) == (building, 1, [])
    with pytest.raises(StaleEdit) as stale:
        editor.change(L1, wall("w"), 5)
    wrong = stale.value
    assert (wrong.kind, wrong.floor, wrong.name, wrong.expected, wrong.current) == ("wall", L1, "w", 5, 1)
    assert str(wrong) == "wall 'w' on L1 is at version 1, the edit was made for version 5"


def test_an_edit_that_blocks_edges_is_made_and_logged(
    editor: BuildingEditor, building: Building, caplog: pytest.LogCaptureFixture
) -> None:
    door = building.floors[L1].geometrical.doors["d"]
    locked = editor.change(L1, msgspec.structs.replace(door, locked=True), 1)
    assert [record.getMessage() for record in caplog.records] == [
        f"version {locked} blocks edge 'west-east' on L1: it leads through locked door 'd' near 10, 5"
    ]
    with pytest.raises(InvalidElement, match="it leads through locked door 'd'"):
        editor.create(L1, PathEdge(name="again", a="west", b="east"))
    opened = editor.change(L1, door, locked)
    editor.create(L1, PathEdge(name="again", a="west", b="east"))
    assert editor.undo(editor.version) and editor.undo(editor.version)  # the door is locked again
    assert editor.replace(editor.building, editor.version) == editor.version == opened + 3
    assert len(caplog.records) == 1
    for i in range(4):
        editor.create("L2", PathNode(name=f"n{i}", at=(3.0, float(i))))
        editor.create("L2", PathEdge(name=f"e{i}", a=f"n{i}", b="top"))
    for name, x in (("across", 5.0), ("through", 3.0)):
        editor.create("L2", Wall(name=name, a=(x, -9.0), b=(x, 9.0)))
    across, through = (record.getMessage() for record in caplog.records[1:])
    assert across.count("it leads through wall 'across'") == 4
    assert through.count("it stands on wall 'through'") == 4 and through.endswith("; and 3 more")


def test_replacing_the_building_is_one_edit(editor: BuildingEditor, building: Building, store: MapStore) -> None:
    other = Building("other").with_element("", Floor(name="L1", level=1, elevation=0.5))
    assert editor.replace(other, 1) == 2
    assert editor.building == other
    assert editor.replace(other, 2) == 2
    assert editor.undo(2) == 3
    assert editor.building == building
    editor.redo(3)
    assert editor.building == other
    assert editor.replace(msgspec.structs.replace(other, name="third"), 4) == 5
    assert (editor.building.name, editor.changes_since(4)) == ("third", [])
    small = BuildingEditor(store, MapLimits(replacement_size=2))
    larger = with_all(small.building, [("L1", wall("a")), ("L1", wall("b"))])
    with pytest.raises(InvalidElement, match="3 new elements and points, one call may bring 2"):
        small.replace(larger.with_element("L1", wall("c")), 5)
    small.replace(larger, 5)
    assert small.replace(Building("third", {}, {}), 6)  # removing is not bringing


def test_memory_is_bounded(store: MapStore, building: Building) -> None:
    size, clock = sum(1 for _ in elements_of(building)) + 4 + 4 + 2 + 1, Clock(0.0)
    editor = BuildingEditor(store, MapLimits(building_size=size + 5, pending_size=5), clock)
    room = Area(name="r", polygon=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    editor.create(L1, room)
    with pytest.raises(InvalidElement, match="the building would have more than"):
        editor.create(L1, msgspec.structs.replace(room, name="s"))
    editor.create(L1, wall("a"))
    one, other = editor.begin(), editor.begin()
    one.create(L1, wall("b"))
    other.create(L1, msgspec.structs.replace(room, name="s"))
    with pytest.raises(InvalidElement, match="open transactions would hold more than 5"):
        one.create(L1, wall("c"))
    clock.now = 11.0
    one.create(L1, wall("c"))  # in the place of the other one, which is idle
    with pytest.raises(TransactionClosed):
        other.commit()
    with pytest.raises(InvalidElement, match="the building would have more than"):
        one.commit()
    editor.remove(WALL, L1, "a", 3)


def test_history_is_bounded(store: MapStore) -> None:
    editor = BuildingEditor(store, MapLimits(commits=3))
    for name in "abcde":
        editor.create(L1, wall(name))
    assert editor.version == 6
    assert [change.key.name for change in editor.changes_since(3)] == ["c", "d", "e"]
    with pytest.raises(VersionUnavailable) as wrong:
        editor.changes_since(2)
    assert (wrong.value.version, wrong.value.oldest, wrong.value.current) == (2, 3, 6)
    editor.undo(6)
    editor.redo(7)
    editor.undo(8)
    # Now 7, 8 and 9 are kept: 6 is gone, and with it its redo; what was done before it is gone too.
    with pytest.raises(NothingToRedo):
        editor.redo(9)
    with pytest.raises(NothingToUndo):
        editor.undo(9)
    editor.create(L1, wall("f"))
    editor.undo(10)
    editor.redo(11)
    assert list(editor.building.floors[L1].geometrical.walls) == ["w", "a", "b", "c", "d", "f"]
    editor.create(L1, wall("g"))
    editor.change(L1, wall("g", 3.0), 13)
    editor.undo(14)
    editor.undo(15)
    # 14, 15 and 16 are kept. 14 could still be repeated, but it changes what 13 made, and 13 is gone.
    with pytest.raises(NothingToRedo):
        editor.redo(16)
    with pytest.raises(NothingToUndo):
        editor.undo(16)


def test_threads_lose_no_edit_and_see_no_half_of_one(editor: BuildingEditor) -> None:
    def edit(number: int) -> int:
        assert len(editor.building.floors[L1].geometrical.walls) % 2 == 1
        change = editor.begin()
        change.create(L1, wall(f"{number}.a"))
        change.create(L1, wall(f"{number}.b"))
        return change.commit()

    with ThreadPoolExecutor(4) as pool:
        versions = list(pool.map(edit, range(75)))
    assert sorted(versions) == list(range(2, 77))
    assert len(editor.building.floors[L1].geometrical.walls) == 151


def test_a_rename_is_followed_by_all_that_refers_to_it(
    editor: BuildingEditor, building: Building, store: MapStore
) -> None:
    assert editor.rename(NODE, L1, "east", "east", 1) == 1  # no edit
    assert editor.rename(NODE, L1, "east", "hall", 1) == 2
    topology = editor.building.floors[L1].topological
    assert set(topology.nodes) == {"west", "hall", "lift1"}
    assert [(edge.a, edge.b) for edge in topology.edges.values()] == [("west", "hall"), ("hall", "lift1")]
    assert [edit.summary for edit in editor.edits_since(1)] == ["node east on L1 renamed to hall"]
    editor.undo(2)
    assert editor.building == building
    editor.rename(FLOOR, "", L1, "lobby", 1)
    after = editor.building
    assert list(after.floors) == ["lobby", "L2"]
    assert after.floors["lobby"].geometrical == building.floors[L1].geometrical
    assert after.floors["lobby"].topological == building.floors[L1].topological
    assert after.elevators["E1"].floors() == ("lobby", "L2")
    assert editor.read(WALL, "lobby", "w")[1] == 4
    assert store.load().building == after
    editor.rename(ELEVATOR, "", "E1", "lift", 4)
    for floor, node in (("lobby", "lift1"), ("L2", "lift2")):
        assert editor.building.floors[floor].topological.nodes[node].elevator == "lift"
    assert problems(editor.building) == []


# -- transactions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mine", "theirs", "error"),
    [
        (lambda on: on.change(L1, wall("w", 10.0), 1), lambda on: on.change(L1, wall("w", 9.0), 1), StaleEdit),
        (lambda on: on.remove(WALL, L1, "w", 1), lambda on: on.change(L1, wall("w", 9.0), 1), StaleEdit),
        (lambda on: on.change(L1, wall("w"), 1), lambda on: on.remove(WALL, L1, "w", 1), UnknownElement),
        (lambda on: on.create(L1, wall("a")), lambda on: on.create(L1, wall("a", 9.0)), DuplicateElement),
        (lambda on: on.create("B", wall("a")), lambda on: on.remove(FLOOR, "", "B", 2), UnknownElement),
        (
            lambda on: on.create(L1, PathEdge(name="e", a="west", b="n")),
            lambda on: on.remove(NODE, L1, "n", 3),
            InvalidElement,
        ),
    ],
)
def test_a_transaction_does_not_overwrite_others(editor: BuildingEditor, mine: Any, theirs: Any, error: Any) -> None:
    editor.create("", Floor(name="B", level=0, elevation=-4.0))
    editor.create(L1, PathNode(name="n", at=(3.0, 5.0)))
    change = editor.begin()
    mine(change)
    theirs(editor)
    after = editor.building
    with pytest.raises(error):
        change.commit()
    assert (editor.building, editor.version) == (after, 4)
    with pytest.raises(TransactionClosed):
        change.commit()


def test_a_floor_made_and_dropped_in_a_transaction_leaves_that_of_others_alone(editor: BuildingEditor) -> None:
    floor, change = Floor(name="B", level=0, elevation=-4.0), editor.begin()
    change.create("", floor)
    change.remove(FLOOR, "", "B", 0)
    editor.create("", floor)
    assert change.commit() == 2
    assert "B" in editor.building.floors


def test_transactions_are_bounded_and_time_out(store: MapStore) -> None:
    clock = Clock(0.0)
    editor = BuildingEditor(store, MapLimits(transactions=2, transaction_timeout_s=10.0), clock)
    idle, busy = editor.begin(), editor.begin()
    with pytest.raises(TooManyTransactions, match="2 transactions or edit sessions are open"):
        editor.begin()
    clock.now = 8.0
    busy.create(L1, wall("a"))
    clock.now = 11.0
    assert editor.end_idle() == 0
    third = editor.begin()
    with pytest.raises(TransactionClosed):
        idle.create(L1, wall("b"))
    assert busy.commit() == 2
    third.create(L1, wall("c"))
    clock.now = 22.0
    assert editor.end_idle() == size_of(wall("c"))
    assert not third.is_open
    assert editor.end_idle() == 0
    editor = BuildingEditor(store, MapLimits(transactions=4, client_transactions=3), clock)
    ada, bob = EditSessions(editor).open("Ada"), EditSessions(editor).open("Bob")
    forgotten = [editor.begin() for _ in range(3)]
    with pytest.raises(TooManyTransactions, match="3 transactions"):
        editor.begin()
    of_ada = ada.begin()
    with pytest.raises(TooManyTransactions, match="4 transactions"):
        bob.begin()
    clock.now += 11.0
    forgotten[1].create(L1, wall("in use"))
    bob.begin()  # in the place of one of those who have most
    assert [each.is_open for each in (*forgotten, of_ada)].count(False) == 1
    assert of_ada.is_open and forgotten[1].is_open
