"""Copies of the building, also while others edit it or the map editor ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.corba.remote.edit_session import RemoteMapEditor
from robocorba.corba.remote.map_editor import RemoteFloorMap, RemoteMap
from robocorba.corba.servants.map_editor import MapEditorServant
from robocorba.errors.maps import UnknownElement, VersionUnavailable
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.maps.edit_session import EditSessions
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import ElementKind, PathNode, Wall
from robocorba.maps.pages import ChangePosition
from robocorba.maps.store import MapStore
from robocorba.testing.buildings import two_floors


class Editor:
    """An ORB that resolves the map editor. meanwhile: called when the last elements are read, at the end of loading.

    limit: of elements and changes in a page. pages: of elements, so far. fails_after: the number of pages of changes
    after which it does not answer; negative for never."""

    def __init__(self, editor: BuildingEditor) -> None:
        self.editor, self._servant = editor, MapEditorServant(EditSessions(editor), cast(Any, None))
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
def place(tmp_path: Any) -> Any:
    with MapStore.create(tmp_path / "map.sqlite", two_floors()) as store:
        yield Editor(BuildingEditor(store))


def test_the_whole_building_is_read_while_others_edit_it(place: Editor) -> None:
    def edit() -> None:
        place.editor.create("L1", Wall(name="late", a=(2.0, 1.0), b=(2.0, 2.0)))
        place.editor.create("L2", PathNode(name="late", at=(1.0, 1.0)))

    remote = RemoteMapEditor(cast(Orb, place))
    assert remote.building() == place.editor.snapshot
    place.meanwhile = edit
    building, version = remote.building()
    assert (building, version) == place.editor.snapshot
    assert version == 3
    assert "late" in building.floors["L2"].topological.nodes


def test_an_editor_that_ends_during_loading_is_not_reachable(place: Editor) -> None:
    place.fails_after = 0
    with pytest.raises(NotReachable, match="can't be loaded from the map editor"):
        RemoteMap(cast(Orb, place))


def many_nodes(count: int) -> list[PathNode]:
    return [PathNode(name=f"n{number}", at=(float(number), 20.0)) for number in range(count)]


def create_all(place: Editor, nodes: list[PathNode]) -> None:
    transaction = place.editor.begin()
    for node in nodes:
        transaction.create("L2", node)
    transaction.commit()


def test_a_large_edit_is_followed_in_pages_and_appears_at_once(place: Editor) -> None:
    copy = RemoteMap(cast(Orb, place), with_topology=True)
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


def test_nodes_do_not_reach_a_copy_without_topology(place: Editor) -> None:
    copy = RemoteMap(cast(Orb, place))
    create_all(place, many_nodes(9))
    place.fails_after = 1
    assert copy.follow()
    assert copy.version == place.editor.version
    assert copy.building.floors["L2"].geometrical == place.editor.building.floors["L2"].geometrical


@pytest.mark.parametrize("cause", ["far behind", "history lost"])
def test_a_copy_that_is_far_behind_is_loaded_again(place: Editor, monkeypatch: pytest.MonkeyPatch, cause: str) -> None:
    copy = RemoteMap(cast(Orb, place), with_topology=True)
    loaded_pages = place.pages
    if cause == "far behind":
        monkeypatch.setattr("robocorba.corba.remote.map_editor.MAX_PAGE", 5)
        create_all(place, many_nodes(100))
    else:
        copy._next = ChangePosition(0)  # as if it had missed ten thousand edits
        place.editor.create("L2", PathNode(name="late", at=(1.0, 1.0)))
    assert copy.follow()
    assert (copy.building, copy.version) == place.editor.snapshot
    assert place.pages > loaded_pages
    place.editor.create("L2", PathNode(name="later", at=(2.0, 1.0)))
    assert copy.follow()
    assert (copy.building, copy.version) == place.editor.snapshot


def test_a_floor_is_loaded_again_only_for_its_own_obstacles(place: Editor) -> None:
    source = RemoteFloorMap(cast(Orb, place))
    first = source.of("L1")
    assert first.floors["L1"].geometrical.walls == place.editor.building.floors["L1"].geometrical.walls
    assert (list(first.floors), first.elevators) == (["L1"], place.editor.building.elevators)
    create_all(place, many_nodes(3))
    place.editor.create("L2", Wall(name="elsewhere", a=(2.0, 1.0), b=(2.0, 2.0)))
    assert source.of("L1") is first
    place.editor.create("L1", Wall(name="here", a=(2.0, 1.0), b=(2.0, 2.0)))
    assert "here" in source.of("L1").floors["L1"].geometrical.walls
    with pytest.raises(UnknownFloor):
        source.of("L9")


def test_pages_of_the_editing_client(place: Editor) -> None:
    remote = RemoteMapEditor(cast(Orb, place))
    create_all(place, many_nodes(5))
    assert remote.elements(ElementKind.NODE, "L2") == place.editor.elements(ElementKind.NODE, "L2")
    assert [change.element for change in remote.changes_since(1)] == many_nodes(5)
    assert remote.elements(ElementKind.AREA, "L2") == []
    with pytest.raises(UnknownElement):
        remote.elements(ElementKind.NODE, "L9")
    with pytest.raises(VersionUnavailable):
        remote.changes_since(0)
