"""Servants of the map building agent: the map editor and its transactions."""

from __future__ import annotations

import threading
from typing import Any, Protocol

from robocorba.corba.conversion import maps
from robocorba.corba.conversion.errors import translating
from robocorba.errors.maps import InvalidElement, MapFileError
from robocorba.maps import native
from robocorba.maps.map_building_agent import BuildingEditor, Transaction
from robocorba.stubs import RoboCorba, RoboCorba__POA

#: Closed transactions whose servants stay active and raise TransactionClosed; older ones are deactivated.
CLOSED_TRANSACTIONS_KEPT = 100
#: Maximum number of findings in a reply: each takes about 500 bytes, and a reply is limited to 64 MiB.
MAX_FINDINGS = 10_000


class Activator(Protocol):
    """Activates and deactivates servants, e.g. robocorba.corba.orb.Orb."""

    def activate(self, servant: Any) -> Any:
        """Activate a servant; its object reference."""

    def deactivate(self, servant: Any) -> None:
        """Deactivate a servant."""


class TransactionServant(RoboCorba__POA.Transaction):
    """RoboCorba::Transaction."""

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction

    @property
    def is_open(self) -> bool:
        """Whether it is neither committed, rolled back nor timed out."""
        return self._transaction.is_open

    @translating
    def create(self, onFloor: str, value: Any) -> None:
        self._transaction.create(onFloor, maps.element_of(value))

    @translating
    def change(self, onFloor: str, value: Any, expected: int) -> None:
        self._transaction.change(onFloor, maps.element_of(value), expected)

    @translating
    def remove(self, id: Any, expected: int) -> None:
        self._transaction.remove(*maps.key_of(id), expected)

    @translating
    def commit(self) -> int:
        return self._transaction.commit()

    @translating
    def rollBack(self) -> None:
        self._transaction.roll_back()


class MapEditorServant(RoboCorba__POA.MapEditor):
    """RoboCorba::MapEditor for a BuildingEditor."""

    def __init__(self, editor: BuildingEditor, activator: Activator) -> None:
        self._editor, self._activator = editor, activator
        self._transactions: list[TransactionServant] = []
        self._beginning = threading.Lock()

    def _get_buildingName(self) -> str:
        return self._editor.building.name

    def _get_currentVersion(self) -> int:
        return self._editor.version

    def floors(self) -> list[str]:
        return list(self._editor.building.floors)

    @translating
    def elements(self, kind: Any, onFloor: str) -> list[Any]:
        found = self._editor.elements(maps.kind_of(kind), onFloor)
        return [maps.record(onFloor, value, changed_in) for value, changed_in in found]

    @translating
    def read(self, id: Any) -> Any:
        key = maps.key_of(id)
        return maps.record(key.floor, *self._editor.read(*key))

    @translating
    def create(self, onFloor: str, value: Any) -> int:
        return self._editor.create(onFloor, maps.element_of(value))

    @translating
    def change(self, onFloor: str, value: Any, expected: int) -> int:
        return self._editor.change(onFloor, maps.element_of(value), expected)

    @translating
    def remove(self, id: Any, expected: int) -> int:
        return self._editor.remove(*maps.key_of(id), expected)

    @translating
    def begin(self) -> Any:
        with self._beginning:
            servant = TransactionServant(self._editor.begin())
            ended = [each for each in self._transactions if not each.is_open]
            for oldest in ended[:-CLOSED_TRANSACTIONS_KEPT]:
                self._transactions.remove(oldest)
                self._activator.deactivate(oldest)
            self._transactions.append(servant)
            return self._activator.activate(servant)

    @translating
    def undo(self, expected: int) -> int:
        return self._editor.undo(expected)

    @translating
    def redo(self, expected: int) -> int:
        return self._editor.redo(expected)

    @translating
    def changesSince(self, since: int) -> list[Any]:
        return maps.changes(self._editor.changes_since(since))

    @translating
    def buildTopologicalMap(self, onFloor: str, robotRadius: float) -> int:
        # Imported here: it takes 0.5 s to load, and a server must restart quickly.
        from robocorba.maps.topology import topological_map

        return self._editor.replace_topology(onFloor, topological_map(self._editor.building, onFloor, robotRadius))

    def check(self) -> list[Any]:
        from robocorba.maps.checking import findings  # imported here for the same reason

        return maps.findings(findings(self._editor.building)[:MAX_FINDINGS])

    def exportMap(self) -> str:
        return native.dumps(self._editor.building)

    @translating
    def importMap(self, document: str, expected: int) -> int:
        try:
            building = native.loads(document, "document")
        except MapFileError as error:
            raise RoboCorba.InvalidMap(error.line, error.key, error.reason) from error
        try:
            return self._editor.replace(building, expected)
        except InvalidElement as error:  # valid, but too large
            raise RoboCorba.InvalidMap(0, "", str(error)) from error
