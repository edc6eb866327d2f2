"""Every operation of the map editor over the wire, and every exception with its fields."""

from __future__ import annotations

import io
import os
import signal
from typing import Any

import pytest
from PIL import Image

from robocorba.corba.orb import Orb
from robocorba.corba.remote.edit_session import RemoteEditSession, RemoteMapEditor
from robocorba.errors.maps import (
    EditedByOthers,
    InvalidElement,
    NothingToRedo,
    SessionEnded,
    TooManyTransactions,
    TransactionClosed,
    UnknownElement,
)
from robocorba.errors.services import NotReachable
from robocorba.maps import native
from robocorba.maps.changes import ChangeKind
from robocorba.maps.model import ElementKind, PathNode, Wall
from robocorba.maps.underlays import Underlay
from robocorba.stubs import RoboCorba
from robocorba.testing.buildings import two_floors
from robocorba.testing.processes import Running, eventually
from tests.system.elements import XY, all_elements, examples, id_of, replay, wall

pytestmark = pytest.mark.system

NAME = "名前 Ж\N{GRINNING FACE}"
WEST, EAST = RoboCorba.Point("L1", 5.0, 5.0), RoboCorba.Point("L1", 15.0, 5.0)


@pytest.fixture(scope="module")
def editor(system_orb: Orb) -> Any:
    return system_orb.resolve("MapEditor", RoboCorba.MapEditor)


@pytest.fixture(scope="module")
def planner(system_orb: Orb) -> Any:
    return system_orb.resolve("PathPlanner", RoboCorba.PathPlanner)


def words(id: Any) -> tuple[str, str, str]:
    return str(id.kind), id.onFloor, id.name


@pytest.mark.parametrize("kind", examples(""))
def test_each_kind_is_created_read_changed_and_removed(editor: Any, kind: str) -> None:
    floor, value, changed = examples(NAME)[kind]
    id = id_of(floor, value)
    began = editor._get_currentVersion()

    first = editor.create(floor, value)
    assert first == began + 1 == editor._get_currentVersion()
    record = editor.read(id)
    assert (record.onFloor, repr(record.value), record.changedAt) == (floor, repr(value), first)
    with pytest.raises(RoboCorba.DuplicateElement) as duplicate:
        editor.create(floor, changed)
    assert words(duplicate.value.id) == (kind, floor, NAME)

    second = editor.change(floor, changed, first)
    (record,) = [found for found in editor.elements(value._d, floor) if found.value._v.name == NAME]
    assert (record.onFloor, repr(record.value), record.changedAt) == (floor, repr(changed), second)
    for stale in (lambda: editor.change(floor, value, first), lambda: editor.remove(id, first)):
        with pytest.raises(RoboCorba.StaleEdit) as refused:
            stale()
        assert words(refused.value.id) == (kind, floor, NAME)
        assert (refused.value.expected, refused.value.current) == (first, second)

    third = editor.remove(id, second)
    for missing in (
        lambda: editor.read(id),
        lambda: editor.change(floor, value, second),
        lambda: editor.remove(id, second),
    ):
        with pytest.raises(RoboCorba.UnknownElement) as unknown:
            missing()
        assert words(unknown.value.id) == (kind, floor, NAME)
    assert [
        (change.changedTo, str(change.kind), change.onFloor, repr(change.value))
        for change in editor.changesSince(began)
    ] == [
        (first, "CREATED", floor, repr(value)),
        (second, "CHANGED", floor, repr(changed)),
        (third, "REMOVED", floor, repr(changed)),
    ]


def test_what_there_is(editor: Any) -> None:
    assert editor._get_buildingName() == "two floors"
    assert editor.floors() == ["L1", "L2"]
    assert [record.value._v.name for record in editor.elements(RoboCorba.NODE_ELEMENT, "L1")] == [
        *("west", "east", "lift1")
    ]


def test_an_unknown_floor_is_named(editor: Any) -> None:
    for call in (
        lambda: editor.elements(RoboCorba.WALL_ELEMENT, "L9"),
        lambda: editor.create("L9", wall("w")),
        lambda: editor.buildTopologicalMap("L9", 0.4),
    ):
        with pytest.raises(RoboCorba.UnknownElement) as unknown:
            call()
        assert words(unknown.value.id) == ("FLOOR_ELEMENT", "", "L9")


def test_what_breaks_a_rule_is_refused_with_its_reason(editor: Any) -> None:
    began = editor._get_currentVersion()
    on_wall = RoboCorba.Element(aNode=RoboCorba.PathNode("n", XY(10.0, 2.0), ""))
    with pytest.raises(RoboCorba.InvalidElement) as refused:
        editor.create("L1", on_wall)
    assert words(refused.value.id) == ("NODE_ELEMENT", "L1", "n")
    assert refused.value.reason == "it stands on wall 'w'"
    needed = editor.read(RoboCorba.ElementId(RoboCorba.NODE_ELEMENT, "L1", "west"))
    with pytest.raises(RoboCorba.InvalidElement) as refused:
        editor.remove(id_of("L1", needed.value), needed.changedAt)
    assert words(refused.value.id) == ("EDGE_ELEMENT", "L1", "west-east")
    assert refused.value.reason == "node 'west' does not exist on this floor"
    assert editor._get_currentVersion() == began


def test_a_floor_goes_with_all_that_is_on_it(editor: Any) -> None:
    before = all_elements(editor)
    began = editor._get_currentVersion()
    floor = RoboCorba.Element(aFloor=RoboCorba.Floor("roof", 9, 30.0, 3.0, []))
    made = editor.create("", floor)
    editor.create("roof", wall("w"))
    editor.remove(id_of("", floor), made)
    assert "roof" not in editor.floors()
    assert [str(change.kind) for change in editor.changesSince(began)] == ["CREATED", "CREATED", "REMOVED", "REMOVED"]
    assert all_elements(editor) == before


def test_a_transaction_is_one_edit(editor: Any) -> None:
    began = editor._get_currentVersion()
    transaction = editor.begin()
    node = RoboCorba.Element(aNode=RoboCorba.PathNode("n", XY(15.0, 8.0), ""))
    transaction.create("L2", RoboCorba.Element(anEdge=RoboCorba.PathEdge("e", "n", "top", False, 0.0, 0.0, [])))
    transaction.create("L2", node)
    transaction.create("L2", wall("gone"))
    transaction.change("L2", wall("gone", height=1.0), 0)
    transaction.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L2", "gone"), 0)
    assert editor._get_currentVersion() == began
    with pytest.raises(RoboCorba.UnknownElement):
        editor.read(id_of("L2", node))
    assert transaction.commit() == began + 1
    made = editor.changesSince(began)
    assert sorted((change.changedTo, change.value._v.name) for change in made) == [(began + 1, "e"), (began + 1, "n")]
    assert editor.undo(began + 1) == began + 2
    with pytest.raises(RoboCorba.UnknownElement):
        editor.read(id_of("L2", node))


def test_a_transaction_sees_the_exceptions_of_an_edit(editor: Any) -> None:
    first = editor.create("L2", wall("there"))
    transaction = editor.begin()
    with pytest.raises(RoboCorba.DuplicateElement):
        transaction.create("L2", wall("there"))
    with pytest.raises(RoboCorba.UnknownElement):
        transaction.create("L9", wall("w"))
    with pytest.raises(RoboCorba.UnknownElement):
        transaction.change("L2", wall("nowhere"), first)
    with pytest.raises(RoboCorba.InvalidElement):
        transaction.change("L2", wall("there", height=-1.0), first)
    with pytest.raises(RoboCorba.StaleEdit) as stale:
        transaction.remove(id_of("L2", wall("there")), first - 1)
    assert (stale.value.expected, stale.value.current) == (first - 1, first)
    transaction.remove(id_of("L2", wall("there")), first)
    assert transaction.commit() == first + 1


@pytest.mark.parametrize("end", ["commit", "rollBack", "failed commit"])
def test_an_ended_transaction_says_so(editor: Any, end: str) -> None:
    began = editor._get_currentVersion()
    transaction = editor.begin()
    if end == "failed commit":
        transaction.create("L2", RoboCorba.Element(anEdge=RoboCorba.PathEdge("e", "a", "b", False, 0.0, 0.0, [])))
        with pytest.raises(RoboCorba.InvalidElement) as refused:
            transaction.commit()
        assert (words(refused.value.id), refused.value.reason) == (
            ("EDGE_ELEMENT", "L2", "e"),
            "node 'a' does not exist on this floor",
        )
    else:
        getattr(transaction, end)()
    for again in (
        lambda: transaction.create("L2", wall("w")),
        lambda: transaction.change("L2", wall("w"), 1),
        lambda: transaction.remove(id_of("L2", wall("w")), 1),
        transaction.commit,
        transaction.rollBack,
    ):
        with pytest.raises(RoboCorba.TransactionClosed):
            again()
    assert editor._get_currentVersion() == began


def test_a_transaction_is_refused_where_another_editor_was_faster(editor: Any) -> None:
    first = editor.create("L2", wall("contested"))
    changing, creating, removing = editor.begin(), editor.begin(), editor.begin()
    changing.change("L2", wall("contested", height=1.0), first)
    creating.create("L2", wall("new"))
    removing.remove(id_of("L2", wall("contested")), first)
    second = editor.change("L2", wall("contested", height=2.0), first)
    third = editor.create("L2", wall("new"))
    with pytest.raises(RoboCorba.StaleEdit) as stale:
        changing.commit()
    assert (stale.value.expected, stale.value.current) == (first, second)
    with pytest.raises(RoboCorba.DuplicateElement) as duplicate:
        creating.commit()
    assert words(duplicate.value.id) == ("WALL_ELEMENT", "L2", "new")
    editor.remove(id_of("L2", wall("contested")), second)
    with pytest.raises(RoboCorba.UnknownElement):
        removing.commit()
    editor.remove(id_of("L2", wall("new")), third)


def test_at_most_64_transactions_are_open(editor: Any) -> None:
    """Those without a session are 32 at most, so that a session has room."""
    ada, bob = editor.openSession("Ada"), editor.openSession("Bob")
    for _ in range(3):  # those that ended leave room for as many again
        opened = []
        for client, limit in ((editor, 32), (ada, 32), (bob, 64)):
            opened += [client.begin() for _ in range(32 if limit == 32 else 0)]
            with pytest.raises(RoboCorba.TooManyTransactions) as refused:
                client.begin()
            assert refused.value.limit == limit
        for transaction in opened:
            transaction.rollBack()
    ada.close()
    bob.close()


def test_undo_goes_back_to_the_beginning_and_redo_forward_again(editor: Any) -> None:
    editor.create("L2", wall("last"))
    after = all_elements(editor)
    undone = 0
    while True:
        version = editor._get_currentVersion()
        try:
            assert editor.undo(version) == version + 1
        except RoboCorba.NothingToUndo:
            break
        undone += 1
    assert undone > 0
    assert native.loads(editor.exportMap()) == two_floors()
    for _ in range(undone):
        assert editor.redo(version) == version + 1
        version += 1
    assert all_elements(editor) == after
    with pytest.raises(RoboCorba.NothingToRedo):
        editor.redo(version)
    for step in (editor.undo, editor.redo):
        with pytest.raises(RoboCorba.StaleVersion) as stale:
            step(version - 1)
        assert (stale.value.expected, stale.value.current) == (version - 1, version)


def test_changes_of_the_future_are_not_there(editor: Any) -> None:
    current = editor._get_currentVersion()
    assert editor.changesSince(current) == []
    with pytest.raises(RoboCorba.VersionUnavailable) as unavailable:
        editor.changesSince(current + 1)
    assert (unavailable.value.asked, unavailable.value.current) == (current + 1, current)
    with pytest.raises(RoboCorba.VersionUnavailable) as unavailable:
        editor.changesSince(0)
    assert (unavailable.value.asked, unavailable.value.oldest) == (0, 1)


def test_elements_and_changes_come_in_pages(editor: Any) -> None:
    began = editor._get_currentVersion()
    editor.remove(id_of("L2", wall("paged")), editor.create("L2", wall("paged")))
    everything, start, records = RoboCorba.MapSelection([], ""), 0, []
    while True:
        page = editor.readElements(start, everything, 2)
        assert (len(page.elements) <= 2, page.readAt) == (True, began + 2)
        records += page.elements
        start = page.next
        if page.isLast:
            break
    found = {(str(each.value._d), each.onFloor, each.value._v.name): repr(each.value) for each in records}
    assert (len(found), found) == (len(records), all_elements(editor))
    walls = RoboCorba.MapSelection([RoboCorba.WALL_ELEMENT], "L2")
    page = editor.readChanges(RoboCorba.ChangePosition(began, 0), walls, 1)
    assert ([str(change.kind) for change in page.changes], page.isLast, page.left) == (["CREATED"], False, 1)
    page = editor.readChanges(page.next, walls, 0)
    assert ([str(change.kind) for change in page.changes], page.isLast) == (["REMOVED"], True)
    assert (page.next.since, page.next.taken, page.left) == (began + 2, 0, 0)
    with pytest.raises(RoboCorba.VersionUnavailable):
        editor.readChanges(RoboCorba.ChangePosition(2**64 - 1, 2**32 - 1), everything, 2**32 - 1)
    assert editor.readElements(2**64 - 1, everything, 2**32 - 1).isLast


def test_the_map_goes_out_and_in_as_text(editor: Any) -> None:
    before, began = all_elements(editor), editor._get_currentVersion()
    document = editor.exportMap()
    assert editor.importMap(document, began) == began  # nothing differs
    renamed = document.replace("two floors", "二つの階 ё", 1).replace("from: [10.0, 0.0]", "from: [10.0, 0.5]")
    assert renamed.count("10.0, 0.5") == 1
    with pytest.raises(RoboCorba.StaleVersion) as stale:
        editor.importMap(renamed, began - 1)
    assert (stale.value.expected, stale.value.current) == (began - 1, began)
    assert editor.importMap(renamed, began) == began + 1
    assert editor._get_buildingName() == "二つの階 ё"
    assert editor.read(id_of("L1", wall("w"))).value._v.fromPoint.y == 0.5
    assert replay(before, editor.changesSince(began)) == all_elements(editor)
    assert editor.undo(began + 1) == began + 2
    assert (editor._get_buildingName(), editor.exportMap()) == ("two floors", document)


def test_a_wrong_map_is_refused_with_line_and_key(editor: Any) -> None:
    began = editor._get_currentVersion()
    with pytest.raises(RoboCorba.InvalidMap) as refused:
        editor.importMap("robocorba: 1\nname: x\nfloors:\n- {name: a, level: 1, elevation: .nan}\n", began)
    assert (refused.value.line, refused.value.key) == (4, "floors[0]")
    assert refused.value.reason == "floor 'a': elevation is not a finite number"
    assert editor._get_currentVersion() == began


def test_a_topological_map_is_drawn_as_one_edit(editor: Any) -> None:
    before, began = all_elements(editor), editor._get_currentVersion()
    assert editor.buildTopologicalMap("L1", 0.4) == began + 1
    assert replay(before, editor.changesSince(began)) == all_elements(editor) != before
    editor.undo(began + 1)
    assert all_elements(editor) == before


@pytest.mark.parametrize("radius", [50.0, 0.0, -1.0, float("nan"), float("inf"), 1e308])
def test_no_topological_map_for_a_radius_that_fits_nowhere(editor: Any, radius: float) -> None:
    began = editor._get_currentVersion()
    with pytest.raises(RoboCorba.InvalidElement) as refused:
        editor.buildTopologicalMap("L1", radius)
    assert words(refused.value.id) == ("FLOOR_ELEMENT", "", "L1")
    assert refused.value.reason
    assert editor._get_currentVersion() == began


def lock(editor: Any, locked: bool) -> int:
    """Lock or unlock door d of L1, through which the edge west-east leads."""
    door = editor.read(RoboCorba.ElementId(RoboCorba.DOOR_ELEMENT, "L1", "d"))
    door.value._v.locked = locked
    return editor.change("L1", door.value, door.changedAt)


def test_an_edit_is_seen_by_the_next_path(editor: Any, planner: Any) -> None:
    for _ in range(10):
        version = lock(editor, True)
        with pytest.raises(RoboCorba.NoPath) as refused:
            planner.getPath(WEST, EAST)
        (blocker,) = refused.value.blockers
        assert (str(blocker.id.kind), blocker.id.name, blocker.reason) == ("DOOR_ELEMENT", "d", "is locked")
        assert planner._get_mapVersion() == version
        version = lock(editor, False)
        (path,) = planner.findPaths(planner.defaultRequest(WEST, EAST))
        assert path.mapVersion == version
        assert (str(path.points[0].kind), str(path.points[-1].kind)) == ("START", "GOAL")


def test_an_edge_is_blocked_while_its_door_is_locked(editor: Any, planner: Any, system: Running) -> None:
    def blocked() -> list[tuple[str, str, str, float, float, str]]:
        return [
            (str(found.id.kind), found.id.name, *vars(found.position).values(), found.reason)
            for found in editor.check()
            if found.reason.startswith("blocked")
        ]

    assert blocked() == []
    assert [found.id.name for found in editor.check()] == ["west", "east"]  # no edge leads back from the elevator
    (direct,) = planner.findPaths(planner.defaultRequest(WEST, EAST))
    version = lock(editor, True)
    reason = "it leads through locked door 'd' near 10, 5"
    assert blocked() == [("EDGE_ELEMENT", "west-east", "L1", 10.0, 5.0, f"blocked: {reason}")]
    log = (system.state / "logs" / "map_editor.log").read_text()
    assert f"version {version} blocks edge 'west-east' on L1: {reason}\n" in log
    with pytest.raises(RoboCorba.NoPath):
        planner.getPath(WEST, EAST)
    edge = editor.read(RoboCorba.ElementId(RoboCorba.EDGE_ELEMENT, "L1", "west-east"))
    edge.value._v.speedLimit = 0.5
    changed = editor.change("L1", edge.value, edge.changedAt)
    again = RoboCorba.Element(anEdge=RoboCorba.PathEdge("again", "west", "east", False, 0.0, 0.0, []))
    with pytest.raises(RoboCorba.InvalidElement) as refused:
        editor.create("L1", again)
    assert words(refused.value.id) == ("EDGE_ELEMENT", "L1", "again")

    around = editor.begin()
    around.create(
        "L1", RoboCorba.Element(aDoor=RoboCorba.Door("d2", XY(10.0, 1.0), XY(10.0, 2.5), RoboCorba.HINGED, False))
    )
    around.create("L1", RoboCorba.Element(aNode=RoboCorba.PathNode("west2", XY(8.0, 1.75), "")))
    around.create("L1", RoboCorba.Element(aNode=RoboCorba.PathNode("east2", XY(12.0, 1.75), "")))
    for a, b in (("west", "west2"), ("west2", "east2"), ("east2", "east")):
        around.create("L1", RoboCorba.Element(anEdge=RoboCorba.PathEdge(f"{a}-{b}", a, b, False, 0.0, 0.0, [])))
    version = around.commit()
    (longer,) = planner.findPaths(planner.defaultRequest(WEST, EAST))
    assert longer.distance > direct.distance + 1.0
    assert min(point.position.y for point in longer.points) < 2.5

    lock(editor, False)
    assert blocked() == []
    editor.undo(version + 1)
    editor.undo(version + 2)  # the way around
    editor.undo(version + 3)  # the speed limit
    editor.undo(version + 4)  # the lock
    assert blocked() == []
    (path,) = planner.findPaths(planner.defaultRequest(WEST, EAST))
    assert path.distance == direct.distance and changed < path.mapVersion


def short_wall(name: str, x: float = 0.5) -> Wall:
    """A wall far from all nodes and edges."""
    return Wall(name=name, a=(x, 8.5), b=(x, 9.5))


def test_two_authors_share_a_map(system_orb: Orb) -> None:
    remote = RemoteMapEditor(system_orb)
    before, began = remote.building()
    ada, bob = remote.open_session("Ada Ж"), remote.open_session("Bob")
    made = ada.create("L2", short_wall("a"))
    bob.create("L2", short_wall("b"))
    ada.create("L2", short_wall("c"))
    assert (ada.author, ada.undoable(), ada.redoable()) == ("Ada Ж", "wall c on L2 created", "")
    ada.undo()
    assert ada.redoable() == "wall c on L2 created"
    changed = bob.change("L2", short_wall("a", 0.75), made)
    with pytest.raises(EditedByOthers) as refused:
        ada.undo()
    assert (refused.value.kind, refused.value.name, refused.value.author) == ("wall", "a", "Bob")
    assert remote.read(ElementKind.WALL, "L2", "a") == (short_wall("a", 0.75), changed)
    assert bob.rename(ElementKind.WALL, "L2", "a", "z", changed) == changed + 1
    transaction = bob.begin()
    transaction.create("L2", PathNode(name="n", at=(1.0, 1.0), elevator="E9"))
    (problem,) = transaction.problems()
    assert (problem.name, problem.where) == ("n", ("L2", 1.0, 1.0))
    assert problem.reason == "it names elevator 'E9', which does not exist"
    transaction.roll_back()
    with pytest.raises(TransactionClosed):
        transaction.problems()
    assert [(edit.author, edit.summary) for edit in remote.edits_since(began)] == [
        ("Ada Ж", "wall a on L2 created"),
        ("Bob", "wall b on L2 created"),
        ("Ada Ж", "wall c on L2 created"),
        ("Ada Ж", "undone: wall c on L2 created"),
        ("Bob", "wall a on L2 changed"),
        ("Bob", "wall a on L2 renamed to z"),
    ]
    assert [change.kind for change in remote.changes_since(changed)] == [ChangeKind.REMOVED, ChangeKind.CREATED]
    ada.redo()
    with pytest.raises(NothingToRedo):
        ada.redo()
    ada.undo()
    for _ in range(3):
        bob.undo()
    after, version = remote.building()
    assert after == before.with_element("L2", short_wall("a"))
    remote_edit = remote.open_session("Eve")
    remote_edit.remove(ElementKind.WALL, "L2", "a", remote.read(ElementKind.WALL, "L2", "a")[1])
    assert remote.version() == version + 1
    for session in (ada, bob, remote_edit):
        session.close()
        session.close()
        with pytest.raises(SessionEnded):
            session.undoable()


def test_sessions_are_bounded_and_named(system_orb: Orb) -> None:
    remote = RemoteMapEditor(system_orb)
    with pytest.raises(InvalidElement, match="the author's name is empty"):
        remote.open_session("")
    opened: list[RemoteEditSession] = []
    with pytest.raises(TooManyTransactions):
        while len(opened) < 100:
            opened.append(remote.open_session("Ada"))
    assert len(opened) == 64
    for session in opened:
        session.close()


def test_a_floor_is_checked_for_a_robot_of_any_size(system_orb: Orb) -> None:
    remote = RemoteMapEditor(system_orb)
    assert {finding.where[0] for finding in remote.check_floor("L1", 1.5)} == {"L1"}
    assert len(remote.check_floor("L1", 1.5)) > len(remote.check_floor("L1", 0.3))
    with pytest.raises(UnknownElement):
        remote.check_floor("L9", 0.4)
    for radius in (float("nan"), 0.0, 6.0):
        with pytest.raises(InvalidElement, match="the radius of the robot must be from"):
            remote.check_floor("L1", radius)


def test_authors_and_pictures_survive_a_kill(system_orb: Orb, system: Running) -> None:
    remote = RemoteMapEditor(system_orb)
    buffer = io.BytesIO()
    Image.effect_noise((2000, 1500), 80).save(buffer, "PNG")
    plan = Underlay(buffer.getvalue(), (-1.0, 2.5), 0.02)
    assert remote.underlay("L1") is None
    began = remote.version()
    ada = remote.open_session("Ada")
    ada.create("L2", short_wall("kept"))
    remote.set_underlay("L1", plan)
    pid = system.pid("map_editor")
    os.kill(pid, signal.SIGKILL)
    eventually(lambda: system.pid("map_editor") not in (0, pid), 30.0, "restarted")

    def edits() -> list[tuple[str, str]]:
        try:
            return [(edit.author, edit.summary) for edit in remote.edits_since(began)]
        except NotReachable:
            return []

    assert eventually(edits, 30.0, "answers again") == [("Ada", "wall kept on L2 created")]
    assert remote.underlay("L1") == plan

    def session_ended() -> bool:
        try:
            ada.undo()
        except SessionEnded:
            return True
        except NotReachable:  # by a connection to the killed server
            return False
        pytest.fail("an undo of a session that the server does not know")

    eventually(session_ended, what="the session ended with its server")
    remote.set_underlay("L1", None)
    assert remote.underlay("L1") is None
    with pytest.raises(InvalidElement, match="no PNG or JPEG"):
        remote.set_underlay("L1", plan._replace(picture=b"<svg/>"))
