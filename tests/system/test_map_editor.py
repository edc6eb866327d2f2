"""The map editor over the wire: each kind of element, transactions, exceptions with their fields, and kills."""

from __future__ import annotations

import io
import os
import signal
from typing import Any

import pytest
from PIL import Image

from robocorba.errors.maps import InvalidElement, SessionEnded
from robocorba.errors.services import NotReachable
from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.map_editor.model import Wall
from robocorba.map_editor.underlays import Underlay
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.processes import Running, eventually
from tests.system.elements import XY, all_elements, examples, id_of, replay, wall
from tests.system.refusals import refused

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


def node(name: str, x: float, y: float) -> Any:
    return RoboCorba.Element(aNode=RoboCorba.PathNode(name, XY(x, y), ""))


def edge(name: str, a: str, b: str) -> Any:
    return RoboCorba.Element(anEdge=RoboCorba.PathEdge(name, a, b, False, 0.0, 0.0, []))


@pytest.mark.parametrize("kind", examples(""))
def test_each_kind_is_created_read_changed_and_removed(editor: Any, kind: str) -> None:
    floor, value, changed = examples(NAME)[kind]
    id = id_of(floor, value)
    began = editor._get_currentVersion()

    first = editor.create(floor, value)
    assert first == began + 1 == editor._get_currentVersion()
    record = editor.read(id)
    assert (record.onFloor, repr(record.value), record.changedAt) == (floor, repr(value), first)
    duplicate = refused(RoboCorba.DuplicateElement, editor.create, floor, changed)
    assert words(duplicate.id) == (kind, floor, NAME)

    second = editor.change(floor, changed, first)
    (record,) = [found for found in editor.elements(value._d, floor) if found.value._v.name == NAME]
    assert (record.onFloor, repr(record.value), record.changedAt) == (floor, repr(changed), second)
    for said in (
        refused(RoboCorba.StaleEdit, editor.change, floor, value, first),
        refused(RoboCorba.StaleEdit, editor.remove, id, first),
    ):
        assert (words(said.id), said.expected, said.current) == ((kind, floor, NAME), first, second)

    third = editor.remove(id, second)
    for said in (
        refused(RoboCorba.UnknownElement, editor.read, id),
        refused(RoboCorba.UnknownElement, editor.change, floor, value, second),
        refused(RoboCorba.UnknownElement, editor.remove, id, second),
    ):
        assert words(said.id) == (kind, floor, NAME)
    changes = editor.changesSince(began)
    assert [(change.changedTo, str(change.kind), change.onFloor, repr(change.value)) for change in changes] == [
        (first, "CREATED", floor, repr(value)),
        (second, "CHANGED", floor, repr(changed)),
        (third, "REMOVED", floor, repr(changed)),
    ]


def test_what_there_is_and_what_breaks_a_rule(editor: Any) -> None:
    assert editor._get_buildingName() == "two floors"
    assert editor.floors() == ["L1", "L2"]
    nodes = editor.elements(RoboCorba.NODE_ELEMENT, "L1")
    assert [record.value._v.name for record in nodes] == ["west", "east", "lift1"]
    began = editor._get_currentVersion()
    for said in (
        refused(RoboCorba.UnknownElement, editor.elements, RoboCorba.WALL_ELEMENT, "L9"),
        refused(RoboCorba.UnknownElement, editor.create, "L9", wall("w")),
        refused(RoboCorba.UnknownElement, editor.buildTopologicalMap, "L9", 0.4),
    ):
        assert words(said.id) == ("FLOOR_ELEMENT", "", "L9")
    said = refused(RoboCorba.InvalidElement, editor.create, "L1", node("n", 10.0, 2.0))
    assert (words(said.id), said.reason) == (("NODE_ELEMENT", "L1", "n"), "it stands on wall 'w'")
    west = id_of("L1", nodes[0].value)
    said = refused(RoboCorba.InvalidElement, editor.remove, west, nodes[0].changedAt)
    assert words(said.id) == ("EDGE_ELEMENT", "L1", "west-east")
    assert said.reason == "node 'west' does not exist on this floor"
    for radius in (50.0, 0.0, float("nan")):
        said = refused(RoboCorba.InvalidElement, editor.buildTopologicalMap, "L1", radius)
        assert words(said.id) == ("FLOOR_ELEMENT", "", "L1") and said.reason
    document = "robocorba: 1\nname: x\nfloors:\n- {name: a, level: 1, elevation: .nan}\n"
    said = refused(RoboCorba.InvalidMap, editor.importMap, document, began)
    assert (said.line, said.key) == (4, "floors[0]")
    assert said.reason == "floor 'a': elevation is not a finite number"
    assert editor._get_currentVersion() == began


# ---- transactions ----


def test_a_transaction_is_one_edit(editor: Any) -> None:
    began = editor._get_currentVersion()
    transaction = editor.begin()
    made = node("n", 15.0, 8.0)
    transaction.create("L2", edge("e", "n", "top"))
    transaction.create("L2", made)
    transaction.create("L2", wall("gone"))
    transaction.change("L2", wall("gone", height=1.0), 0)
    transaction.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L2", "gone"), 0)
    assert editor._get_currentVersion() == began
    refused(RoboCorba.UnknownElement, editor.read, id_of("L2", made))
    assert transaction.commit() == began + 1
    changes = editor.changesSince(began)
    assert sorted((change.changedTo, change.value._v.name) for change in changes) == [
        (began + 1, "e"),
        (began + 1, "n"),
    ]
    assert editor.undo(began + 1) == began + 2
    refused(RoboCorba.UnknownElement, editor.read, id_of("L2", made))


# ---- history ----


def test_the_map_goes_out_and_in_as_text(editor: Any) -> None:
    before, began = all_elements(editor), editor._get_currentVersion()
    document = editor.exportMap()
    assert editor.importMap(document, began) == began  # nothing differs
    renamed = document.replace("two floors", "二つの階 ё", 1).replace("from: [10.0, 0.0]", "from: [10.0, 0.5]")
    assert renamed.count("10.0, 0.5") == 1
    stale = refused(RoboCorba.StaleVersion, editor.importMap, renamed, began - 1)
    assert (stale.expected, stale.current) == (began - 1, began)
    assert editor.importMap(renamed, began) == began + 1
    assert editor._get_buildingName() == "二つの階 ё"
    assert editor.read(id_of("L1", wall("w"))).value._v.fromPoint.y == 0.5
    assert replay(before, editor.changesSince(began)) == all_elements(editor)
    assert editor.undo(began + 1) == began + 2
    assert (editor._get_buildingName(), editor.exportMap()) == ("two floors", document)

    began += 2
    assert editor.buildTopologicalMap("L1", 0.4) == began + 1
    assert replay(before, editor.changesSince(began)) == all_elements(editor) != before
    editor.undo(began + 1)
    assert all_elements(editor) == before


# ---- paths ----


def lock(editor: Any, locked: bool) -> int:
    """Lock or unlock door d of L1, through which the edge west-east leads."""
    door = editor.read(RoboCorba.ElementId(RoboCorba.DOOR_ELEMENT, "L1", "d"))
    door.value._v.locked = locked
    return editor.change("L1", door.value, door.changedAt)


def test_an_edit_is_seen_by_the_next_path(editor: Any, planner: Any) -> None:
    for _ in range(10):
        version = lock(editor, True)
        (blocker,) = refused(RoboCorba.NoPath, planner.getPath, WEST, EAST).blockers
        assert (str(blocker.id.kind), blocker.id.name, blocker.reason) == ("DOOR_ELEMENT", "d", "is locked")
        assert planner._get_mapVersion() == version
        version = lock(editor, False)
        (path,) = planner.findPaths(planner.defaultRequest(WEST, EAST))
        assert path.mapVersion == version
        assert (str(path.points[0].kind), str(path.points[-1].kind)) == ("START", "GOAL")


def test_an_edge_is_blocked_while_its_door_is_locked(editor: Any, system: Running) -> None:
    def blocked() -> list[tuple[str, str, str, float, float, str]]:
        return [
            (str(found.id.kind), found.id.name, *vars(found.position).values(), found.reason)
            for found in editor.check()
            if found.reason.startswith("blocked")
        ]

    assert [found.id.name for found in editor.check()] == ["west", "east"]  # no edge leads back from the elevator
    version = lock(editor, True)
    reason = "it leads through locked door 'd' near 10, 5"
    assert blocked() == [("EDGE_ELEMENT", "west-east", "L1", 10.0, 5.0, f"blocked: {reason}")]
    log, said = system.state / "logs" / "map_editor.log", f"version {version} blocks edge 'west-east' on L1: {reason}\n"
    eventually(lambda: said in log.read_text(), what="the line of the log")
    said = refused(RoboCorba.InvalidElement, editor.create, "L1", edge("again", "west", "east"))
    assert words(said.id) == ("EDGE_ELEMENT", "L1", "again")
    lock(editor, False)
    assert blocked() == []


# ---- as an editing client in Python has it ----


def short_wall(name: str, x: float = 0.5) -> Wall:
    """A wall far from all nodes and edges."""
    return Wall(name=name, a=(x, 8.5), b=(x, 9.5))


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
    eventually(lambda: system.pid("map_editor") not in (0, pid), what="restarted")

    def edits() -> list[tuple[str, str]]:
        try:
            return [(edit.author, edit.summary) for edit in remote.edits_since(began)]
        except NotReachable:
            return []

    assert eventually(edits, what="answers again") == [("Ada", "wall kept on L2 created")]
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
