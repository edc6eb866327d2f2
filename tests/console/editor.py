"""A map editor for tests of the console: the building editor with the methods of its remote client."""

from __future__ import annotations

from typing import Any

from robocorba.errors.maps import SessionEnded
from robocorba.maps.edit_session import EditSessions
from robocorba.maps.edits import EditRecord
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Building, Element, ElementKind


class LocalEditor:
    """The methods of RemoteMapEditor that edits need."""

    def __init__(self, editor: BuildingEditor) -> None:
        self.editor = editor
        self.sessions: list[LocalSession] = []

    def version(self) -> int:
        return self.editor.version

    def building_name(self) -> str:
        return self.editor.building.name

    def building(self) -> tuple[Building, int]:
        return self.editor.snapshot

    def elements(self, kind: ElementKind, floor: str = "") -> list[tuple[Element, int]]:
        return self.editor.elements(kind, floor)

    def edits_since(self, version: int) -> list[EditRecord]:
        return self.editor.edits_since(version)

    def open_session(self, author: str) -> LocalSession:
        self.sessions.append(LocalSession(EditSessions(self.editor).open(author)))
        return self.sessions[-1]


class LocalSession:
    """The methods of RemoteEditSession."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self.is_closed = False

    def __getattr__(self, name: str) -> Any:
        if self.is_closed:
            raise SessionEnded("the edit session has ended")
        value = getattr(self._session, name)
        return (lambda: value) if isinstance(value, str) else value

    def close(self) -> None:
        self.is_closed = True
