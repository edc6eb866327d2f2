"""The map editor's servant, and copies of the building elsewhere, also while others edit it or the editor ends."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from omniORB import CORBA
from PIL import Image

from robocorba.errors.maps import EditedByOthers, SessionEnded, TransactionClosed, UnknownElement, VersionUnavailable
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor import native
from robocorba.map_editor.corba import map_editor_servant as map_editor
from robocorba.map_editor.corba import maps
from robocorba.map_editor.corba.map_editor_servant import CLOSED_TRANSACTIONS_KEPT, MapEditorServant
from robocorba.map_editor.corba.remote_edit_session import RemoteEditSession, RemoteMapEditor
from robocorba.map_editor.corba.remote_map import RemoteFloorMap, RemoteMap
from robocorba.map_editor.edit_session import EditSessions
from robocorba.map_editor.map_building_agent import BuildingEditor
from robocorba.map_editor.model import BoxShape, ElementKind, MapObject, PathNode, Wall
from robocorba.map_editor.pages import ChangePosition
from robocorba.map_editor.proposals import Proposals
from robocorba.map_editor.store import MapLimits, MapStore
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.buildings import two_floors
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


def servant_of(editor: BuildingEditor, activator: Any, clock: Callable[[], float] = time.monotonic) -> MapEditorServant:
    """The map editor, with proposals."""
    proposals = Proposals(editor.snapshot)
    editor.subscribe(proposals.follow)
    return MapEditorServant(EditSessions(editor, clock=clock), proposals, activator)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def counting(orb: Orb) -> CountingOrb:
    return CountingOrb(orb)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MapStore]:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        yield store


@pytest.fixture
def servant(store: MapStore, clock: Clock, counting: CountingOrb) -> MapEditorServant:
    editor = BuildingEditor(store, MapLimits(transaction_timeout_s=TIMEOUT_S), clock)
    return servant_of(editor, counting, clock)


def test_abandoned_and_closed_transactions_end(servant: MapEditorServant, clock: Clock, counting: CountingOrb) -> None:
    for _ in range(5):
        left = [servant.begin() for _ in range(32)]
        with pytest.raises(RoboCorba.TooManyTransactions):
            servant.begin()
        left[-1].create("L2", wall("never"))
        clock.now += TIMEOUT_S + 1
        servant.begin().rollBack()
        with pytest.raises(RoboCorba.TransactionClosed):
            left[-1].commit()
    assert "never" not in [record.value._v.name for record in servant.elements(RoboCorba.WALL_ELEMENT, "L2")]
    still_open, ended = servant.begin(), servant.begin()
    ended.rollBack()
    for _ in range(2 * CLOSED_TRANSACTIONS_KEPT):
        servant.begin().rollBack()
    assert counting.active <= CLOSED_TRANSACTIONS_KEPT + 3
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        ended.commit()
    still_open.create("L2", wall("w"))
    assert still_open.commit() == 2


def test_a_session_speaks_in_values_of_the_domain(servant: MapEditorServant) -> None:
    ada, bob = (RemoteEditSession(servant.openSession(name), name) for name in ("Ada", "Bob"))
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
    assert [(edit.author, edit.changes, edit.summary) for edit in servant.editsSince(1)] == [
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


def test_pictures_and_findings_of_a_floor(servant: MapEditorServant, monkeypatch: pytest.MonkeyPatch) -> None:
    buffer = io.BytesIO()
    Image.new("L", (8, 6)).save(buffer, "PNG")
    plan = RoboCorba.Underlay(buffer.getvalue(), RoboCorba.XY(-1.0, 2.0), 0.05)
    servant.setUnderlay("L1", plan)
    assert repr(servant.getUnderlay("L1")) == repr(plan)
    servant.setUnderlay("L1", RoboCorba.Underlay(b"", RoboCorba.XY(0.0, 0.0), 0.0))
    assert servant.getUnderlay("L1").picture == b""
    with pytest.raises(RoboCorba.InvalidElement):
        servant.setUnderlay("L1", RoboCorba.Underlay(b"<svg/>", RoboCorba.XY(0.0, 0.0), 0.05))
    assert {found.position.floor for found in servant.checkFloor("L1", 0.4)} == {"L1"}
    assert len(servant.checkFloor("L1", 1.5)) > len(servant.checkFloor("L1", 0.3))
    for radius in (math.nan, 0.04, 6.0):
        with pytest.raises(RoboCorba.InvalidElement):
            servant.checkFloor("L1", radius)
    with pytest.raises(RoboCorba.UnknownElement):
        servant.checkFloor("L9", 0.4)
    assert [(found.id.name, found.position.floor) for found in servant.check()] == [("west", "L1"), ("east", "L1")]
    monkeypatch.setattr(map_editor, "MAX_FINDINGS", 1)
    assert [found.id.name for found in servant.check()] == ["west"]


def test_a_proposal_is_accepted_as_an_edit_of_its_author_or_rejected(servant: MapEditorServant) -> None:
    corners = [RoboCorba.XY(*point) for point in ((1.0, 1.0), (1.6, 1.0), (1.6, 1.4), (1.0, 1.4))]
    name = servant.propose("L1", corners, 0.75, "camera 3")
    (offered,) = servant.proposals()
    assert (offered.name, offered.onFloor, offered.certainty, offered.seenBy) == (name, "L1", 0.75, ["camera 3"])
    assert {(point.x, point.y) for point in offered.outline} == {(point.x, point.y) for point in corners}
    session = RemoteEditSession(servant.openSession("Ada"), "Ada")
    session.accept_proposal(name)
    drawn = maps.element_of(servant.read(maps.element_id("object", "L1", name)).value)
    assert isinstance(drawn, MapObject) and drawn.at == pytest.approx((1.3, 1.2)) and not drawn.movable
    assert servant.proposals() == []
    assert [edit.author for edit in servant.editsSince(1)] == ["Ada"]
    with pytest.raises(UnknownElement):
        session.accept_proposal(name)
    session.undo()
    again = servant.propose("L1", corners, 0.75, "camera 3")
    servant.rejectProposal(again)
    assert servant.proposals() == []
    for refused in (lambda: servant.rejectProposal(again), lambda: servant.propose("L9", corners, 0.75, "camera 3")):
        with pytest.raises(RoboCorba.UnknownElement):
            refused()


def test_a_map_that_is_too_large_is_refused_as_a_map(store: MapStore, orb: Orb) -> None:
    """InvalidElement is not among the exceptions of importMap: it would reach the client as UNKNOWN."""
    larger = two_floors()
    for number in range(20):
        larger = larger.with_element("L2", Wall(name=f"w{number}", a=(0.0, number), b=(1.0, number)))
    servant = servant_of(BuildingEditor(store, MapLimits(building_size=10)), orb)
    with pytest.raises(RoboCorba.InvalidMap) as refused:
        servant.importMap(native.dumps(larger), 1)
    assert refused.value.reason.endswith("the building would have more than 10 elements and points")
    assert servant._get_currentVersion() == 1


class Editor:
    """An ORB that resolves the map editor. meanwhile: called when the last elements are read, at the end of loading.

    limit: of elements and changes in a page. pages: of elements, so far. fails_after: the number of pages of changes
    after which it does not answer; negative for never."""

    def __init__(self, editor: BuildingEditor, activator: Any = None) -> None:
        self.editor, self._servant = editor, servant_of(editor, activator)
        self.meanwhile: Callable[[], object] = int
        self.limit, self.pages, self.fails_after = 2, 0, -1

    def resolve(self, *_: object) -> Editor:
        return self

    def readElements(self, start: int, part: Any, limit: int) -> Any:
        page = self._servant.readElements(start, part, self.limit)
        if page.isLast:
            self.meanwhile()
        self.pages += 1
        return page

    def readChanges(self, start: Any, part: Any, limit: int) -> Any:
        if self.fails_after == 0:
            raise CORBA.COMM_FAILURE(0, CORBA.COMPLETED_NO)
        self.fails_after -= 1
        return self._servant.readChanges(start, part, self.limit)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._servant, name)


@pytest.fixture
def place(store: MapStore) -> Any:
    return Editor(BuildingEditor(store))


def test_the_whole_building_is_read_while_others_edit_it(place: Any) -> None:
    def edit() -> None:
        place.editor.create("L1", Wall(name="late", a=(2.0, 1.0), b=(2.0, 2.0)))
        place.editor.create("L2", PathNode(name="late", at=(1.0, 1.0)))

    remote = RemoteMapEditor(place)
    assert remote.building() == place.editor.snapshot
    place.meanwhile = edit
    building, version = remote.building()
    assert (building, version) == place.editor.snapshot
    assert version == 3
    assert "late" in building.floors["L2"].topological.nodes
    place.meanwhile, place.fails_after = int, 0
    with pytest.raises(NotReachable, match="can't be loaded from the map editor"):
        RemoteMap(place)


def many_nodes(count: int) -> list[PathNode]:
    return [PathNode(name=f"n{number}", at=(float(number), 20.0)) for number in range(count)]


def create_all(place: Any, nodes: list[PathNode]) -> None:
    transaction = place.editor.begin()
    for node in nodes:
        transaction.create("L2", node)
    transaction.commit()


def test_a_large_edit_is_followed_in_pages_and_appears_at_once(place: Any) -> None:
    copy = RemoteMap(place, with_topology=True)
    assert (copy.building, copy.version) == place.editor.snapshot
    assert not copy.follow()
    before, loaded_pages = copy.building, place.pages
    create_all(place, many_nodes(9))
    place.fails_after = 2
    with pytest.raises(NotReachable):
        copy.follow()
    assert (copy.building, copy.version) == (before, 1)
    place.fails_after = 3  # it continues: five pages in all
    assert copy.follow()
    assert place.fails_after == 0
    assert (copy.building, copy.version) == place.editor.snapshot
    assert place.pages == loaded_pages


def test_copies_without_topology_are_loaded_again_only_for_obstacles(place: Any) -> None:
    copy, source = RemoteMap(place), RemoteFloorMap(place)
    first = source.of("L1")
    assert first.floors["L1"].geometrical.walls == place.editor.building.floors["L1"].geometrical.walls
    assert (list(first.floors), first.elevators) == (["L1"], place.editor.building.elevators)
    create_all(place, many_nodes(9))
    place.fails_after = 1
    assert copy.follow()
    place.fails_after = -1
    assert copy.version == place.editor.version
    assert copy.building.floors["L2"].geometrical == place.editor.building.floors["L2"].geometrical
    place.editor.create("L2", Wall(name="elsewhere", a=(2.0, 1.0), b=(2.0, 2.0)))
    assert source.of("L1") is first
    place.editor.create("L1", Wall(name="here", a=(2.0, 1.0), b=(2.0, 2.0)))
    assert "here" in source.of("L1").floors["L1"].geometrical.walls
    with pytest.raises(UnknownFloor):
        source.of("L9")


@pytest.mark.parametrize("cause", ["far behind", "history lost"])
def test_a_copy_that_is_far_behind_is_loaded_again(place: Any, monkeypatch: pytest.MonkeyPatch, cause: str) -> None:
    copy = RemoteMap(place, with_topology=True)
    loaded_pages = place.pages
    if cause == "far behind":
        monkeypatch.setattr("robocorba.map_editor.corba.remote_map.MAX_PAGE", 5)
    else:
        copy._next = ChangePosition(0)  # as if it had missed ten thousand edits
    create_all(place, many_nodes(100 if cause == "far behind" else 1))
    assert copy.follow()
    assert (copy.building, copy.version) == place.editor.snapshot
    assert place.pages > loaded_pages
    place.editor.create("L2", PathNode(name="later", at=(2.0, 1.0)))
    assert copy.follow()
    assert (copy.building, copy.version) == place.editor.snapshot


def test_facts_travel_beside_the_structs_of_the_first_release(store: MapStore, orb: Orb) -> None:
    place: Any = Editor(BuildingEditor(store), orb)
    remote, copy = RemoteMapEditor(place), RemoteMap(place)
    session = remote.open_session("Ada")
    cart = MapObject("cart", BoxShape((1.0, 1.0)), (13.0, 2.0), movable=True, mass=12.5)
    made = session.create("L1", cart)
    assert remote.read(ElementKind.OBJECT, "L1", "cart") == (cart, made)
    assert copy.follow() and copy.building.find(ElementKind.OBJECT, "L1", "cart") == cart

    editor = place.resolve("MapEditor", RoboCorba.MapEditor)
    moved = editor.read(maps.element_id("object", "L1", "cart")).value  # a client that does not know of masses
    moved._v.height = 2.0
    version = editor.change("L1", moved, made)
    assert place.editor.read(ElementKind.OBJECT, "L1", "cart")[0] == msgspec.structs.replace(cart, height=2.0)
    fact = editor.readFacts(RoboCorba.MapSelection([], ""))[0]
    assert (fact.id.name, fact.key, fact.value) == ("cart", "mass", "12.5")
    for key, value, reason in (("mass", "20000", "must be from 0.1"), ("mass", "x", "no"), ("colour", "x", "no fact")):
        with pytest.raises(RoboCorba.InvalidElement) as refused:
            editor.setFact(RoboCorba.ElementFact(fact.id, key, value), version)
        assert reason in refused.value.reason
    version = editor.setFact(RoboCorba.ElementFact(fact.id, "mass", "0"), version)
    assert copy.follow() and copy.building.find(ElementKind.OBJECT, "L1", "cart").mass == 0.0  # type: ignore[union-attr]
    assert editor.readFacts(RoboCorba.MapSelection([], "")) == []

    room, at = remote.read(ElementKind.AREA, "L1", "room")
    session.change("L1", msgspec.structs.replace(room, gateway="10.0.0.1"), at)
    assert copy.follow() and copy.building.find(ElementKind.AREA, "L1", "room").gateway == "10.0.0.1"  # type: ignore[union-attr]
    session.undo()
    assert copy.follow() and copy.building.find(ElementKind.AREA, "L1", "room") == room
    assert RemoteMap(place).building == copy.building


def test_pages_of_the_editing_client(place: Any) -> None:
    remote = RemoteMapEditor(place)
    create_all(place, many_nodes(5))
    assert remote.elements(ElementKind.NODE, "L2") == place.editor.elements(ElementKind.NODE, "L2")
    assert [change.element for change in remote.changes_since(1)] == many_nodes(5)
    assert remote.elements(ElementKind.AREA, "L2") == []
    with pytest.raises(UnknownElement):
        remote.elements(ElementKind.NODE, "L9")
    with pytest.raises(VersionUnavailable):
        remote.changes_since(0)
