"""Sessions beside what test_any_edits.py tries: summaries while others edit, ends, and what a commit would break."""

from __future__ import annotations

import threading
from collections import deque

import pytest

from robocorba.errors.maps import InvalidElement, SessionEnded, TooManyTransactions
from robocorba.map_editor.author_history import OwnEdit
from robocorba.map_editor.edit_session import EditSession, EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import Building, PathEdge, PathNode
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
