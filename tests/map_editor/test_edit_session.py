"""Sessions: an author undoes what that author did and nothing else, whatever others do in between."""

from __future__ import annotations

import threading
from collections import deque

import pytest

from robocorba.errors.maps import EditedByOthers, InvalidElement, SessionEnded, TooManyTransactions
from robocorba.map_editor.author_history import OwnEdit
from robocorba.map_editor.edit_session import EditSession, EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building, Floor, PathEdge, PathNode
from robocorba.map_editor.store import MapLimits, MapStore
from tests.clock import Clock
from tests.map_editor.elements import EDGE, NODE, WALL, wall

L1 = "L1"


@pytest.fixture
def editor(store: MapStore) -> BuildingEditor:
    return BuildingEditor(store, wall_clock=lambda: 1e9)


@pytest.fixture
def sessions(editor: BuildingEditor) -> EditSessions:
    return EditSessions(editor)


@pytest.fixture
def ada(sessions: EditSessions) -> EditSession:
    return sessions.open("Ada")


@pytest.fixture
def bob(sessions: EditSessions) -> EditSession:
    return sessions.open("Bob")


def walls(editor: BuildingEditor) -> dict[str, float]:
    """The walls of L1 and their x, without that of the building."""
    return {name: each.a[0] for name, each in editor.building.floors[L1].geometrical.walls.items() if name != "w"}


def test_a_summary_is_read_between_the_edits(editor: BuildingEditor, ada: EditSession) -> None:
    undo = threading.Thread(target=ada.undo)

    class Undone(deque[OwnEdit]):
        def __len__(self) -> int:
            number = super().__len__()
            if not undo.ident:
                undo.start()
                undo.join(0.5)  # it does not end while the summary is being read
            return number

    ada.create(L1, wall("a"))
    ada._history.done = Undone(ada._history.done)
    assert ada.undoable == "wall a on L1 created"
    undo.join()
    assert (ada.undoable, ada.redoable) == ("", "wall a on L1 created")


def test_what_others_have_changed_since_is_not_overwritten(
    editor: BuildingEditor, ada: EditSession, bob: EditSession
) -> None:
    ada.create(L1, wall("first"))
    bob.change(L1, wall("a", 3.0), ada.create(L1, wall("a")))
    with pytest.raises(EditedByOthers, match="wall 'a' on L1 has been changed by Bob since") as refused:
        ada.undo()
    wrong = refused.value
    assert (wrong.kind, wrong.floor, wrong.name, wrong.author) == ("wall", L1, "a", "Bob")
    ada.undo()  # the edit before it
    assert walls(editor) == {"a": 3.0}
    bob.undo()
    assert walls(editor) == {"a": 2.0}
    editor.undo(ada.create(L1, wall("b")))
    with pytest.raises(EditedByOthers, match="wall 'b' on L1 has been changed by another client since"):
        ada.undo()


def test_a_transaction_of_a_session_is_one_edit_of_its_author(
    editor: BuildingEditor, ada: EditSession, bob: EditSession
) -> None:
    began = editor.version
    transaction = ada.begin()
    for name in "abc":
        transaction.create(L1, wall(name))
    transaction.create("", Floor(name="L3", level=3, elevation=8.0))
    bob.create(L1, wall("d"))
    transaction.commit()
    ada.begin().commit()  # empty: no edit
    assert (ada.undoable, ada.redoable) == ("floor L3 created, 3 walls on L1 created", "")
    ada.undo()
    assert (ada.undoable, ada.redoable) == ("", "floor L3 created, 3 walls on L1 created")
    assert list(walls(editor)) == ["d"]
    assert [(edit.author, edit.time_s, edit.changes, edit.summary) for edit in editor.edits_since(began)] == [
        ("Bob", 1e9, 1, "wall d on L1 created"),
        ("Ada", 1e9, 4, "floor L3 created, 3 walls on L1 created"),
        ("Ada", 1e9, 4, "undone: floor L3 created, 3 walls on L1 created"),
    ]


def test_sessions_end(store: MapStore) -> None:
    clock = Clock(0.0)
    sessions = EditSessions(BuildingEditor(store), MapLimits(sessions=2), clock)
    forgotten, idle = sessions.open("Ada"), sessions.open("Ada")
    with pytest.raises(TooManyTransactions):
        sessions.open("Bob")
    for author in ("", "x" * 61, "a\nb"):
        with pytest.raises(InvalidElement, match="the author's name"):
            sessions.open(author)
    clock.now = 301.0
    assert idle.undoable == ""
    busy = sessions.open("Bob")
    assert (forgotten.is_open, idle.is_open, busy.is_open) == (False, True, True)
    clock.now = 3899.0
    assert busy.undoable == ""
    clock.now = 3902.0
    for call in (idle.undo, idle.close, idle.begin, lambda: idle.undoable, lambda: idle.create(L1, wall("a"))):
        with pytest.raises(SessionEnded):
            call()
    assert (idle.is_open, busy.is_open) == (False, True)
    busy.close()
    with pytest.raises(SessionEnded):
        busy.redo()
    sessions.open("Bob")


def test_a_transaction_lists_every_rule_that_its_commit_would_break(editor: BuildingEditor, building: Building) -> None:
    transaction = editor.begin()
    transaction.create(L1, PathNode(name="on wall", at=(10.0, 2.0)))
    transaction.create(L1, PathEdge(name="loose", a="west", b="nowhere"))
    transaction.create("L2", PathNode(name="lost", at=(1.0, 1.0), elevator="E9"))
    found = transaction.problems()
    assert [(each.kind.value, each.name, each.where, each.reason) for each in sorted(found, key=lambda f: f.name)] == [
        ("edge", "loose", (L1, 5.0, 5.0), "node 'nowhere' does not exist on this floor"),
        ("node", "lost", ("L2", 1.0, 1.0), "it names elevator 'E9', which does not exist"),
        ("node", "on wall", (L1, 10.0, 2.0), "it stands on wall 'w'"),
    ]
    assert (editor.building, editor.version) == (building, 1)
    transaction.remove(NODE, L1, "on wall", 0)
    transaction.remove(EDGE, L1, "loose", 0)
    transaction.remove(NODE, "L2", "lost", 0)
    assert transaction.problems() == []
    transaction.change(L1, wall("w", 12.0), 1)
    editor.change(L1, wall("w", 13.0), 1)
    assert [(each.kind, each.floor, each.name, each.reason) for each in transaction.problems()] == [
        (WALL, L1, "w", "another client has changed it since")
    ]
