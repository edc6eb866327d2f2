"""A copy of the map editor's building in another process: loaded once, then updated with its changes."""

from __future__ import annotations

import contextlib
from typing import Any

from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import maps
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.maps.model import COLLECTION_OF, KIND_OF, Building, ElementKind, FloorMap, GeometricalMap
from robocorba.stubs import RoboCorba

#: Element kinds that the copy omits: only the path planning agent uses the topological map.
EXCLUDED_KINDS = (ElementKind.NODE, ElementKind.EDGE)
#: Default timeout to find the map editor [s]. An editor that compiles for the first time starts slowly; the
#: starter of this process waits no longer than this.
LOAD_TIMEOUT_S = 300.0


class RemoteMap:
    """The geometrical maps and elevators of a building.

    Raises NotReachable if there is no map editor within `timeout_s`, or if loading fails."""

    def __init__(self, orb: Orb, timeout_s: float = LOAD_TIMEOUT_S) -> None:
        self._editor = orb.resolve("MapEditor", RoboCorba.MapEditor, timeout_s)
        self._load()

    def follow(self) -> bool:
        """Apply the editor's new changes; whether there were any. Raises NotReachable."""
        before = self.version
        try:
            if self._editor._get_currentVersion() != before:
                self._apply_changes()
        except RoboCorba.VersionUnavailable:
            self._load()
        except CORBA.SystemException as error:
            raise NotReachable(f"the map editor does not answer ({describe(error)})") from None
        return self.version != before

    def _load(self) -> None:
        try:
            self.version: int = self._editor._get_currentVersion()
            building = Building(self._editor._get_buildingName())
            for kind in (ElementKind.FLOOR, ElementKind.ELEVATOR):
                for element in self._elements(kind, "").values():
                    building = building.with_element("", element)
            floors = {}
            for name, entry in building.floors.items():
                plan = {
                    collection: self._elements(kind, name)
                    for kind, (layer, collection) in COLLECTION_OF.items()
                    if layer == "geometrical"
                }
                floors[name] = FloorMap(entry.floor, GeometricalMap(**plan))
            building = Building(building.name, floors, building.elevators)
        except CORBA.Exception as error:
            raise NotReachable(f"the map can't be loaded from the map editor ({describe(error)})") from None
        self.building = building
        with contextlib.suppress(RoboCorba.VersionUnavailable):
            self._apply_changes()  # edits during loading

    def _elements(self, kind: ElementKind, floor: str) -> dict[str, Any]:
        records = self._editor.elements(getattr(RoboCorba, f"{kind.name}_ELEMENT"), floor)
        return {element.name: element for element in (maps.element_of(record.value) for record in records)}

    def _apply_changes(self) -> None:
        building, version = self.building, self.version
        for change in self._editor.changesSince(version):
            version, element = change.changedTo, maps.element_of(change.value)
            kind = KIND_OF[type(element)]
            if kind in EXCLUDED_KINDS:
                continue
            if change.kind == RoboCorba.REMOVED:
                with contextlib.suppress(KeyError):
                    building = building.without(kind, change.onFloor, element.name)
            else:
                with contextlib.suppress(KeyError):  # on a floor that was removed later
                    building = building.with_element(change.onFloor, element)
        self.building, self.version = building, version
