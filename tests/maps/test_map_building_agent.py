"""The editor: versions, conflicts, undo, and that it agrees with a plain dictionary, also in transactions."""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.maps import (
    DuplicateElement,
    InvalidElement,
    MapError,
    NothingToRedo,
    NothingToUndo,
    StaleEdit,
    StaleVersion,
    UnknownElement,
    VersionUnavailable,
)
from robocorba.maps.changes import Change, ChangeKind, ElementKey, apply, elements_of, key_of
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import (
    Area,
    Building,
    Element,
    ElementKind,
    Floor,
    PathEdge,
    PathNode,
    TopologicalMap,
    Wall,
)
from robocorba.maps.store import MapLimits, MapStore
from robocorba.testing.buildings import floor_names, is_refused, names, placed, two_floors

L1, WALL, NODE, FLOOR = "L1", ElementKind.WALL, ElementKind.NODE, ElementKind.FLOOR


def wall(name: str, x: float = 2.0) -> Wall:
    return Wall(name=name, a=(x, 1.0), b=(x, 2.0))


def read_wall(editor: BuildingEditor, name: str) -> tuple[Element, int]:
    return editor.read(WALL, L1, name)


def test_create_change_remove(editor: BuildingEditor, building: Building) -> None:
    assert (editor.building, editor.version) == (building, 1)
    assert editor.create(L1, wall("a")) == 2
    assert read_wall(editor, "a") == (wall("a"), 2)
    assert editor.change(L1, wall("a", 3.0), 2) == 3
    assert read_wall(editor, "a") == (wall("a", 3.0), 3)
    assert editor.remove(WALL, L1, "a", 3) == 4
    assert editor.building == building
    changes = editor.changes_since(1)
    assert [(change.version, change.kind, change.floor, change.element) for change in changes] == [
        (2, ChangeKind.CREATED, L1, wall("a")),
        (3, ChangeKind.CHANGED, L1, wall("a", 3.0)),
        (4, ChangeKind.REMOVED, L1, wall("a", 3.0)),
    ]


def test_what_is_refused_changes_nothing(editor: BuildingEditor, building: Building) -> None:
    refused: list[tuple[type[MapError], Any]] = [
        (DuplicateElement, lambda: editor.create(L1, wall("w"))),
        (DuplicateElement, lambda: editor.create("", building.floors[L1].floor)),
        (UnknownElement, lambda: editor.create("L9", wall("a"))),
        (UnknownElement, lambda: editor.create("", wall("a"))),
        (UnknownElement, lambda: editor.change(L1, wall("a"), 1)),
        (UnknownElement, lambda: editor.change("L9", wall("w"), 1)),
        (UnknownElement, lambda: editor.remove(WALL, L1, "a", 1)),
        (UnknownElement, lambda: editor.remove(FLOOR, "", "L9", 1)),
        (UnknownElement, lambda: editor.read(WALL, L1, "a")),
        (UnknownElement, lambda: editor.elements(WALL, "L9")),
        (UnknownElement, lambda: editor.replace_topology("L9", TopologicalMap())),
        (StaleEdit, lambda: editor.change(L1, wall("w"), 0)),
        (StaleEdit, lambda: editor.remove(WALL, L1, "w", 2)),
        (StaleVersion, lambda: editor.undo(0)),
        (StaleVersion, lambda: editor.redo(2)),
        (StaleVersion, lambda: editor.replace(building, 2)),
        (NothingToUndo, lambda: editor.undo(1)),
        (NothingToRedo, lambda: editor.redo(1)),
        (InvalidElement, lambda: editor.create(L1, wall("a", float("nan")))),
        (InvalidElement, lambda: editor.create(L1, PathNode(name="a", at=(10.0, 1.0)))),
        (InvalidElement, lambda: editor.remove(NODE, L1, "west", 1)),
        (InvalidElement, lambda: editor.remove(FLOOR, "", "L2", 1)),
        (InvalidElement, lambda: editor.replace(building.without(NODE, L1, "west"), 1)),
        (
            InvalidElement,
            lambda: editor.replace_topology(L1, TopologicalMap({"n": PathNode(name="n", at=(10.0, 1.0))})),
        ),
        (VersionUnavailable, lambda: editor.changes_since(0)),
        (VersionUnavailable, lambda: editor.changes_since(2)),
    ]
    for error, edit in refused:
        with pytest.raises(error):
            edit()
    assert (editor.building, editor.version, editor.changes_since(1)) == (building, 1, [])


def test_an_edit_that_blocks_edges_is_made_and_logged(
    editor: BuildingEditor, building: Building, caplog: pytest.LogCaptureFixture
) -> None:
    door = building.floors[L1].geometrical.doors["d"]
    locked = editor.change(L1, msgspec.structs.replace(door, locked=True), 1)
    assert [record.getMessage() for record in caplog.records] == [
        f"version {locked} blocks edge 'west-east' on L1: it leads through locked door 'd' near 10, 5"
    ]
    edge = building.floors[L1].topological.edges["west-east"]
    slower = msgspec.structs.replace(edge, speed_limit=0.5)
    editor.change(L1, slower, 1)
    editor.create(L1, PathNode(name="n", at=(5.0, 2.0)))
    editor.create(L1, PathEdge(name="n-west", a="n", b="west"))
    with pytest.raises(InvalidElement, match="it leads through locked door 'd'"):
        editor.create(L1, PathEdge(name="again", a="west", b="east"))
    opened = editor.change(L1, door, locked)
    editor.create(L1, PathEdge(name="again", a="west", b="east"))
    assert editor.undo(editor.version) and editor.undo(editor.version)  # the door is locked again
    assert editor.building.floors[L1].geometrical.doors["d"].locked
    assert editor.replace(editor.building, editor.version) == editor.version == opened + 3
    assert len(caplog.records) == 1


def test_the_log_names_the_first_of_many_blocked_edges(
    editor: BuildingEditor, caplog: pytest.LogCaptureFixture
) -> None:
    for i in range(4):
        editor.create("L2", PathNode(name=f"n{i}", at=(3.0, float(i))))
        editor.create("L2", PathEdge(name=f"e{i}", a=f"n{i}", b="top"))
    editor.create("L2", Wall(name="across", a=(5.0, -9.0), b=(5.0, 9.0)))
    editor.create("L2", Wall(name="through", a=(3.0, -9.0), b=(3.0, 9.0)))
    across, through = (record.getMessage() for record in caplog.records)
    assert across.count("it leads through wall 'across'") == 4
    assert through.count("it stands on wall 'through'") == 4 and through.endswith("; and 3 more")


def test_errors_have_plain_fields(editor: BuildingEditor) -> None:
    editor.create(L1, wall("a"))
    with pytest.raises(StaleEdit) as stale:
        editor.change(L1, wall("a"), 1)
    wrong = stale.value
    assert (wrong.kind, wrong.floor, wrong.name, wrong.expected, wrong.current) == ("wall", L1, "a", 1, 2)
    assert str(wrong) == "wall 'a' on L1 is at version 2, the edit was made for version 1"
    with pytest.raises(UnknownElement, match="there is no floor 'L9'"):
        editor.create("L9", wall("a"))


def test_editors_of_different_elements_do_not_conflict(editor: BuildingEditor) -> None:
    first, second = editor.create(L1, wall("a")), editor.create(L1, wall("b"))
    editor.change(L1, wall("a", 3.0), first)
    editor.change(L1, wall("b", 3.0), second)
    with pytest.raises(StaleEdit):
        editor.change(L1, wall("a", 4.0), first)


def test_elements_come_with_the_versions_that_changed_them(editor: BuildingEditor) -> None:
    version = editor.create(L1, wall("a"))
    assert editor.elements(WALL, L1) == [(editor.building.floors[L1].geometrical.walls["w"], 1), (wall("a"), version)]
    assert [name.name for name, _ in editor.elements(FLOOR)] == ["L1", "L2"]
    assert [element.name for element, _ in editor.elements(ElementKind.ELEVATOR, "L9")] == ["E1"]


def test_a_floor_goes_and_comes_back_with_all_on_it(editor: BuildingEditor) -> None:
    editor.create("", Floor(name="B1", level=-1, elevation=-4.0))
    editor.create("B1", wall("a"))
    editor.create("B1", PathNode(name="n", at=(0.0, 0.0)))
    full = editor.building
    version = editor.remove(FLOOR, "", "B1", 2)
    assert "B1" not in editor.building.floors
    assert [change.key.kind for change in editor.changes_since(version - 1)] == [WALL, NODE, FLOOR]
    editor.undo(version)
    assert editor.building == full
    assert list(editor.building.floors) == ["B1", "L1", "L2"]
    assert editor.read(WALL, "B1", "a")[1] == version + 1
    editor.redo(editor.version)
    assert "B1" not in editor.building.floors


def test_undo_and_redo_walk_up_and_down(editor: BuildingEditor, building: Building) -> None:
    for name in "abc":
        editor.create(L1, wall(name))
    full = editor.building
    for expected in (4, 5, 6):
        assert editor.undo(expected) == expected + 1
    assert editor.building == building
    with pytest.raises(NothingToUndo):
        editor.undo(7)
    for expected in (7, 8, 9):
        editor.redo(expected)
    assert editor.building == full
    with pytest.raises(NothingToRedo):
        editor.redo(10)
    editor.undo(10)
    editor.create(L1, wall("d"))
    with pytest.raises(NothingToRedo):
        editor.redo(12)
    editor.undo(12)
    editor.undo(13)
    assert set(editor.building.floors[L1].geometrical.walls) == {"w", "a"}
    with pytest.raises(StaleEdit):
        editor.change(L1, wall("a"), 2)


def test_replacing_the_building_is_one_edit(editor: BuildingEditor, building: Building) -> None:
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


def test_replacing_a_topological_map_leaves_equal_parts_alone(editor: BuildingEditor, building: Building) -> None:
    nodes = building.floors[L1].topological.nodes
    drawn = TopologicalMap({"west": nodes["west"], "n": PathNode(name="n", at=(3.0, 5.0))}, {})
    editor.replace_topology(L1, drawn)
    assert editor.building.floors[L1].topological == drawn
    assert editor.read(NODE, L1, "west")[1] == 1
    assert editor.replace_topology(L1, drawn) == 2
    editor.undo(2)
    assert editor.building == building


def test_memory_is_bounded(store: MapStore, building: Building) -> None:
    size = sum(1 for _ in elements_of(building)) + 4 + 4 + 2 + 1
    editor = BuildingEditor(store, MapLimits(building_size=size + 5, pending_size=5))
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
    other.roll_back()
    one.create(L1, wall("c"))
    with pytest.raises(InvalidElement, match="the building would have more than"):
        one.commit()
    editor.remove(WALL, L1, "a", 3)


def test_listeners_hear_each_edit_before_it_returns(editor: BuildingEditor) -> None:
    heard: list[tuple[Building, int, list[Change]]] = []
    assert editor.subscribe(lambda *event: heard.append((event[0], event[1], list(event[2])))) == editor.snapshot
    editor.create(L1, wall("a"))
    assert heard == [(editor.building, 2, editor.changes_since(1))]
    with pytest.raises(DuplicateElement):
        editor.create(L1, wall("a"))
    editor.undo(2)
    assert [version for _, version, _ in heard] == [2, 3]


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


def test_a_redo_is_lost_with_the_one_it_stands_on(store: MapStore) -> None:
    editor = BuildingEditor(store, MapLimits(commits=3))
    for name in "abcd":
        editor.create(L1, wall(name))
    editor.change(L1, wall("d", 3.0), 5)
    editor.undo(6)
    editor.undo(7)
    # 6, 7 and 8 are kept. 6 could still be repeated, but it changes what 5 made, and 5 is gone.
    with pytest.raises(NothingToRedo):
        editor.redo(8)
    with pytest.raises(NothingToUndo):
        editor.undo(8)


def test_threads_lose_no_edit_and_see_no_half_of_one(editor: BuildingEditor) -> None:
    versions: list[int] = []
    torn: list[int] = []
    done = threading.Event()

    def edit(mine: str) -> None:
        for number in range(25):
            change = editor.begin()
            change.create(L1, wall(f"{mine}{number}.a"))
            change.create(L1, wall(f"{mine}{number}.b"))
            versions.append(change.commit())

    def watch() -> None:
        while not done.is_set():
            if len(editor.building.floors[L1].geometrical.walls) % 2 != 1:
                torn.append(editor.version)

    watcher = threading.Thread(target=watch)
    workers = [threading.Thread(target=edit, args=(mine,)) for mine in "pqr"]
    watcher.start()
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    done.set()
    watcher.join()
    assert sorted(versions) == list(range(2, 77))
    assert torn == []
    assert len(editor.building.floors[L1].geometrical.walls) == 151


Elements = dict[ElementKey, Element]


class Model:
    """What an editor must do, as plain dictionaries: elements, their versions and the states to undo and redo."""

    def __init__(self, building: Building) -> None:
        self.elements = dict(elements_of(building))
        self.versions = dict.fromkeys(self.elements, 1)
        self.version = 1
        self.done: list[tuple[Elements, set[ElementKey]]] = []
        self.undone: list[tuple[Elements, set[ElementKey]]] = []

    def accept(self, elements: Elements, touched: set[ElementKey]) -> None:
        """Go to the next version with these elements."""
        self.version += 1
        for key in touched:
            self.versions[key] = self.version
        self.elements = elements
        self.versions = {key: self.versions[key] for key in elements}

    def edit(self, elements: Elements, touched: set[ElementKey]) -> None:
        """Accept something new."""
        self.done.append((self.elements, touched))
        self.undone.clear()
        self.accept(elements, touched)

    def step(self, source: list[tuple[Elements, set[ElementKey]]], target: list[Any]) -> None:
        """Undo or redo."""
        elements, touched = source.pop()
        target.append((self.elements, touched))
        self.accept(elements, touched)


def building_of(elements: Elements) -> Building:
    """A building put together from nothing but its elements."""
    first = sorted(elements, key=lambda key: key.kind is not FLOOR)
    return apply(Building("two floors"), [Change(1, key, None, elements[key]) for key in first])


_kinds = st.sampled_from(ElementKind)
_edits = st.one_of(
    st.tuples(st.just("put"), placed),
    st.tuples(st.just("remove"), st.tuples(_kinds, floor_names, st.one_of(names, floor_names, st.just("west-east")))),
)
_operations = st.lists(
    st.one_of(
        _edits,
        st.tuples(st.sampled_from(["undo", "undo", "redo", "reopen"]), st.none()),
        st.tuples(st.just("together"), st.lists(_edits, max_size=4)),
    ),
    max_size=30,
)


def edited(elements: Elements, what: str, value: Any) -> tuple[Elements, set[ElementKey]] | None:
    """The elements after one edit and the keys it touches; None where the edit is refused outright."""
    if what == "put":
        floor, element = value
        key = key_of(floor, element)
        if key.floor and ElementKey(FLOOR, "", floor) not in elements:
            return None
        return {**elements, key: element}, {key}
    key = ElementKey(value[0], "" if value[0] in (FLOOR, ElementKind.ELEVATOR) else value[1], value[2])
    if key not in elements:
        return None
    gone = {key} | ({other for other in elements if other.floor == key.name} if key.kind is FLOOR else set())
    return {other: element for other, element in elements.items() if other not in gone}, gone


def send(target: Any, model: Model, seen: Elements, what: str, value: Any, made: bool) -> None:
    """Ask the editor or a transaction for the edit; `seen` are the elements there at this point."""
    if what == "remove":
        key = ElementKey(value[0], "" if value[0] in (FLOOR, ElementKind.ELEVATOR) else value[1], value[2])
        target.remove(*value, 0 if made else model.versions.get(key, 0))
        return
    key = key_of(*value)
    if key in seen:
        target.change(*value, 0 if made else model.versions.get(key, 0))
    else:
        target.create(*value)


@settings(deadline=None, max_examples=40)
@given(_operations)
def test_the_editor_agrees_with_plain_dictionaries(operations: list[tuple[str, Any]]) -> None:
    start = two_floors()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.db"
        store = MapStore.create(file, start)
        editor, model = BuildingEditor(store), Model(start)
        for what, value in operations:
            if what == "reopen":
                store.close()
                store = MapStore(file)
                editor = BuildingEditor(store)
            elif what in ("undo", "redo"):
                source, target = (model.done, model.undone) if what == "undo" else (model.undone, model.done)
                if source:
                    model.step(source, target)
                    assert getattr(editor, what)(editor.version) == model.version
                else:
                    with pytest.raises((NothingToUndo, NothingToRedo)):
                        getattr(editor, what)(editor.version)
            elif what == "together":
                _in_a_transaction(editor, model, value)
            else:
                result = edited(model.elements, what, value)
                if result is None or is_refused(building_of(model.elements), building_of(result[0])):
                    with pytest.raises((InvalidElement, UnknownElement)):
                        send(editor, model, model.elements, what, value, made=False)
                else:
                    send(editor, model, model.elements, what, value, made=False)
                    model.edit(*result)
            assert editor.version == model.version
            assert editor.building == building_of(model.elements)
        for key, element in model.elements.items():
            assert editor.read(*key) == (element, model.versions[key]), key
        replayed = apply(start, [])
        for change in editor.changes_since(1):
            replayed = apply(replayed, [change])
        assert replayed == editor.building
        ended = msgspec.json.encode(editor.building)
        store.close()
        with MapStore(file) as again:
            assert msgspec.json.encode(again.load().building) == ended  # the order of elements included


def _in_a_transaction(editor: BuildingEditor, model: Model, edits: list[tuple[str, Any]]) -> None:
    transaction, elements, touched = editor.begin(), model.elements, set()
    gone: set[ElementKey] = set()
    for what, value in edits:
        result = edited(elements, what, value)
        key = key_of(*value) if what == "put" else ElementKey(*value)
        made = key in gone
        try:
            send(transaction, model, elements, what, value, made)
        except (InvalidElement, UnknownElement):
            continue
        assert result is not None
        if what == "remove" and value[0] is FLOOR:
            gone |= {other for other in result[1] if other.floor}
        elements = result[0]
        touched |= result[1]
    touched = {key for key in touched if key in elements or key in model.elements}
    if is_refused(building_of(model.elements), building_of(elements)):
        with pytest.raises(InvalidElement):
            transaction.commit()
    elif touched:
        assert transaction.commit() == model.version + 1
        model.edit(elements, touched)
    else:
        assert transaction.commit() == model.version
