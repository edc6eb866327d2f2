"""Timeouts and limits of the map editor, with a real ORB and a clock that the test sets."""

from __future__ import annotations

import io
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from omniORB import CORBA
from PIL import Image

from robocorba.corba.orb import Orb
from robocorba.corba.remote.edit_session import RemoteEditSession
from robocorba.corba.servants import map_editor
from robocorba.corba.servants.map_editor import CLOSED_TRANSACTIONS_KEPT, MapEditorServant
from robocorba.errors.maps import EditedByOthers, SessionEnded, TransactionClosed
from robocorba.maps import native
from robocorba.maps.edit_session import EditSessions
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import ElementKind, PathNode, Wall
from robocorba.maps.store import MapLimits, MapStore
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.buildings import two_floors
from tests.clock import Clock
from tests.system.elements import wall

TIMEOUT_S, SESSION_S = 300.0, 3600.0


class CountingOrb:
    """Counts the active servants of an ORB."""

    def __init__(self, orb: Orb) -> None:
        self.orb, self.active = orb, 0

    def activate(self, servant: object) -> object:
        self.active += 1
        return self.orb.activate(servant)

    def deactivate(self, servant: object) -> None:
        self.orb.deactivate(servant)
        self.active -= 1


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def orb() -> Iterator[CountingOrb]:
    with socket.socket() as nowhere:
        nowhere.bind(("127.0.0.1", 0))
        with Orb(Address(*nowhere.getsockname())) as orb:
            yield CountingOrb(orb)


@pytest.fixture
def editor(tmp_path: Path, clock: Clock, orb: CountingOrb) -> Iterator[MapEditorServant]:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        editor = BuildingEditor(store, MapLimits(transaction_timeout_s=TIMEOUT_S), clock)
        yield MapEditorServant(EditSessions(editor, clock=clock), orb)


def test_abandoned_transactions_time_out(editor: MapEditorServant, clock: Clock, orb: CountingOrb) -> None:
    for _ in range(5):
        left = [editor.begin() for _ in range(32)]
        with pytest.raises(RoboCorba.TooManyTransactions):
            editor.begin()
        left[-1].create("L2", wall("never"))
        clock.now += TIMEOUT_S + 1
        editor.begin().rollBack()
        with pytest.raises(RoboCorba.TransactionClosed):
            left[-1].commit()
    assert orb.active <= 64 + CLOSED_TRANSACTIONS_KEPT
    assert "never" not in [record.value._v.name for record in editor.elements(RoboCorba.WALL_ELEMENT, "L2")]


def test_servants_of_closed_transactions_are_deactivated_later(editor: MapEditorServant, orb: CountingOrb) -> None:
    still_open, ended = editor.begin(), editor.begin()
    ended.rollBack()
    for _ in range(2 * CLOSED_TRANSACTIONS_KEPT):
        editor.begin().rollBack()
    assert orb.active <= CLOSED_TRANSACTIONS_KEPT + 3
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        ended.commit()
    still_open.create("L2", wall("w"))
    assert still_open.commit() == 2


def test_servants_of_ended_sessions_are_deactivated(editor: MapEditorServant, clock: Clock, orb: CountingOrb) -> None:
    closed, abandoned = editor.openSession("Ada"), editor.openSession("Ada")
    closed.close()
    assert orb.active == 1
    clock.now += SESSION_S + 1
    for ended in (closed, abandoned):
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            ended.undo()
    for _ in range(3):
        for _ in range(64):
            last = editor.openSession("Bob")
        with pytest.raises(RoboCorba.TooManyTransactions) as refused:
            editor.openSession("Bob")
        assert (refused.value.limit, orb.active) == (64, 64)
        clock.now += SESSION_S + 1
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        last._get_undoable()


def test_a_session_speaks_in_values_of_the_domain(editor: MapEditorServant) -> None:
    ada, bob = (RemoteEditSession(editor.openSession(name), name) for name in ("Ada", "Bob"))
    made = ada.create("L2", Wall(name="a", a=(0.0, 8.0), b=(0.0, 9.0)))
    assert (ada.undoable(), ada.redoable(), bob.undoable()) == ("wall a on L2 created", "", "")
    renamed = bob.rename(ElementKind.WALL, "L2", "a", "b", made)
    with pytest.raises(EditedByOthers) as others:
        ada.undo()
    assert (others.value.kind, others.value.floor, others.value.name, others.value.author) == ("wall", "L2", "a", "Bob")
    transaction = bob.begin()
    transaction.create("L2", PathNode(name="n", at=(1.0, 1.0), elevator="E9"))
    transaction.change("L2", Wall(name="b", a=(0.0, 8.0), b=(0.0, 9.5)), renamed)
    (problem,) = transaction.problems()
    assert (problem.kind, problem.name, problem.where) == (ElementKind.NODE, "n", ("L2", 1.0, 1.0))
    transaction.remove(ElementKind.NODE, "L2", "n", 0)
    assert transaction.commit() == renamed + 1
    with pytest.raises(TransactionClosed):
        transaction.problems()
    bob.undo()
    bob.redo()
    assert [(edit.author, edit.changes, edit.summary) for edit in editor.editsSince(1)] == [
        ("Ada", 1, "wall a on L2 created"),
        ("Bob", 2, "wall a on L2 renamed to b"),
        ("Bob", 1, "wall b on L2 changed"),
        ("Bob", 1, "undone: wall b on L2 changed"),
        ("Bob", 1, "redone: wall b on L2 changed"),
    ]
    bob.close()
    bob.close()
    with pytest.raises(SessionEnded):
        bob.redo()


def test_a_picture_goes_out_as_it_came_in(editor: MapEditorServant) -> None:
    buffer = io.BytesIO()
    Image.new("L", (8, 6)).save(buffer, "PNG")
    plan = RoboCorba.Underlay(buffer.getvalue(), RoboCorba.XY(-1.0, 2.0), 0.05)
    editor.setUnderlay("L1", plan)
    assert repr(editor.getUnderlay("L1")) == repr(plan)
    editor.setUnderlay("L1", RoboCorba.Underlay(b"", RoboCorba.XY(0.0, 0.0), 0.0))
    assert editor.getUnderlay("L1").picture == b""
    with pytest.raises(RoboCorba.InvalidElement):
        editor.setUnderlay("L1", RoboCorba.Underlay(b"<svg/>", RoboCorba.XY(0.0, 0.0), 0.05))


@pytest.mark.parametrize("radius", [float("nan"), 0.04, 6.0])
def test_a_floor_is_checked_for_robots_of_sensible_size(editor: MapEditorServant, radius: float) -> None:
    assert {found.position.floor for found in editor.checkFloor("L1", 0.4)} == {"L1"}
    assert len(editor.checkFloor("L1", 1.5)) > len(editor.checkFloor("L1", 0.3))
    with pytest.raises(RoboCorba.InvalidElement):
        editor.checkFloor("L1", radius)
    with pytest.raises(RoboCorba.UnknownElement):
        editor.checkFloor("L9", 0.4)


def test_a_reply_is_limited_to_the_first_findings(editor: MapEditorServant, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [(found.id.name, found.position.floor) for found in editor.check()] == [("west", "L1"), ("east", "L1")]
    monkeypatch.setattr(map_editor, "MAX_FINDINGS", 1)
    assert [found.id.name for found in editor.check()] == ["west"]


def test_a_map_that_is_too_large_is_refused_as_a_map(tmp_path: Path, orb: CountingOrb) -> None:
    """InvalidElement is not among the exceptions of importMap: it would reach the client as UNKNOWN."""
    larger = two_floors()
    for number in range(20):
        larger = larger.with_element("L2", Wall(name=f"w{number}", a=(0.0, number), b=(1.0, number)))
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        editor = MapEditorServant(EditSessions(BuildingEditor(store, MapLimits(building_size=10))), orb)
        with pytest.raises(RoboCorba.InvalidMap) as refused:
            editor.importMap(native.dumps(larger), 1)
        assert refused.value.reason.endswith("the building would have more than 10 elements and points")
        assert editor._get_currentVersion() == 1
