"""Transactions: several edits that take effect together or not at all, bounded for each client and for all."""

from __future__ import annotations

from typing import Any

import pytest

from robocorba.errors.maps import (
    DuplicateElement,
    InvalidElement,
    StaleEdit,
    TooManyTransactions,
    TransactionClosed,
    UnknownElement,
)
from robocorba.maps.edit_session import EditSessions
from robocorba.maps.element_rules import size_of
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import (
    Building,
    ElementKind,
    Floor,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.maps.store import MapLimits, MapStore
from tests.clock import Clock

L1, WALL, NODE, EDGE, FLOOR = "L1", ElementKind.WALL, ElementKind.NODE, ElementKind.EDGE, ElementKind.FLOOR


def wall(name: str, x: float = 2.0) -> Wall:
    return Wall(name=name, a=(x, 1.0), b=(x, 2.0))


def test_a_transaction_is_seen_as_a_whole(editor: BuildingEditor, building: Building) -> None:
    change = editor.begin()
    change.create(L1, PathEdge(name="e", a="n", b="west"))
    change.create(L1, PathNode(name="n", at=(3.0, 5.0)))
    change.change(L1, PathNode(name="n", at=(2.0, 5.0)), 0)
    change.remove(EDGE, L1, "west-east", 1)
    change.create(L1, PathEdge(name="west-east", a="east", b="west"))
    change.change(L1, PathEdge(name="west-east", a="east", b="n"), 1)
    change.create(L1, wall("gone"))
    change.remove(WALL, L1, "gone", 0)
    assert (editor.building, editor.version) == (building, 1)
    assert change.commit() == 2
    assert [(step.version, step.key.name, step.kind.value) for step in editor.changes_since(1)] == [
        (2, "e", "created"),
        (2, "n", "created"),
        (2, "west-east", "changed"),
    ]
    assert editor.read(NODE, L1, "n") == (PathNode(name="n", at=(2.0, 5.0)), 2)
    editor.undo(2)
    assert editor.building == building
    for use in (change.commit, change.roll_back, lambda: change.create(L1, wall("a"))):
        with pytest.raises(TransactionClosed):
            use()


def test_a_transaction_checks_each_step(editor: BuildingEditor) -> None:
    change = editor.begin()
    change.create(L1, wall("a"))
    for error, step in (
        (DuplicateElement, lambda: change.create(L1, wall("a"))),
        (DuplicateElement, lambda: change.create(L1, wall("w"))),
        (UnknownElement, lambda: change.create("L9", wall("a"))),
        (UnknownElement, lambda: change.change(L1, wall("b"), 0)),
        (UnknownElement, lambda: change.remove(WALL, L1, "b", 0)),
        (StaleEdit, lambda: change.change(L1, wall("a"), 1)),
        (StaleEdit, lambda: change.change(L1, wall("w"), 0)),
        (InvalidElement, lambda: change.create(L1, wall("\n"))),
        (InvalidElement, lambda: change.change(L1, wall("a", 1e300), 0)),
    ):
        with pytest.raises(error):
            step()
    change.remove(FLOOR, "", "L2", 1)
    with pytest.raises(UnknownElement):
        change.create("L2", wall("a"))
    with pytest.raises(UnknownElement):
        change.remove(NODE, "L2", "top", 1)
    change.roll_back()
    assert editor.version == 1


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


def test_a_floor_may_be_drawn_anew_in_a_transaction(editor: BuildingEditor, building: Building) -> None:
    change = editor.begin()
    change.remove(FLOOR, "", "L2", 1)
    change.create("", Floor(name="L2", level=2, elevation=5.0))
    change.create("L2", PathNode(name="top", at=(1.0, 1.0)))
    change.change("L2", PathNode(name="top", at=(2.0, 2.0)), 0)
    editor.create("L2", wall("late"))
    change.commit()
    entry = editor.building.floors["L2"]
    assert (entry.floor.elevation, list(entry.topological.nodes), entry.geometrical.walls) == (5.0, ["top"], {})
    editor.undo(editor.version)
    assert editor.building == building.with_element("L2", wall("late"))


def test_a_floor_made_and_dropped_in_a_transaction_leaves_that_of_others_alone(editor: BuildingEditor) -> None:
    floor = Floor(name="B", level=0, elevation=-4.0)
    change = editor.begin()
    change.create("", floor)
    change.create("B", wall("mine"))
    change.remove(FLOOR, "", "B", 0)
    editor.create("", floor)
    editor.create("B", wall("theirs"))
    assert change.commit() == 3
    assert list(editor.building.floors["B"].geometrical.walls) == ["theirs"]


def test_transactions_are_bounded_and_time_out(store: MapStore) -> None:
    clock = Clock(0.0)
    editor = BuildingEditor(store, MapLimits(transactions=2, transaction_timeout_s=10.0), clock)
    idle, busy = editor.begin(), editor.begin()
    with pytest.raises(TooManyTransactions, match="2 transactions or edit sessions are open"):
        editor.begin()
    clock.now = 8.0
    busy.create(L1, wall("a"))
    clock.now = 11.0
    third = editor.begin()
    with pytest.raises(TransactionClosed):
        idle.create(L1, wall("b"))
    assert busy.commit() == 2
    third.roll_back()
    with pytest.raises(TransactionClosed):
        third.roll_back()


def test_what_is_idle_for_too_long_ends_by_itself(store: MapStore) -> None:
    clock = Clock(0.0)
    editor = BuildingEditor(store, MapLimits(transaction_timeout_s=10.0), clock)
    idle = editor.begin()
    idle.create(L1, wall("a"))
    clock.now = 9.0
    busy = editor.begin()
    assert editor.end_idle() == 0
    assert idle.is_open
    clock.now = 11.0
    assert editor.end_idle() == size_of(wall("a"))
    assert not idle.is_open
    assert busy.is_open
    assert editor.end_idle() == 0


def test_forgotten_transactions_stop_nobody(store: MapStore) -> None:
    clock = Clock(0.0)
    editor = BuildingEditor(store, MapLimits(transactions=4, client_transactions=3), clock)
    ada, bob = EditSessions(editor).open("Ada"), EditSessions(editor).open("Bob")
    forgotten = [editor.begin() for _ in range(3)]
    with pytest.raises(TooManyTransactions, match="3 transactions"):
        editor.begin()
    of_ada = ada.begin()
    with pytest.raises(TooManyTransactions, match="4 transactions"):
        bob.begin()
    clock.now = 11.0
    forgotten[1].create(L1, wall("in use"))
    bob.begin()  # in the place of one of those who have most
    assert [each.is_open for each in (*forgotten, of_ada)].count(False) == 1
    assert of_ada.is_open
    assert forgotten[1].is_open


def test_a_large_forgotten_transaction_leaves_room_for_others(store: MapStore) -> None:
    clock = Clock(0.0)
    editor = BuildingEditor(store, MapLimits(pending_size=1), clock)
    forgotten, other = editor.begin(), editor.begin()
    forgotten.create(L1, wall("a"))
    with pytest.raises(InvalidElement, match="open transactions would hold more than 1"):
        other.create(L1, wall("b"))
    clock.now = 11.0
    other.create(L1, wall("b"))
    assert other.commit() == 2
    with pytest.raises(TransactionClosed):
        forgotten.commit()
