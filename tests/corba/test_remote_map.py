"""Copies of the building, also while others edit it or the map editor ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.corba.remote.edit_session import RemoteMapEditor
from robocorba.corba.remote.map_editor import RemoteMap
from robocorba.corba.servants.map_editor import MapEditorServant
from robocorba.errors.services import NotReachable
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import PathNode, Wall
from robocorba.maps.store import MapStore
from robocorba.testing.buildings import two_floors


class Editor:
    """An ORB that resolves the map editor. meanwhile: called when the elevators are read, at the end of loading."""

    def __init__(self, editor: BuildingEditor) -> None:
        self.editor, self._servant = editor, MapEditorServant(editor, cast(Any, None))
        self.meanwhile: Callable[[], object] = int
        self.has_ended = False

    def resolve(self, *_: object) -> Editor:
        return self

    def elements(self, kind: Any, floor: str) -> Any:
        if not floor and kind._n == "ELEVATOR_ELEMENT":
            self.meanwhile()
        return self._servant.elements(kind, floor)

    def changesSince(self, version: int) -> Any:
        if self.has_ended:
            raise CORBA.COMM_FAILURE(0, CORBA.COMPLETED_NO)
        return self._servant.changesSince(version)

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
    place.has_ended = True
    with pytest.raises(NotReachable, match="can't be loaded from the map editor"):
        RemoteMap(cast(Orb, place))
